"""The recordings of a project: films with their cameras, markers, the speckled face, the pressure log."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.csvtable import Table, read_sheet
from twin.gauge.pressurelog import (
    GaugeNoise,
    Log,
    all_rest,
    check_covers,
    check_signal,
    gauge_noise,
    read_log,
    rest_remark,
)
from twin.gauge.pressuretable import PressureTable
from twin.inputs.cameras import camera_table, dictionary_files, stored_cameras, stored_rig
from twin.marktables import MarkTable, PointTable, PoseTable
from twin.project.cameratables import CameraTable
from twin.project.folder import Project
from twin.targets import Array

Rows = tuple[tuple[float, float, float], ...]

if TYPE_CHECKING:  # vision takes a second to import: only the stages that measure pay for it
    from vision import Mark, Stated, View
    from vision.calibration.rig import Rig
    from vision.following.corrections import Correction
    from vision.kinds import MarkKind
    from vision.measuring.face import Face
    from vision.placing.restplaces import BodyPose


def pressure_table(project: Project) -> PressureTable:
    """[pressure] of twin.toml."""
    assert project.config.pressure is not None  # the configuration refuses a film without it
    return project.config.pressure


def log_of(project: Project, pressure: PressureTable) -> Log:
    """The pressure log, as [pressure] of twin.toml says it is to be read. ValueError where it is unclear."""
    return read_log(project.path(pressure.file), time_shift_s=pressure.time_shift_s, form=pressure.form)


def measure_inputs(project: Project, camera: Path) -> dict[str, Any]:
    """Tables and files that a run of `measure` depends on, as `Project.new_run` takes them."""
    films = [(f"cameras.{k}", getattr(t, k)) for t in project.config.cameras for k in ("film", "static")]
    named = [*films, ("pressure.file", pressure_table(project).file)]
    if project.config.measure.corrections is not None:
        named.append(("measure.corrections", project.config.measure.corrections))
    inputs = [path for key, pattern in named for path in recorded(project, key, pattern)]
    tables = ("cameras", "pressure", "measure", "frame", "pose", "points", "dic")
    extra = [*dictionary_files(project, camera_table(project).dictionary), *project.deck_files()]
    return {"tables": tables, "inputs": [*inputs, camera, *extra]}


def recorded(project: Project, key: str, pattern: str) -> list[Path]:
    """The file, the folder, or the pictures of a pattern, with their times, that twin.toml names;
    ValueError for none."""
    path = project.path(pattern)
    paths = [path] if path.exists() else sorted(p for p in path.parent.glob(path.name) if p.is_file())
    if paths and paths != [path]:
        paths += [p for p in [path.parent / "times.csv"] if p.is_file() and p not in paths]
    if not paths:
        raise ValueError(
            f"{key} = {pattern!r}: no such file in {project.root}; copy it there or correct twin.toml"
        )
    return paths


def marks_of(project: Project, pose: "BodyPose | None" = None) -> list["Mark"]:
    """Every marker with the centre that twin.toml states, (3,) mm in the axes of the finger: those of the
    frame, and the finger's; of a point that states none, its node's, or, without a node, on the side face,
    measured. ValueError where a stated one lies far from the finger.

    pose: where the finger stands, if that is not what twin.toml states.
    """
    from twin.bench.workbench import one_side, places_of, structure_of
    from twin.calibrated.positions import position_of, side_of
    from vision import Mark

    marks = [Mark(m.name, mark_kind(m), m.position_mm, m.role) for m in project.config.frame.markers]
    structure = None
    if not all(p.node and p.position_mm for p in project.config.points):  # their places, or their side
        structure = structure_of(project)
        places_of(project, structure)
    behind = one_side(project) and np.mean([m.position[1] for m in marks if m.role == "frame"]) < 0.0
    for point in project.config.points:
        position = point.position_mm  # a fact of the rig: the model's own place is for the model alone
        if position is None:
            assert structure is not None
            x, y, z = math.nan, side_of(structure), math.nan
            if not point.is_measured:
                x, y, z = (float(v) for v in position_of(point, structure))
            position = (x, -abs(y) if behind else y, z)  # on the side that the camera sees
        marks.append(Mark(point.name, mark_kind(point), position, "finger", measured=point.is_measured))
    return (stated_pose(project) if pose is None else pose).in_body(marks)


def stated_pose(project: Project) -> "BodyPose":
    """Where twin.toml says that the finger stands."""
    from vision.placing.restplaces import BodyPose

    pose = project.config.pose or PoseTable()
    return BodyPose(pose.x_mm, pose.z_mm, math.radians(pose.turn_deg))


def mark_kind(mark: MarkTable) -> "MarkKind":
    """The kind of a mark: a marker by its id, a natural feature, or else a dot."""
    from vision.kinds import CodedMarker, PlainDot, TexturePatch

    assert mark.size_mm is not None  # the configuration refuses a film without it
    if mark.marker is not None:
        return CodedMarker(mark.marker, mark.size_mm)
    seen = mark.seen_mm if isinstance(mark, PointTable) else None
    return PlainDot(mark.size_mm) if seen is None else TexturePatch(mark.size_mm, seen)


def views_of(project: Project, camera: Path) -> tuple[list["View"], "Rig | None"]:
    """Recording of every camera, and the rig of several."""
    from vision import View
    from vision.film.series import open_film

    tables = project.config.cameras
    rig = stored_rig(camera) if len(tables) > 1 else None
    cameras = rig.cameras if rig is not None else stored_cameras(camera)
    views = [
        View(
            open_film(project.path(t.film), fps=t.fps, mirrored=t.mirrored),
            open_film(project.path(t.static), fps=t.fps, mirrored=t.mirrored), camera_model, t.film_start_s,
            corrections_of(project, t),
        )
        for t, camera_model in zip(tables, cameras, strict=True)
    ]  # fmt: skip
    return views, rig


def corrections_of(project: Project, table: CameraTable) -> "tuple[Correction, ...]":
    """Corrections by hand of a camera's tracks, in the order of the file. ValueError for a line that
    is not right."""
    file = project.config.measure.corrections
    if file is None:
        return ()
    sheet = read_sheet(project.path(file), wanted="marker,does,from_s,to_s")
    rows = sheet.table(("marker", "does", "from_s"), also=("to_s", "with", "x_px", "y_px", "sd_px", "camera"))
    names = [mark.name for mark in project.config.marks]
    default, cameras = project.config.cameras[0].name, [c.name for c in project.config.cameras]
    camera_names = [name or default for name in rows.cells.get("camera", [default] * len(rows))]
    return tuple(
        _correction(rows, k, names) for k, name in enumerate(camera_names)
        if _one_of(rows, k, "camera", name, cameras) == table.name
    )  # fmt: skip


def _correction(rows: Table, k: int, names: list[str]) -> "Correction":
    """One line of corrections.csv."""
    from vision.following.corrections import DOES, SD_PX, Correction

    def text(column: str) -> str:
        return rows.cells[column][k] if column in rows.cells else ""

    def number(column: str, unit: str, default: float | None = None) -> float:
        if text(column):
            return float(rows.numbers(column, unit=unit, empty=True)[k])
        if default is None:
            raise ValueError(f"{rows.path}, line {rows.lines[k]}: {column} is missing; wanted it in {unit} "
                             f"for {text('does')!r}")  # fmt: skip
        return default

    mark = _one_of(rows, k, "marker", text("marker"), names)
    does, start = _one_of(rows, k, "does", text("does"), list(DOES)), number("from_s", "s")
    if does == "place":
        place = number("x_px", "px"), number("y_px", "px")
        return Correction(mark, does, start, start, "", place, number("sd_px", "px", SD_PX))
    end = number("to_s", "s")
    if end < start:
        raise rows.error(k, "to_s", f"wanted {start:g} s or later, the from_s of its line")
    partner = _one_of(rows, k, "with", text("with"), names) if does == "swap" else ""
    return Correction(mark, does, start, end, partner)


def _one_of(rows: Table, k: int, column: str, value: str, choices: list[str]) -> str:
    if value not in choices:
        raise ValueError(
            f"{rows.path}, line {rows.lines[k]}, column {column}: {value!r}: wanted one of "
            f"{', '.join(choices)}"
        )
    return value


def face_of(project: Project) -> "Face | None":
    """The speckled face, None without [dic]."""
    from vision.measuring.face import Face

    d = project.config.dic
    return None if d is None else Face(d.low_mm, d.high_mm, d.y_mm, d.step_mm, d.subset_mm)


def stated_of(project: Project, pose_errors: Rows | None = None) -> "Stated":
    """Stated uncertainties of the rig. Where the finger stands has errors where places are measured, or where
    twin.toml states it: places that are stated from the clamp on define the axes.

    pose_errors: of a pose that is measured, rows of x in mm, z in mm and turn in rad, 1 sd each.
    """
    from vision import Stated

    settings, pose = project.config.measure, project.config.pose
    if pose is None and any(point.is_measured for point in project.config.points):
        pose = PoseTable()
    sds = (pose.sd_mm, pose.sd_mm, math.radians(pose.turn_sd_deg)) if pose else ()
    errors = tuple((sd * (k == 0), sd * (k == 1), sd * (k == 2)) for k, sd in enumerate(sds) if sd)
    return Stated(
        place_mm=settings.place_sd_mm, pose=errors if pose_errors is None else pose_errors,
        placement_mm=settings.placement_sd_mm, scale=settings.scale_sd, frame_mm=settings.frame_sd_mm,
        node_mm=settings.node_sd_mm, height_mm=settings.height_sd_mm,
        out_of_plane_mm=settings.out_of_plane_sd_mm,
    )  # fmt: skip


# -- the pressure log while the film runs --------------------------------------------------------------------


def said_of_log(project: Project, film: Array, log: Log, start_s: float) -> tuple[str, ...]:
    """Sentences on what is odd in the log during the film (t,) s; ValueError where its pressures are
    wrong."""
    rest = rest_remark(log, start=start_s, rest_s=project.config.measure.reference_s)
    told = check_signal(log, start=start_s, end=start_s + film[-1] - film[0])
    return (*told, *filter(None, (rest, log.doubt)))


def gauge_of(project: Project, film: Array, static: Array, log: Log, start_s: float) -> GaugeNoise:
    """The gauge noise during the static film, or, if its time is unknown, in the film's first rest, and in
    all rest beside it where that has too few samples. ValueError where the log does not cover the films.

    film, static: (t,) s on their own clocks.   start_s: of the film on the log's clock.
    """
    table, rest_s = camera_table(project), project.config.measure.reference_s
    check_covers(log, film - film[0] + start_s, what="film", key="film_start_s")
    if table.static_start_s is None:
        start, end = all_rest(log, start_s, start_s + rest_s)
        return gauge_noise(log, start=start, end=end)
    time = static - static[0] + table.static_start_s
    check_covers(log, time, what="static film", key="static_start_s")
    return gauge_noise(log, start=float(time[0]), end=float(time[-1]))
