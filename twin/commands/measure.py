"""Turn film, static film and pressure log, or a file of another program, into displacement targets."""

import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from typer import Option

from twin import files
from twin.gauge.agreement import check_agrees
from twin.gauge.clockfit import check_clock
from twin.gauge.pressurelog import GaugeNoise, Log
from twin.gauge.synchrony import Join, Motion
from twin.inputs.cameras import camera_path, camera_table, dictionary_name, lens_of, result_of
from twin.inputs.elsewhere import import_inputs, import_targets
from twin.inputs.films import FILM, FilmTargets, OneFilm, all_inputs, films_of, joined
from twin.inputs.filmsteps import room, said_of_steps
from twin.inputs.filmtargets import make_targets, read_late, said_of_log_rate, said_of_readout
from twin.inputs.outlines import SeenOutline, outline_tells, seen_outline
from twin.inputs.recordings import (
    face_of,
    gauge_of,
    log_of,
    marks_of,
    measure_inputs,
    pressure_table,
    said_of_log,
    stated_of,
    views_of,
)
from twin.inputs.synchronisation import joining_of
from twin.judging.scatter import with_own_coding
from twin.messages import Say
from twin.project.folder import Project, Run
from twin.project.record import SourceFilm, SourceRecord
from twin.project.targetfiles import read_targets, write_targets
from twin.targets import Targets

if TYPE_CHECKING:  # vision takes a second to import: only the stages that measure pay for it
    from vision import Displacements, Video, View

STRAIN_STEPS = 20  # times of the strain field that ParaView gets, evenly
STRAIN_SHOWN = 300  # those that the review shows


@dataclass(frozen=True)
class FollowedFiles:
    """Tracks followed so far, as files in a run's folder: a killed run goes on from there."""

    folder: Path

    def load(self, name: str) -> dict[str, NDArray[Any]] | None:
        """The arrays kept under a name, None without any."""
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


@dataclass(frozen=True)
class _Measured:
    """Displacements, pressure log and their synchronisation."""

    film: "Video"  # of the first camera
    moved: "Displacements"
    log: Log
    gauge: GaugeNoise
    join: Join
    remarks: tuple[str, ...]  # on the log, and on how the motion goes with it
    outline: SeenOutline | None  # of the finger at rest


def run_measure(
    project: Project,
    say: Say,
    *,
    replace: Annotated[bool, Option(
        "--replace", "--again", help="measure anew; the targets that are there become targets-0001")] = False,
    budget: Annotated[bool, Option(
        "--budget", help="print what the uncertainty of each marker consists of")] = False,
    renew: bool = False,
) -> dict[str, Any]:
    """The film's displacements, written to targets/, unless that is done.

    ValueError where targets from other inputs are there. With `renew` these become targets-0001, -0002, ...
    """
    result = _measured(project, say, replace, renew)
    if budget and project.config.imports:
        raise ValueError(
            "--budget: the targets come from another program's file, which does not say what its error is "
            "made of; leave it out"
        )
    if budget:
        result["budget"] = _say_budget(project.path(result["run"]) / "budget.csv", say)
        for sentence in result.get("coding", []):
            say(sentence)
    return result


def _measured(project: Project, say: Say, replace: bool, renew: bool) -> dict[str, Any]:
    foreign = bool(project.config.imports)
    camera = Path() if foreign else camera_path(project)
    how = import_inputs(project) if foreign else all_inputs(project, camera)
    (done, why), killed = project.compared("measure", **how), project.killed("measure", **how)
    owner = project.source().run
    there = done is not None and not why and owner == done.name
    if done is not None and there and not replace:
        made = project.other_versions(done).replace("holds.", "holds; `twin measure --again` measures anew.")
        say(f"Already done in {project.shown(done)}, and targets/ is there: skipped. {made}".rstrip())
        return result_of(project, "measure", done, skipped=True)
    if project.targets_folder.exists() and not (replace or renew) and not (killed and owner == killed.name):
        raise ValueError(
            f"{project.targets_folder} holds targets {_not_of_now(done, why, owner)}, which are never "
            "overwritten; `twin measure --replace` keeps them as targets-0001 and measures again"
        )
    films = films_of(project)
    each = [(film, _one_film(film, len(films), camera, say, anew=there)) for film in films]
    with project.new_run("measure", **how) as run:
        source = SourceRecord(run=run.name)
        if foreign:
            targets, sources = _from_foreign(project, say, run)
            source = SourceRecord(run=run.name, films=sources)
        elif each:
            targets, sources = _joint(project, run, each)
            source = SourceRecord(run=run.name, films=sources)
        else:
            targets = _from_film(project, camera, say, run)
        _put_aside(project, say)
        write_targets(project.targets_folder, targets, source=source)
        FollowedFiles(run.folder).remove()
    for sentence in run.summary["remarks"]:
        say(sentence)
    tracks = "" if foreign else f" and {project.shown(run.folder)}/tracks.npz"
    say(f"{_headline(targets)} Wrote targets/{tracks}.")
    return result_of(project, "measure", run.folder)


def _not_of_now(newest: Path | None, why: Sequence[str], owner: str | None) -> str:
    """The reason why targets are not those that would be measured now."""
    if newest is None or owner != newest.name:
        return f"of {owner}" if owner else "measured elsewhere"
    return f"of {owner}, since which this is no more: {why[0]}"


def _from_foreign(project: Project, say: Say, run: Run) -> tuple[Targets, tuple[SourceFilm, ...]]:
    """The targets of another program's recordings, and where several come from."""
    targets, rows = import_targets(project, say)
    run.summary.update(_counts(targets) | {"remarks": [*said_of_log_rate(targets)]})
    return targets, tuple(row.model_copy(update={"run": run.name}) for row in rows)


def _from_film(project: Project, camera: Path, say: Say, run: Run, *, films: int = 1) -> Targets:
    """The targets of one of so many films; tracks, error budget and summary are written into the run."""
    measured = _measure(project, camera, say, run, films)
    moved, nodes, readout_ms = measured.moved, project.config.nodes, camera_table(project).readout_ms
    late = read_late(moved, measured.film, readout_ms)
    targets, scattered = with_own_coding(
        make_targets(moved, measured.log, join=measured.join, gauge=measured.gauge, nodes=nodes, late=late)
    )
    run.write_npz("tracks.npz", _tracks(moved))
    run.write_bytes("overlay.png", _overlay(project, moved))
    run.write_text("budget.csv", _budget_csv(moved, targets))
    _write_strain(run, moved, lens_of(project, camera_table(project)).size)
    kept = said_of_steps(moved, stated=project.config.measure.steps is not None)
    remarks = (*kept, *said_of_readout(targets, readout_ms), *said_of_log_rate(targets))
    run.summary.update(_summary(targets, measured, remarks))
    run.summary["coding"] = [*moved.coding, *filter(None, [scattered])]
    for sentence in (*moved.notes, *run.summary["coding"]):
        run.note(sentence)
    _check_motion(project, targets)
    return targets


def _one_film(film: OneFilm, films: int, camera: Path, say: Say, *, anew: bool) -> Path:
    """Run folder of the measurement of a film of several; an earlier one serves unless `anew`."""
    project, name = film.project, film.name
    how = measure_inputs(project, camera)
    done = None if anew else project.done(FILM, **how)
    if done is not None and (done / "targets").is_dir():
        say(f"Film {name}: already measured in {project.shown(done)}.")
        return done
    with project.new_run(FILM, **how) as run:
        targets = _from_film(project, camera, say, run, films=films)
        if run.path("targets").exists():  # of a killed run
            shutil.rmtree(run.path("targets"))
        write_targets(run.path("targets"), targets)
        FollowedFiles(run.folder).remove()
    for sentence in run.summary["remarks"]:
        say(f"Film {name}: {sentence}")
    say(f"Film {name}: {_headline(targets)}")
    return run.folder


def _joint(
    project: Project, run: Run, each: Sequence[tuple[OneFilm, Path]]
) -> tuple[Targets, tuple[SourceFilm, ...]]:
    """The targets of all films, and where they come from; the pictures of the first are in this run too."""
    films = [FilmTargets.of(film, read_targets(folder / "targets", nodes=project.config.nodes))
             for film, folder in each]  # fmt: skip
    targets, rows = joined(films)
    first_folder = each[0][1]
    run.write_npz("tracks.npz", files.read_npz(first_folder / "tracks.npz"))
    run.write_bytes("overlay.png", (first_folder / "overlay.png").read_bytes())
    run.write_text("budget.csv", (first_folder / "budget.csv").read_text(encoding="utf-8"))
    if (first_folder / "strain.npz").is_file():
        run.write_npz("strain.npz", files.read_npz(first_folder / "strain.npz"))
    summaries = [files.plain(project.info(folder).summary) for _, folder in each]
    sources = tuple(
        row.model_copy(update={"run": folder.name}) for row, (_, folder) in zip(rows, each, strict=True)
    )
    films = [files.plain(row) | summary for row, summary in zip(sources, summaries, strict=True)]
    run.summary.update(_counts(targets) | {"remarks": [], "films": films})
    return targets, sources


def _check_motion(project: Project, targets: Targets) -> None:
    """Raise ValueError where the film does not show this finger under this pressure."""
    from twin.bench.workbench import check_plausible, structure_of

    check_plausible(project, targets, structure_of(project).case)


def _measure(project: Project, camera: Path, say: Say, run: Run, films: int) -> _Measured:
    """Displacements, log, gauge noise and join; the log is checked before the film is measured."""
    from vision import measure

    views, rig = views_of(project, camera)
    table, settings = camera_table(project), project.config.measure
    for sentence in (s for v in views for s in (*v.film.issues, *v.static.issues)):
        say(sentence)
    pressure = pressure_table(project)
    log = log_of(project, pressure)
    outline = _outline(project, views, run)
    pose = errors = None
    if outline is not None and outline_tells(project):
        pose, errors = outline.found.pose, outline.errors

    @cache
    def moved() -> "Displacements":
        return measure(
            views, marks_of(project, pose), reference=settings.reference_s, rig=rig, face=face_of(project),
            dictionary=dictionary_name(project, table.dictionary), stated=stated_of(project, errors),
            steps=settings.steps or room(films), progress=say.progress, keeper=FollowedFiles(run.folder),
        )  # fmt: skip

    joining = joining_of(pressure, table)
    join = joining.join(views[0].film, log, lambda: _motion(moved()))
    gauge = gauge_of(project, views[0].film.time, views[0].static.time, log, join.start_s)
    log_remarks = said_of_log(project, views[0].film.time, log, join.start_s)
    motion = _motion(moved())
    agrees = check_agrees(motion, log, join.start_s, stated=pressure.join == "stamps")
    late, note = check_clock(motion, log, join, by=pressure.join)
    run.note(note)
    return _Measured(views[0].film, moved(), log, gauge, join, (*log_remarks, *(agrees or late)), outline)


def _outline(project: Project, views: "Sequence[View]", run: Run) -> SeenOutline | None:
    """What the outline of the finger at rest tells, drawn into the run; None where it tells nothing.
    ValueError where it is to tell the pose."""
    if len(views) > 1:
        return None
    try:
        outline = seen_outline(project, camera_table(project), views[0].film, views[0].camera)
    except ValueError as error:
        if outline_tells(project):
            raise
        run.note(f"The outline is not compared with the model: {error}.")
        return None
    run.write_bytes("outline.png", outline.drawn())
    for sentence in outline.told:
        run.note(sentence)
    return outline


def _even(moved: "Displacements") -> NDArray[np.bool_]:
    """Mask (s,) of the evenly spaced steps: without the dense frames of the reference, which would make the
    scatter of the others look correlated."""
    from vision.placing.views import even_steps

    frames = np.searchsorted(moved.tracks.time, moved.time)
    return np.isin(frames, even_steps(len(moved.tracks.time), moved.most_steps))


def _motion(moved: "Displacements") -> Motion:
    """The rms displacement of the finger's marks at even steps, NaN where one is lost, and its noise."""
    finger = [p for p, role in enumerate(moved.roles) if role == "finger"]
    squares = (moved.value[:, finger][..., [0, 2]] ** 2).sum(axis=2)
    seen = np.isfinite(squares).all(axis=1)
    mm = np.sqrt(np.where(seen[:, None], np.nan_to_num(squares), 0.0).mean(axis=1))
    even = _even(moved)
    return Motion(
        (moved.time - moved.time[0])[even],
        np.where(seen, mm, np.nan)[even],
        float(np.nanmean(moved.noise.sd[finger])),
    )


def _tracks(moved: "Displacements") -> dict[str, NDArray[Any]]:
    """Tracks for the review, px; `methods` names the codes of `method`."""
    from vision.following.tracks import Method

    t = moved.tracks
    return {
        "time": t.time, "names": np.array(t.names, dtype=str), "position": t.position,
        "covariance": t.covariance, "rotation": t.rotation, "method": t.method,
        "homography": moved.homography, "methods": np.array([m.name.lower() for m in Method], dtype=str),
    }  # fmt: skip


def _write_strain(run: Run, moved: "Displacements", size: tuple[int, int]) -> None:
    """strain.csv, strain.npz for the review, and strain.pvd for ParaView with STRAIN_STEPS files, where a
    speckled face was measured.   size: of the film, px."""
    field = moved.strain
    if field is None:
        return
    from twin.drawing.deformed import write_vtu_series
    from twin.review.states import Strains
    from vision.measuring.strains import COMPONENTS, quads, to_csv
    from vision.placing.views import even_steps

    run.write_text("strain.csv", to_csv(field))
    steps_shown = even_steps(len(field.time), STRAIN_SHOWN)
    t, frames = moved.tracks, np.searchsorted(moved.tracks.time, field.time[steps_shown])
    pixel = t.position[frames][:, [t.names.index(name) for name in field.names]]
    Strains(
        time_s=field.time[steps_shown] - field.time[0], components=COMPONENTS, names=field.names, size=size,
        pixel=pixel, value=field.value[steps_shown], sd=field.sd[steps_shown],
    ).save(run.path("strain.npz"))  # fmt: skip
    cells = quads(field.points)
    if not len(cells):
        return
    rows = [moved.names.index(name) for name in field.names]
    steps = even_steps(len(field.time), STRAIN_STEPS)
    parts = {name: field.value[steps][..., k] for k, name in enumerate(COMPONENTS)}
    sds = {f"sd_{name}": field.sd[steps][..., k] for k, name in enumerate(COMPONENTS)}
    moves = np.nan_to_num(moved.value[steps][:, rows])
    write_vtu_series(
        run.folder, "strain", nodes=field.points, cells=cells, times=list(field.time[steps]),
        fields={"U": moves, **parts, **sds},
    )  # fmt: skip


def _overlay(project: Project, moved: "Displacements") -> bytes:
    """The frame of the largest displacement with the marks drawn in, as PNG."""
    import cv2

    from vision.drawing.overlays import overlay
    from vision.film.series import open_film

    table = camera_table(project)
    film = open_film(project.path(table.film), fps=table.fps, mirrored=table.mirrored)
    return bytes(cv2.imencode(".png", overlay(film, moved.tracks))[1])


def _budget_csv(moved: "Displacements", targets: Targets) -> str:
    """The budget as vision has it, with what clock and shutter add."""
    from vision.errors.errorbudget import to_csv, with_mode

    table, seen = moved.budget, np.asarray(targets.valid.any(axis=2))
    for k in range(len(moved.mode_names), len(targets.mode_names)):
        table = with_mode(table, targets.mode_names[k], targets.modes[k], seen)
    return to_csv(table, moved.names)


def _say_budget(path: Path, say: Say) -> dict[str, Any]:
    """Say the table in budget.csv, and return it as point -> source -> sd of u1, u2, u3 in mm."""
    from vision.errors.errorbudget import from_csv, lines

    table, names = from_csv(path.read_text(encoding="utf-8"))
    for line in lines(table, names):
        say(line)
    say(f"The whole table, with the largest sd of each source: {path.parent.name}/{path.name}.")
    return {
        name: dict(zip(table.sources, table.sd[:, p].tolist(), strict=True)) for p, name in enumerate(names)
    }


def _counts(targets: Targets) -> dict[str, Any]:
    """Numbers of steps, points and values, and the headline."""
    return {
        "steps": len(targets.time), "points": len(targets.names), "valid": int(targets.valid.sum()),
        "modes": len(targets.mode_names), "headline": _headline(targets),
    }  # fmt: skip


def _summary(targets: Targets, measured: _Measured, remarks: tuple[str, ...]) -> dict[str, Any]:
    """Summary for run.json and --json.   remarks: further sentences."""
    moved, gauge, noise = measured.moved, measured.gauge, measured.moved.noise
    return _counts(targets) | {
        "static_frames": noise.frames, "gauge_sd_MPa": gauge.sd_MPa,
        "sd_mm": dict(zip(moved.names, noise.sd, strict=True)),
        "codec_sd_mm": dict(zip(moved.names, noise.codec_sd, strict=True)),
        "remarks": [
            *moved.lost, *moved.remarks, *filter(None, (gauge.remark, measured.join.remark)),
            *measured.remarks, *remarks, *(measured.outline.wrong if measured.outline else ()),
        ],
        **({"outline": measured.outline.summary} if measured.outline else {}),
    }  # fmt: skip


def _headline(targets: Targets) -> str:
    """A sentence on size and noise of the displacements."""
    finger, fixed = int((~targets.fixed).sum()), int(targets.fixed.sum())
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3)[targets.valid]
    peak = np.nanmax(np.abs(targets.value[:, ~targets.fixed]))
    return (
        f"{finger} points and {fixed} fixed markers in {len(targets.time)} frames: displacements up to "
        f"{peak:.1f} mm, with a noise of {np.sqrt(np.median(variance)):.3f} mm (1 sd)."
    )


def _put_aside(project: Project, say: Say) -> None:
    """Keep targets that are there under the next free name."""
    folder = project.targets_folder
    if not folder.exists():
        return
    number = 1
    while (former := folder.with_name(f"targets-{number:04d}")).exists():
        number += 1
    os.rename(folder, former)
    say(f"The former targets are kept as {former.name}.")
