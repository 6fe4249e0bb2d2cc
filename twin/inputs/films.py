"""The films of a batch: each as a project of its own film, and their targets put together, a block a film."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from twin.inputs.recordings import measure_inputs
from twin.project.cameratables import FilmTable
from twin.project.folder import Project
from twin.project.record import SourceFilm
from twin.project.targetschema import shares_by_surface
from twin.targets import Array, Targets, least_known

FILM = "film"  # the kind of the runs that measure one of several films
BETWEEN_S = 600.0  # s from the end of one pressure log to the film of the next: the finger rests meanwhile
RIG = ("scale", "placement", "node", "height", "out_of_plane")  # errors that all films of a rig share


@dataclass(frozen=True)
class OneFilm:
    """One of several films: its table, and the project with this film as its only one."""

    table: FilmTable
    project: Project

    @property
    def name(self) -> str:
        """The name of the film."""
        return self.table.name

    @property
    def log(self) -> str:
        """The file of its pressure log."""
        assert self.project.config.pressure is not None  # the configuration refuses a film without it
        return self.project.config.pressure.file


def films_of(project: Project) -> list[OneFilm]:
    """The films of [[films]] in their order; none where the camera names its one film."""
    return [OneFilm(table, _alone(project, table)) for table in project.config.films]


def _alone(project: Project, film: FilmTable) -> Project:
    """The project with one film as its only one."""
    config = project.config
    pressure = config.pressure
    assert pressure is not None  # the configuration refuses a film without it
    camera = config.cameras[0]
    film_camera = {
        "film": film.file, "static": film.static or camera.static, "film_start_s": film.film_start_s,
        "static_start_s": film.static_start_s,
    }  # fmt: skip
    log = pressure  # what the regulator was set to is said of this log alone
    if film.pressure is not None:
        log = pressure.model_copy(update={"file": film.pressure, "top_kPa": None})
    camera = camera.model_copy(update=film_camera)
    changed = {"films": (), "cameras": (camera,), "pressure": log}
    return replace(project, config=config.model_copy(update=changed))


def all_inputs(project: Project, camera: Path) -> dict[str, Any]:
    """Tables and files that a run of `measure` depends on, over all films."""
    films = films_of(project)
    if not films:
        return measure_inputs(project, camera)
    each = [measure_inputs(film.project, camera) for film in films]
    inputs = list(dict.fromkeys(path for keys in each for path in keys["inputs"]))
    return {"tables": (*each[0]["tables"], "films"), "inputs": inputs}


@dataclass(frozen=True, kw_only=True)
class FilmTargets:
    """Targets of a single film on the clock of its log, with its table of twin.toml."""

    name: str
    log: str  # file of the pressure log: films of one log have one clock
    targets: Targets
    held_out: bool = False
    gravity: tuple[float, float, float] | None = None
    shares: Mapping[str, float] = field(default_factory=dict)  # of the pressure, by surface

    @staticmethod
    def of(film: OneFilm, targets: Targets) -> "FilmTargets":
        """The targets of a measured film."""
        table = film.table
        return FilmTargets(
            name=film.name, log=film.log, targets=targets, held_out=table.held_out, gravity=table.gravity,
            shares=table.pressure_shares,
        )  # fmt: skip


def joined(films: Sequence[FilmTargets]) -> tuple[Targets, list[SourceFilm]]:
    """The targets of all films, one block each in the order of time, and a row a film.

    Films of one log keep its clock. The clock of another log begins BETWEEN_S after the end of the one
    before; the finger is taken to have rested without pressure meanwhile. Displacements of a film are
    relative to its own rest. Errors of the rig (RIG) are the same in all films, all others are each film's
    own. ValueError where films of one log overlap, or have other points.
    """
    shifts = _shifts(films)
    order = sorted(range(len(films)), key=lambda k: float(films[k].targets.time[0]) + shifts[k])
    moved = [_later(films[k].targets, shifts[k]) for k in order]
    named = [films[k] for k in order]
    _check_apart(named, moved)
    block = {films[k].name: b for b, k in enumerate(order)}
    rows = [
        SourceFilm(name=film.name, block=block[film.name], held_out=film.held_out, shift_s=shift)
        for film, shift in zip(films, shifts, strict=True)
    ]
    return _together(named, moved), rows


def _shifts(films: Sequence[FilmTargets]) -> list[float]:
    """Shift of each film's clock, s; 0 for films of the first log."""
    shift: dict[str, float] = {}
    end = 0.0
    for log in dict.fromkeys(film.log for film in films):
        of_log = [film.targets for film in films if film.log == log]
        begin = min(float(t.log_time[0]) for t in of_log)
        shift[log] = end + BETWEEN_S - begin if shift else 0.0
        end = max(float(t.log_time[-1]) for t in of_log) + shift[log]
    return [shift[film.log] for film in films]


def _later(targets: Targets, shift: float) -> Targets:
    """Targets whose clock is shifted, s."""
    return replace(targets, time=targets.time + shift, log_time=targets.log_time + shift)


def _check_apart(films: Sequence[FilmTargets], moved: Sequence[Targets]) -> None:
    for (a, before), (b, after) in zip(
        zip(films, moved, strict=True), list(zip(films, moved, strict=True))[1:], strict=False
    ):
        if after.time[0] <= before.time[-1]:
            raise ValueError(
                f"films {a.name!r} and {b.name!r} overlap on the clock of {a.log}: the first ends at "
                f"{before.time[-1]:.3f} s, the second begins at {after.time[0]:.3f} s; correct film_start_s "
                "(start_s of [[import]]), or name a log for each"
            )
        if before.points != after.points:
            raise ValueError(
                f"films {a.name!r} and {b.name!r} have different points; wanted the same markers in all films"
            )


def _together(films: Sequence[FilmTargets], moved: Sequence[Targets]) -> Targets:
    """One set of targets, a block a film."""
    sizes = [len(t.time) for t in moved]
    begins = np.cumsum([0, *sizes[:-1]])
    log_time, log_pressure = _log(moved)
    noises = [t.noise for t in moved if t.noise is not None]
    modes, names = _modes(films, moved)
    stacked: dict[str, Any] = {
        name: np.concatenate([getattr(t, name) for t in moved])
        for name in ("time", "pressure", "value", "covariance", "valid", "pressure_sd")
    }
    ways = [film.gravity for film in films if film.gravity is not None]
    return Targets(
        **stacked, points=moved[0].points, modes=modes, mode_names=names,
        block=np.repeat(np.arange(len(films), dtype=np.int64), sizes),
        held_out=np.repeat([film.held_out for film in films], sizes),
        noise=least_known(noises), noises=tuple(noises) if len(films) > 1 else (),
        log_time=log_time, log_pressure=log_pressure,
        reference=np.concatenate([t.reference + b for t, b in zip(moved, begins, strict=True)]),
        gravity=np.array(ways) / np.linalg.norm(ways, axis=1, keepdims=True) if ways else None,
        shares=shares_by_surface({film.name: film.shares for film in films}),
    )  # fmt: skip


def _log(moved: Sequence[Targets]) -> tuple[Array, Array]:
    """The log's times (t,) s and pressures (t,) MPa over all films: those of one log hold the same. Where the
    course of one is not known, none counts."""
    if not all(t.has_log for t in moved):
        return np.concatenate([t.time for t in moved]), np.concatenate([t.pressure for t in moved])
    time, pressure = moved[0].log_time, moved[0].log_pressure
    for t in moved[1:]:
        new = t.log_time > time[-1]
        time, pressure = (
            np.concatenate([old, later[new]])
            for old, later in ((time, t.log_time), (pressure, t.log_pressure))
        )
    return time, pressure


def _modes(films: Sequence[FilmTargets], moved: Sequence[Targets]) -> tuple[Array, tuple[str, ...]]:
    """The errors (k, s, p, 3) mm that many values share, and their names: those of the rig once for all
    films, all others once a film, whose name they carry."""
    size = (sum(len(t.time) for t in moved), *moved[0].value.shape[1:])
    modes: dict[str, Array] = {}
    begin = 0
    for film, t in zip(films, moved, strict=True):
        end = begin + len(t.time)
        for name, mode in zip(t.mode_names, t.modes, strict=True):
            shared = name.partition(":")[0] in RIG or len(films) == 1
            mode_name = name if shared else f"{name}@{film.name}"
            modes.setdefault(mode_name, np.zeros(size))[begin:end] = mode
        begin = end
    return np.array(list(modes.values())).reshape(-1, *size), tuple(modes)
