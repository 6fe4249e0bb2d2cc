"""What a project has recorded, as `vision` takes it: films with their cameras, markers, the speckled face."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.csvtable import Table, read_sheet
from twin.gauge.logcolumns import LogFormat
from twin.gauge.pressurelog import Log, read_log
from twin.gauge.pressuretable import PressureTable
from twin.gauge.pressureunits import Line
from twin.inputs.camerarecord import stored_cameras, stored_rig
from twin.inputs.cameras import camera_table, dictionary_files
from twin.marktables import MarkTable, PointTable
from twin.project.cameratables import CameraTable, MeasureTable
from twin.project.folder import Project

if TYPE_CHECKING:  # vision takes a second to import: only the stages that measure pay for it
    from vision import Mark, Stated, View
    from vision.calibration.rig import Rig
    from vision.following.corrections import Correction
    from vision.kinds import MarkKind
    from vision.measuring.face import Face


def pressure_table(project: Project) -> PressureTable:
    """[pressure] of twin.toml."""
    assert project.config.pressure is not None  # the configuration refuses a film without it
    return project.config.pressure


def log_of(project: Project, pressure: PressureTable) -> Log:
    """The pressure log, as [pressure] of twin.toml says it is to be read. ValueError where it is unclear."""
    line = None
    if pressure.volt_zero is not None and pressure.MPa_per_V is not None:
        line = Line(pressure.volt_zero, pressure.MPa_per_V)
    form = LogFormat(pressure.column, pressure.unit, line, pressure.top_kPa)
    return read_log(project.path(pressure.file), time_shift_s=pressure.time_shift_s, form=form)


def measure_inputs(project: Project, camera: Path) -> dict[str, Any]:
    """What makes a run of `measure` what it is: tables and files, as `Project.new_run` takes them."""
    films = [(f"cameras.{k}", getattr(t, k)) for t in project.config.cameras for k in ("film", "static")]
    named = [*films, ("pressure.file", pressure_table(project).file)]
    if project.config.measure.corrections is not None:
        named.append(("measure.corrections", project.config.measure.corrections))
    inputs = [path for key, told in named for path in recorded(project, key, told)]
    tables = ("cameras", "pressure", "measure", "frame", "points", "dic")
    extra = [*dictionary_files(project, camera_table(project).dictionary), *project.deck_files()]
    return {"tables": tables, "inputs": [*inputs, camera, *extra]}


def recorded(project: Project, key: str, told: str) -> list[Path]:
    """The file, the folder, or the pictures of a pattern, with their times, that twin.toml names;
    ValueError for none."""
    path = project.path(told)
    found = [path] if path.exists() else sorted(p for p in path.parent.glob(path.name) if p.is_file())
    if found and found != [path]:
        found += [p for p in [path.parent / "times.csv"] if p.is_file() and p not in found]
    if not found:
        raise ValueError(
            f"{key} = {told!r}: no such file in {project.root}; copy it there or correct twin.toml"
        )
    return found


def marks_of(project: Project) -> list["Mark"]:
    """Every marker with the centre that twin.toml states, (3,) mm: those of the frame, and the finger's; of
    a point that states none, its node's. ValueError where a stated one lies far from the finger."""
    from twin.bench.positions import one_side, places_of, position_of
    from twin.bench.workbench import structure_of
    from vision import Mark

    marks = [
        Mark(m.name, mark_kind(m), m.position_mm, m.role)
        for m in project.config.frame.markers
    ]
    structure = None
    if not all(p.node and p.position_mm for p in project.config.points):
        structure = structure_of(project)
        places_of(project, structure)
    behind = one_side(project) and np.mean([m.position[1] for m in marks if m.role == "frame"]) < 0.0
    for point in project.config.points:
        position = point.position_mm  # a fact of the rig: the model's own place is for the model alone
        if position is None:
            assert structure is not None
            x, y, z = (float(v) for v in position_of(point, structure))
            position = (x, -abs(y) if behind else y, z)  # on the side that the camera sees
        marks.append(Mark(point.name, mark_kind(point), position, "finger"))
    return marks


def mark_kind(mark: MarkTable) -> "MarkKind":
    """What is followed, as twin.toml states it: a marker by its id, a natural feature, or else a dot."""
    from vision.kinds import CodedMarker, PlainDot, TexturePatch

    assert mark.size_mm is not None  # the configuration refuses a film without it
    if mark.marker is not None:
        return CodedMarker(mark.marker, mark.size_mm)
    seen = mark.seen_mm if isinstance(mark, PointTable) else None
    return PlainDot(mark.size_mm) if seen is None else TexturePatch(mark.size_mm, seen)


def views_of(project: Project, camera: Path) -> tuple[list["View"], "Rig | None"]:
    """What every camera recorded, and how several cameras stand to each other."""
    from vision import View
    from vision.film.series import open_film

    tables = project.config.cameras
    rig = stored_rig(camera) if len(tables) > 1 else None
    cameras = rig.cameras if rig is not None else stored_cameras(camera)
    views = [
        View(
            open_film(project.path(t.film), fps=t.fps, mirrored=t.mirrored),
            open_film(project.path(t.static), fps=t.fps, mirrored=t.mirrored), own, t.film_start_s,
            corrections_of(project, t),
        )
        for t, own in zip(tables, cameras, strict=True)
    ]  # fmt: skip
    return views, rig


def corrections_of(project: Project, table: CameraTable) -> "tuple[Correction, ...]":
    """What the user mends by hand of a camera's tracks, in the order of the file. ValueError for a line that
    is not right."""
    file = project.config.measure.corrections
    if file is None:
        return ()
    sheet = read_sheet(project.path(file), wanted="marker,does,from_s,to_s")
    rows = sheet.table(("marker", "does", "from_s"), also=("to_s", "with", "x_px", "y_px", "sd_px", "camera"))
    names = [mark.name for mark in project.config.marks]
    first, cameras = project.config.cameras[0].name, [c.name for c in project.config.cameras]
    own = [name or first for name in rows.cells.get("camera", [first] * len(rows))]
    return tuple(
        _correction(rows, k, names) for k, name in enumerate(own)
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
    other = _one_of(rows, k, "with", text("with"), names) if does == "swap" else ""
    return Correction(mark, does, start, end, other)


def _one_of(rows: Table, k: int, column: str, value: str, known: list[str]) -> str:
    if value not in known:
        raise ValueError(
            f"{rows.path}, line {rows.lines[k]}, column {column}: {value!r}: wanted one of {', '.join(known)}"
        )
    return value


def face_of(project: Project) -> "Face | None":
    """The speckled face, None without [dic]."""
    from vision.measuring.face import Face

    d = project.config.dic
    return None if d is None else Face(d.low_mm, d.high_mm, d.y_mm, d.step_mm, d.subset_mm)


def stated_of(settings: MeasureTable) -> "Stated":
    """How well the rig is known."""
    from vision import Stated

    return Stated(
        placement_mm=settings.placement_sd_mm, scale=settings.scale_sd, frame_mm=settings.frame_sd_mm,
        node_mm=settings.node_sd_mm, height_mm=settings.height_sd_mm,
        out_of_plane_mm=settings.out_of_plane_sd_mm,
    )  # fmt: skip
