"""Turn board images into a camera, and film, static film and pressure log into displacement targets."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin import files
from twin.config import CameraTable, MeasureTable
from twin.gauge import GaugeNoise, Log, check_covers, gauge_noise, read_log
from twin.joining import Join, by_flash, by_onset
from twin.project import Project, Say
from twin.targetfiles import write_targets
from twin.targets import MATERIAL, Array, Noise, Targets

if TYPE_CHECKING:  # vision takes a second to import: only the stages that measure pay for it
    from vision import Board, Camera, Displacements, Mark, Stated, Video, View
    from vision.face import Face
    from vision.rig import Rig

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
DIGITS = 6  # of mm: a nanometre, far below any sd, keeps targets.csv readable


@dataclass(frozen=True)
class Followed:
    """What a run has followed so far, as files in its folder: a killed one goes on from there."""

    folder: Path

    def load(self, name: str) -> dict[str, NDArray[Any]] | None:
        """Return the arrays kept under a name, None without any."""
        path = self._path(name)
        return files.read_npz(path) if path.exists() else None

    def save(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Keep arrays under a name."""
        files.write_npz(self._path(name), arrays)

    def remove(self) -> None:
        """Remove all of them."""
        for path in self.folder.glob("followed-*.npz"):
            path.unlink()

    def _path(self, name: str) -> Path:
        return self.folder / f"followed-{name}.npz"


def run_camera(project: Project, say: Say) -> dict[str, Any]:
    """Calibrate the camera from its board images into runs/NNNN-camera/camera.json, unless that is done.

    Several cameras are calibrated together, into rig.json.
    """
    table = _camera_table(project)
    how = _camera_inputs(project)
    done = project.done("camera", **how)
    if done is not None:
        say(f"camera: already done in {project.shown(done)}, skipped")
        return _result(project, "camera", done, skipped=True)
    if len(project.config.cameras) > 1:
        return _run_rig(project, say, how)
    with project.new_run("camera", **how) as run:
        camera = _read_camera(project, table) if table.camera_file else _calibrated(project, table)
        given = 0 if table.camera_file else len(_images(project, table))
        run.write_json("camera.json", camera.to_dict())
        run.summary.update(
            rms_px=camera.rms_px, images=camera.images, given=given, model=" ".join(camera.model),
            sd=dict(zip(PARAMETERS, camera.stdevs.tolist(), strict=True)), remarks=list(camera.remarks),
        )  # fmt: skip
        run.summary["headline"] = f"reprojection RMS {camera.rms_px:.3f} px"
    for sentence in camera.remarks:
        say(f"camera: {sentence}")
    source = table.camera_file or f"{camera.images} of {given} board images"
    say(f"camera: {source}, reprojection RMS {camera.rms_px:.3f} px (limit {table.max_rms_px:g}); wrote "
        f"{project.shown(run.path('camera.json'))}")  # fmt: skip
    return _result(project, "camera", run.folder)


def _calibrated(project: Project, table: CameraTable) -> "Camera":
    from vision import calibrate_camera

    return calibrate_camera(_images(project, table), _board(project, table), max_rms_px=table.max_rms_px)


def _board(project: Project, table: CameraTable) -> "Board":
    from vision import Board

    assert table.board is not None  # the configuration refuses boards without it
    stated = table.board.model_dump() | {"marker_mm": table.board.marker_mm or 0.0}
    return Board(**stated | {"dictionary": dictionary_name(project, table.board.dictionary)})


def _run_rig(project: Project, say: Say, how: dict[str, Any]) -> dict[str, Any]:
    """Calibrate every camera, then all of them together from the pictures of one name."""
    from vision.stereo import calibrate_rig

    tables = project.config.cameras
    with project.new_run("camera", **how) as run:
        cameras = [_calibrated(project, table) for table in tables]
        rig = calibrate_rig(
            [_images(project, table) for table in tables], _board(project, tables[0]), cameras,
            max_rms_px=max(table.max_rms_px for table in tables),
        )  # fmt: skip
        remarks = [f"{t.name}: {r}" for t, c in zip(tables, cameras, strict=True) for r in c.remarks]
        run.write_json("rig.json", rig.to_dict())
        run.summary.update(
            rms_px={t.name: c.rms_px for t, c in zip(tables, cameras, strict=True)},
            images={t.name: c.images for t, c in zip(tables, cameras, strict=True)},
            remarks=[*remarks, *rig.remarks], headline=rig.remarks[0],
        )  # fmt: skip
    for sentence in remarks:
        say(f"camera: {sentence}")
    say(f"camera: {rig.remarks[0]}; wrote {project.shown(run.path('rig.json'))}")
    return _result(project, "camera", run.folder)


def _read_camera(project: Project, table: CameraTable) -> "Camera":
    from vision import Video
    from vision.camerafile import read_camera

    film = Video(project.path(table.film))
    path = project.path(table.camera_file or "")
    return read_camera(path, name=table.name, size=(film.width, film.height))


def run_measure(project: Project, say: Say, *, replace: bool = False, budget: bool = False) -> dict[str, Any]:
    """Measure the films into targets/ and runs/NNNN-measure, unless that is done.

    Targets that come from other inputs are never overwritten: ValueError, or with `replace` they are kept
    as targets-0001, -0002, ... With `budget` the table of what the uncertainty is made of is said.
    """
    result = _measured(project, say, replace)
    if budget:
        result["budget"] = _say_budget(project.path(result["run"]) / "budget.csv", say)
    return result


def _measured(project: Project, say: Say, replace: bool) -> dict[str, Any]:
    table = _camera_table(project)
    camera = _camera(project)
    how = _measure_inputs(project, camera)
    done, killed, owner = (
        project.done("measure", **how),
        project.killed("measure", **how),
        _measured_by(project),
    )
    if done is not None and owner == done.name:
        say(f"measure: already done in {project.shown(done)}, targets/ is there, skipped")
        return _result(project, "measure", done, skipped=True)
    if project.targets_folder.exists() and not replace and not (killed and owner == killed.name):
        raise ValueError(
            f"{project.targets_folder} holds targets from other inputs (or measured elsewhere), which are "
            "never overwritten; `twin measure --replace` keeps them as targets-0001 and measures anew"
        )
    with project.new_run("measure", **how) as run:
        keeper = Followed(run.folder)
        moved, log, gauge, join = _measure(project, table, camera, say, keeper)
        targets = make_targets(moved, log, join=join, gauge=gauge, nodes=_nodes(project))
        run.write_npz("tracks.npz", _tracks(moved))
        run.write_bytes("overlay.png", _overlay(project, table, moved))
        run.write_text("budget.csv", _budget_csv(moved, targets))
        run.summary.update(_summary(targets, moved, gauge, join) | {"headline": _headline(targets)})
        _put_aside(project, say)
        write_targets(project.targets_folder, targets, source={"run": run.name})
        keeper.remove()
    for sentence in run.summary["remarks"]:
        say(f"measure: {sentence}")
    say(f"measure: {_headline(targets)}; wrote targets/ and {project.shown(run.folder)}/tracks.npz")
    return _result(project, "measure", run.folder)


def make_targets(
    moved: "Displacements", log: Log, *, join: Join, gauge: GaugeNoise, nodes: Mapping[str, int]
) -> Targets:
    """Join displacements (film clock) with the pressure log into targets of one block on the log's clock.

    Of frames with the same time stamp the first is kept; `nodes` gives the label of every finger marker.
    What the join leaves uncertain becomes the mode "sync".
    """
    from vision.modes import sync

    keep = np.concatenate([[True], np.diff(moved.time) > 0])
    time = moved.time[keep] - moved.time[0] + join.start_s
    value, covariance = np.round(moved.value[keep], DIGITS), moved.covariance[keep]
    variance = np.diagonal(covariance, axis1=2, axis2=3)
    n = moved.noise
    noise = Noise(n.sd, n.rho, n.correlation, n.frames, n.codec_sd, gauge.sd_MPa, gauge.samples)
    clock = sync(time, moved.value[keep], join.sd_s) * np.isfinite(moved.value[keep])
    return Targets(
        time=time, pressure=np.round(log.at(time), DIGITS + 3), block=np.zeros(len(time), dtype=np.int64),
        names=moved.names, nodes=_labels(moved, nodes), points=moved.points, value=value,
        covariance=covariance, valid=np.isfinite(value) & np.isfinite(variance),
        held_out=np.zeros(len(time), dtype=bool),
        modes=np.concatenate([moved.modes[:, keep], clock[None]]), mode_names=(*moved.mode_names, "sync"),
        noise=noise, log_time=log.time,
        log_pressure=log.pressure, reference=_kept(moved.reference, keep), gravity=None,
        pressure_sd=gauge.sd_MPa * log.gain(time),
    )  # fmt: skip


def _labels(moved: "Displacements", nodes: Mapping[str, int]) -> NDArray[np.int64]:
    """Return the node of every point, 0 for a fixed marker."""
    return np.array(
        [
            nodes.get(n, MATERIAL) if role == "finger" else 0
            for n, role in zip(moved.names, moved.roles, strict=True)
        ]
    )


def _kept(indices: NDArray[Any], keep: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return where the kept of these steps stand once the others are gone."""
    new = np.cumsum(keep) - 1
    return np.array([new[i] for i in indices if keep[i]], dtype=np.int64)


# -- what the stages read ---------------------------------------------------------------------------------


def _camera_table(project: Project) -> CameraTable:
    if not project.config.cameras:
        raise ValueError("twin.toml has no [[cameras]]: there is no film to measure; targets measured "
                         "elsewhere go into targets/, and `twin calibrate` starts from them")  # fmt: skip
    return project.config.cameras[0]


def _pressure(project: Project) -> Any:
    return project.config.pressure  # a film without it is refused by the configuration


def _camera_inputs(project: Project) -> dict[str, Any]:
    tables = project.config.cameras
    if len(tables) == 1:
        return _one_camera_inputs(project, tables[0])
    each = [_one_camera_inputs(project, table) for table in tables]
    inputs = list(dict.fromkeys(path for one in each for path in one["inputs"]))
    extra = {table.name: one["extra"] for table, one in zip(tables, each, strict=True)}
    return {"tables": (), "inputs": inputs, "extra": {"rig": extra}}


def _one_camera_inputs(project: Project, table: CameraTable) -> dict[str, Any]:
    if table.camera_file is not None:
        path = project.path(table.camera_file)
        if not path.is_file():
            raise ValueError(
                f"cameras.camera_file = {table.camera_file!r}: no such file in {project.root}; copy it there "
                "or correct twin.toml"
            )
        return {"tables": (), "inputs": [path], "extra": {"name": table.name, "film": table.film}}
    board = table.board
    assert board is not None  # the configuration refuses boards without it
    extra = {"board": board.model_dump(), "max_rms_px": table.max_rms_px}
    own = dictionary_files(project, board.dictionary)
    return {"tables": (), "inputs": [*_images(project, table), *own], "extra": extra}


def _images(project: Project, table: CameraTable) -> list[Path]:
    """Return the pictures of the board."""
    images = sorted(p for p in project.root.glob(table.boards or "") if p.is_file())
    if not images:
        raise ValueError(f"cameras.boards = {table.boards!r}: no file matches in {project.root}; put the "
                         "images of the board there, or correct the glob in twin.toml")  # fmt: skip
    return images


def dictionary_name(project: Project, name: str) -> str:
    """Return a dictionary as vision takes it: OpenCV's name, or the path of a file in the project."""
    return name if name.startswith("DICT_") else str(project.path(name))


def dictionary_files(project: Project, name: str) -> list[Path]:
    """Return the file of a dictionary that is none of OpenCV's."""
    if name.startswith("DICT_"):
        return []
    if not project.path(name).is_file():
        raise ValueError(
            f"dictionary = {name!r}: no such file in {project.root}; copy it there or correct twin.toml"
        )
    return [project.path(name)]


def _camera(project: Project) -> Path:
    """Return camera.json, or rig.json of several cameras, made from the board images as they are now."""
    name = "camera.json" if len(project.config.cameras) == 1 else "rig.json"
    done = project.done("camera", **_camera_inputs(project))
    if done is None:
        older = project.newest("camera", name)
        why = f"{project.shown(older)} was made from other images or settings" if older else f"no {name} yet"
        raise ValueError(f"{why}: run `twin camera` first")
    return done / name


def _measure_inputs(project: Project, camera: Path) -> dict[str, Any]:
    recorded = [(f"cameras.{k}", getattr(t, k)) for t in project.config.cameras for k in ("film", "static")]
    named = [*recorded, ("pressure.file", _pressure(project).file)]
    for key, path in named:
        if not project.path(path).exists():
            raise ValueError(
                f"{key} = {path!r}: no such file in {project.root}; copy it there or correct twin.toml"
            )
    inputs = [project.path(path) for _, path in named]
    tables = ("cameras", "pressure", "measure", "frame", "points", "dic")
    extra = [*dictionary_files(project, _camera_table(project).dictionary), *project.deck_files()]
    return {"tables": tables, "inputs": [*inputs, camera, *extra]}


def _measured_by(project: Project) -> str | None:
    """Return the run that targets/ comes from, None if there is no targets/ or it was measured elsewhere."""
    path = project.targets_folder / "source.json"
    return files.read_json(path).get("run") if path.exists() else None


def _marks(project: Project) -> list["Mark"]:
    """Return every marker with its nominal centre: those of the frame, and the finger's at their nodes."""
    from twin.workbench import structure_of
    from vision import Mark

    marks = [Mark(m.name, m.marker, m.position_mm, m.role, m.size_mm) for m in project.config.frame.markers]
    case = None
    for point in project.config.points:
        position = point.position_mm
        if position is None:
            case = case or structure_of(project).case
            x, y, z = (float(v) for v in case.position(point.node))
            position = (x, y, z)
        assert point.size_mm is not None  # the configuration refuses a film without it
        marks.append(Mark(point.name, point.marker, position, "finger", point.size_mm))
    return marks


# -- measuring ----------------------------------------------------------------------------------------------


def _measure(
    project: Project, table: CameraTable, camera: Path, say: Say, keeper: "Followed"
) -> tuple["Displacements", Log, GaugeNoise, Join]:
    """Return displacements, log, gauge noise and join; the log is checked before the film is measured."""
    from vision import measure

    views, rig = _views(project, camera)
    film, static = views[0].film, views[0].static
    for sentence in (s for v in views for s in (*v.film.issues, *v.static.issues)):
        say(f"measure: {sentence}")
    pressure, settings = _pressure(project), project.config.measure
    log = read_log(project.path(pressure.file), time_shift_s=pressure.time_shift_s)
    time = film.time - film.time[0]
    join = _join_before(pressure, table, film, log)
    if join is not None:
        check_covers(log, time + join.start_s, what="film", key="film_start_s")
        gauge = _gauge(table, log, join, static.time - static.time[0], settings.reference_s)
    moved = measure(
        views, _marks(project), reference=settings.reference_s, rig=rig, face=_face(project),
        dictionary=dictionary_name(project, table.dictionary), stated=_stated(settings),
        steps=settings.steps, progress=say.progress, keeper=keeper,
    )  # fmt: skip
    if join is None:
        join = by_onset(moved.time - moved.time[0], *_motion(moved), log)
        gauge = _gauge(table, log, join, static.time - static.time[0], settings.reference_s)
    return moved, log, gauge, join


def _views(project: Project, camera: Path) -> tuple[list["View"], "Rig | None"]:
    """Return what every camera recorded, and how several cameras stand to each other."""
    from vision import Camera, View
    from vision.rig import Rig
    from vision.series import open_film

    tables, stored = project.config.cameras, files.read_json(camera)
    rig = Rig.from_dict(stored) if len(tables) > 1 else None
    cameras = rig.cameras if rig is not None else (Camera.from_dict(stored),)
    views = [
        View(
            open_film(project.path(t.film), fps=t.fps), open_film(project.path(t.static), fps=t.fps), own,
            t.film_start_s,
        )
        for t, own in zip(tables, cameras, strict=True)
    ]  # fmt: skip
    return views, rig


def _face(project: Project) -> "Face | None":
    """Return the speckled face, None without [dic]."""
    from vision.face import Face

    d = project.config.dic
    return None if d is None else Face(d.low_mm, d.high_mm, d.y_mm, d.step_mm, d.subset_mm)


def _join_before(pressure: Any, table: CameraTable, film: "Video", log: Log) -> Join | None:
    """Return the join, as far as it needs no displacements; None for that by the onset of motion."""
    if pressure.join == "stamps":
        return Join(table.film_start_s, pressure.sync_sd_s, "")
    if pressure.join == "onset":
        return None
    from vision.flash import flash_onset

    onset, sd = flash_onset(film, pressure.flash_region)
    return by_flash(onset - float(film.time[0]), sd, log, told_s=pressure.flash_time_s)


def _motion(moved: "Displacements") -> tuple[Array, float]:
    """Return the rms displacement (s,) mm of the finger's marks, NaN where one is lost, and its noise."""
    finger = [p for p, role in enumerate(moved.roles) if role == "finger"]
    squares = (moved.value[:, finger][..., [0, 2]] ** 2).sum(axis=2)
    seen = np.isfinite(squares).all(axis=1)
    motion = np.sqrt(np.where(seen[:, None], np.nan_to_num(squares), 0.0).mean(axis=1))
    return np.where(seen, motion, np.nan), float(np.nanmean(moved.noise.sd[finger]))


def _stated(settings: MeasureTable) -> "Stated":
    """Return how well the rig is known."""
    from vision import Stated

    return Stated(
        placement_mm=settings.placement_sd_mm, scale=settings.scale_sd, frame_mm=settings.frame_sd_mm,
        node_mm=settings.node_sd_mm, height_mm=settings.height_sd_mm,
        out_of_plane_mm=settings.out_of_plane_sd_mm,
    )  # fmt: skip


def _gauge(table: CameraTable, log: Log, join: Join, static: Array, reference_s: float) -> GaugeNoise:
    """Return the gauge noise during the static film, or in the film's first rest if its time is unknown."""
    if table.static_start_s is None:
        return gauge_noise(log, start=join.start_s, end=join.start_s + reference_s)
    time = static + table.static_start_s
    check_covers(log, time, what="static film", key="static_start_s")
    return gauge_noise(log, start=float(time[0]), end=float(time[-1]))


def _nodes(project: Project) -> dict[str, int]:
    return {point.name: point.node for point in project.config.points}


def _tracks(moved: "Displacements") -> dict[str, NDArray[Any]]:
    """Return what review draws over the film."""
    t = moved.tracks
    return {
        "time": t.time, "names": np.array(t.names, dtype=str), "position": t.position,
        "covariance": t.covariance, "rotation": t.rotation, "method": t.method,
        "homography": moved.homography,
    }  # fmt: skip


def _overlay(project: Project, table: CameraTable, moved: "Displacements") -> bytes:
    """Return the frame of the largest displacement with the marks drawn in, as PNG."""
    import cv2

    from vision.overlay import overlay
    from vision.series import open_film

    picture = overlay(open_film(project.path(table.film), fps=table.fps), moved.tracks)
    return bytes(cv2.imencode(".png", picture)[1])


def _budget_csv(moved: "Displacements", targets: Targets) -> str:
    """Return the budget as vision has it, with what the join with the log adds."""
    from vision.budget import to_csv, with_mode

    clock, seen = targets.modes[targets.mode_names.index("sync")], np.asarray(targets.valid.any(axis=2))
    return to_csv(with_mode(moved.budget, "sync", clock, seen), moved.names)


def _say_budget(path: Path, say: Say) -> dict[str, Any]:
    """Say the table in budget.csv, and return it as point -> source -> sd of u1, u2, u3 in mm."""
    from vision.budget import from_csv, lines

    table, names = from_csv(path.read_text(encoding="utf-8"))
    for line in lines(table, names):
        say(line)
    say(f"measure: the whole table, with the largest sd of each source, is in {path.parent.name}/{path.name}")
    return {
        name: dict(zip(table.sources, table.sd[:, p].tolist(), strict=True)) for p, name in enumerate(names)
    }


def _summary(targets: Targets, moved: "Displacements", gauge: GaugeNoise, join: Join) -> dict[str, Any]:
    """Return what run.json and --json tell."""
    noise = moved.noise
    return {
        "steps": len(targets.time), "points": len(targets.names), "valid": int(targets.valid.sum()),
        "static_frames": noise.frames, "gauge_sd_MPa": gauge.sd_MPa,
        "sd_mm": dict(zip(moved.names, noise.sd, strict=True)),
        "codec_sd_mm": dict(zip(moved.names, noise.codec_sd, strict=True)),
        "modes": len(targets.mode_names),
        "remarks": [*moved.lost, *moved.remarks, *filter(None, (gauge.remark, join.remark))],
    }  # fmt: skip


def _headline(targets: Targets) -> str:
    """Return the one line that says what was measured."""
    finger = ~targets.fixed
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3)[targets.valid]
    peak = np.nanmax(np.abs(targets.value[:, finger]))
    return (f"{int(finger.sum())} points and {int(targets.fixed.sum())} fixed markers in "
            f"{len(targets.time)} frames, up to {peak:.1f} mm, sd {np.sqrt(np.median(variance)):.3f} "
            "mm")  # fmt: skip


def _put_aside(project: Project, say: Say) -> None:
    """Keep targets that are there under the next free name."""
    folder = project.targets_folder
    if not folder.exists():
        return
    number = 1
    while (kept := folder.with_name(f"targets-{number:04d}")).exists():
        number += 1
    os.rename(folder, kept)
    say(f"measure: the targets that were there are kept as {kept.name}")


def _result(project: Project, stage: str, folder: Path, *, skipped: bool = False) -> dict[str, Any]:
    """Return what --json prints."""
    summary = project.info(folder).get("summary", {})
    return {
        "stage": stage,
        "status": "skipped" if skipped else "done",
        "run": project.shown(folder),
    } | summary
