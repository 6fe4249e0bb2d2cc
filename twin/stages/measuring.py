"""Turn film, static film and pressure log into displacement targets."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin.gauge.joining import Join, by_flash, by_onset
from twin.gauge.pressurelog import GaugeNoise, Log, check_covers, gauge_noise, read_log
from twin.project import files
from twin.project.config import CameraTable, MeasureTable
from twin.project.folder import Project, Say
from twin.project.targetfiles import write_targets
from twin.stages.cameras import camera_path, camera_table, dictionary_files, dictionary_name, result_of
from twin.targets import Array, Noise, PointKind, TargetPoint, Targets, as_position, at_node

if TYPE_CHECKING:  # vision takes a second to import: only the stages that measure pay for it
    from vision import Displacements, Mark, Stated, Video, View
    from vision.calibration.rig import Rig
    from vision.kinds.markkind import MarkKind
    from vision.measuring.face import Face

DIGITS = 6  # of mm: a nanometre, far below any sd, keeps targets.csv readable


@dataclass(frozen=True)
class FollowedFiles:
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
    table = camera_table(project)
    camera = camera_path(project)
    how = _measure_inputs(project, camera)
    done, killed, owner = (
        project.done("measure", **how),
        project.killed("measure", **how),
        _measured_by(project),
    )
    if done is not None and owner == done.name:
        say(f"measure: already done in {project.shown(done)}, targets/ is there, skipped")
        return result_of(project, "measure", done, skipped=True)
    if project.targets_folder.exists() and not replace and not (killed and owner == killed.name):
        raise ValueError(
            f"{project.targets_folder} holds targets from other inputs (or measured elsewhere), which are "
            "never overwritten; `twin measure --replace` keeps them as targets-0001 and measures anew"
        )
    with project.new_run("measure", **how) as run:
        keeper = FollowedFiles(run.folder)
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
    return result_of(project, "measure", run.folder)


def make_targets(
    moved: "Displacements", log: Log, *, join: Join, gauge: GaugeNoise, nodes: Mapping[str, int]
) -> Targets:
    """Join displacements (film clock) with the pressure log into targets of one block on the log's clock.

    Of frames with the same time stamp the first is kept; `nodes` gives the label of every finger marker.
    What the join leaves uncertain becomes the mode "sync".
    """
    from vision.errors.modes import sync

    keep = np.concatenate([[True], np.diff(moved.time) > 0])
    time = moved.time[keep] - moved.time[0] + join.start_s
    value, covariance = np.round(moved.value[keep], DIGITS), moved.covariance[keep]
    variance = np.diagonal(covariance, axis1=2, axis2=3)
    n = moved.noise
    noise = Noise(
        sd=n.sd, rho=n.rho, correlation=n.correlation, frames=n.frames, codec_sd=n.codec_sd,
        gauge_sd_MPa=gauge.sd_MPa, gauge_frames=gauge.samples,
    )  # fmt: skip
    clock = sync(time, moved.value[keep], join.sd_s) * np.isfinite(moved.value[keep])
    return Targets(
        time=time, pressure=np.round(log.at(time), DIGITS + 3), block=np.zeros(len(time), dtype=np.int64),
        points=_target_points(moved, nodes), value=value, covariance=covariance,
        valid=np.isfinite(value) & np.isfinite(variance), held_out=np.zeros(len(time), dtype=bool),
        modes=np.concatenate([moved.modes[:, keep], clock[None]]), mode_names=(*moved.mode_names, "sync"),
        noise=noise, log_time=log.time,
        log_pressure=log.pressure, reference=_kept(moved.reference, keep), gravity=None,
        pressure_sd=gauge.sd_MPa * log.gain(time),
    )  # fmt: skip


def _target_points(moved: "Displacements", nodes: Mapping[str, int]) -> tuple[TargetPoint, ...]:
    """The target point of every measured one: at its node, at its place on the face, or fixed."""
    rows = zip(moved.names, moved.roles, moved.points, strict=True)
    return tuple(_target_point(name, role, as_position(own), nodes.get(name)) for name, role, own in rows)


def _target_point(
    name: str, role: str, position: tuple[float, float, float] | None, node: int | None
) -> TargetPoint:
    if role != "finger":
        return TargetPoint(name, PointKind.FIXED, None, position)
    if node is None:
        return TargetPoint(name, PointKind.PLACE, None, position)
    return at_node(name, node, position)


def _kept(indices: NDArray[Any], keep: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return where the kept of these steps stand once the others are gone."""
    new = np.cumsum(keep) - 1
    return np.array([new[i] for i in indices if keep[i]], dtype=np.int64)


# -- what the stages read ---------------------------------------------------------------------------------


def _pressure(project: Project) -> Any:
    return project.config.pressure  # a film without it is refused by the configuration


def _measure_inputs(project: Project, camera: Path) -> dict[str, Any]:
    recorded = [(f"cameras.{k}", getattr(t, k)) for t in project.config.cameras for k in ("film", "static")]
    named = [*recorded, ("pressure.file", _pressure(project).file)]
    inputs = [path for key, told in named for path in _recorded(project, key, told)]
    tables = ("cameras", "pressure", "measure", "frame", "points", "dic")
    extra = [*dictionary_files(project, camera_table(project).dictionary), *project.deck_files()]
    return {"tables": tables, "inputs": [*inputs, camera, *extra]}


def _recorded(project: Project, key: str, told: str) -> list[Path]:
    """Return the file, the folder, or the pictures of a pattern, with their times, that twin.toml names;
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


def _measured_by(project: Project) -> str | None:
    """Return the run that targets/ comes from, None if there is no targets/ or it was measured elsewhere."""
    path = project.targets_folder / "source.json"
    return files.read_json(path).get("run") if path.exists() else None


def _marks(project: Project) -> list["Mark"]:
    """Return every marker with its nominal centre: those of the frame, and the finger's at their nodes."""
    from twin.stages.workbench import structure_of
    from vision import Mark

    marks = [
        Mark(m.name, mark_kind(m.marker, m.size_mm), m.position_mm, m.role)
        for m in project.config.frame.markers
    ]
    case = None
    for point in project.config.points:
        position = point.position_mm
        if position is None:
            case = case or structure_of(project).case
            x, y, z = (float(v) for v in case.position(point.node))
            position = (x, y, z)
        assert point.size_mm is not None  # the configuration refuses a film without it
        marks.append(Mark(point.name, mark_kind(point.marker, point.size_mm), position, "finger"))
    return marks


def mark_kind(marker: int | None, size_mm: float) -> "MarkKind":
    """Return what is glued, as twin.toml states it: a marker by its id, or a dot without one."""
    from vision.kinds.coded import CodedMarker
    from vision.kinds.plaindot import PlainDot

    return PlainDot(size_mm) if marker is None else CodedMarker(marker, size_mm)


# -- measuring ----------------------------------------------------------------------------------------------


def _measure(
    project: Project, table: CameraTable, camera: Path, say: Say, keeper: "FollowedFiles"
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
        even = _even(moved, settings.steps)
        motion, noise_mm = _motion(moved)
        join = by_onset((moved.time - moved.time[0])[even], motion[even], noise_mm, log)
        gauge = _gauge(table, log, join, static.time - static.time[0], settings.reference_s)
    return moved, log, gauge, join


def _views(project: Project, camera: Path) -> tuple[list["View"], "Rig | None"]:
    """Return what every camera recorded, and how several cameras stand to each other."""
    from vision import Camera, View
    from vision.calibration.rig import Rig
    from vision.film.series import open_film

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
    from vision.measuring.face import Face

    d = project.config.dic
    return None if d is None else Face(d.low_mm, d.high_mm, d.y_mm, d.step_mm, d.subset_mm)


def _join_before(pressure: Any, table: CameraTable, film: "Video", log: Log) -> Join | None:
    """Return the join, as far as it needs no displacements; None for that by the onset of motion."""
    if pressure.join == "stamps":
        return Join(table.film_start_s, pressure.sync_sd_s, "")
    if pressure.join == "onset":
        return None
    from vision.film.flash import flash_onset

    onset, sd = flash_onset(film, pressure.flash_region)
    return by_flash(onset - float(film.time[0]), sd, log, told_s=pressure.flash_time_s)


def _even(moved: "Displacements", most: int) -> NDArray[np.bool_]:
    """Return which steps (s,) are evenly spaced: those of a longer film without the rest of its reference,
    whose density would make the scatter of the others look correlated."""
    from vision.placing.views import even_steps

    frames = np.searchsorted(moved.tracks.time, moved.time)
    return np.isin(frames, even_steps(len(moved.tracks.time), most))


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
    """Return what review draws over the film; `methods` names the codes of `method`."""
    from vision.following.methods import Method

    t = moved.tracks
    return {
        "time": t.time, "names": np.array(t.names, dtype=str), "position": t.position,
        "covariance": t.covariance, "rotation": t.rotation, "method": t.method,
        "homography": moved.homography, "methods": np.array([m.name.lower() for m in Method], dtype=str),
    }  # fmt: skip


def _overlay(project: Project, table: CameraTable, moved: "Displacements") -> bytes:
    """Return the frame of the largest displacement with the marks drawn in, as PNG."""
    import cv2

    from vision.drawing.overlays import overlay
    from vision.film.series import open_film

    picture = overlay(open_film(project.path(table.film), fps=table.fps), moved.tracks)
    return bytes(cv2.imencode(".png", picture)[1])


def _budget_csv(moved: "Displacements", targets: Targets) -> str:
    """Return the budget as vision has it, with what the join with the log adds."""
    from vision.errors.budgeting import to_csv, with_mode

    clock, seen = targets.modes[targets.mode_names.index("sync")], np.asarray(targets.valid.any(axis=2))
    return to_csv(with_mode(moved.budget, "sync", clock, seen), moved.names)


def _say_budget(path: Path, say: Say) -> dict[str, Any]:
    """Say the table in budget.csv, and return it as point -> source -> sd of u1, u2, u3 in mm."""
    from vision.errors.budgeting import from_csv, lines

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
