"""Check that a project is complete and right, and name the next command."""

import shlex
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from twin.batches.former import camera_kept
from twin.bench.fits import fresh, named_effects
from twin.chain import STAGES, TARGETS, Stage, When
from twin.coupons.pulltest import pull_tests
from twin.gauge.pressurelog import Log
from twin.inputs.elsewhere import import_targets, said_of_targets
from twin.inputs.films import OneFilm, films_of
from twin.messages import Say
from twin.project.cameratables import CameraTable
from twin.project.config import EMBEDDED
from twin.project.folder import Project
from twin.project.framesheet import said_of_sheet
from twin.targets import PointKind, TargetPoint, Targets

if TYPE_CHECKING:
    from fe import Case


def run_check(project: Project, say: Say) -> dict[str, Any]:
    """Say what is missing and what comes next; ValueError at the first thing that is wrong."""
    check_project(project, say)
    step = _next(project)
    say(f"Next: `twin {step}`.")
    return {"stage": "check", "status": "done", "next": step}


def check_project(project: Project, say: Say, *, draws: bool = True) -> None:
    """Say what is known of a project and its files; ValueError at the first thing that is wrong.

    draws: with check.png, the first picture of each film, which is all that is written.
    """
    say(f"twin.toml is right. Points: {', '.join(point.name for point in project.config.points)}. "
        f"Effects: {', '.join(project.config.model.effects) or 'none'}.")  # fmt: skip
    for sentence in (*project.remarks, *filter(None, [said_of_sheet(project.config)])):
        say(sentence)
    own_deck = project.config.model.deck is not None
    if not own_deck:  # what a deck is not there for can be said before all files are
        check_finger(project, say)
    missing = _missing_files(project)
    if missing:
        raise ValueError(f"missing in {project.root}: {'; '.join(missing)}")
    if own_deck:
        check_finger(project, say)
    for test in pull_tests(project.config.material_tests, project.root):
        for line in (test.sentence, *test.remarks):
            say(line)
    _check_effects(project)
    _check_engine(project, say)
    camera_remark = camera_kept(project)
    if camera_remark:
        say(camera_remark)
    _check_recorded(project, say, draws=draws)
    if project.targets_folder.is_dir():
        targets = project.targets()
        _check_points(project, targets)
        _check_motion(project, targets, say)
        say(f"The targets have {len(targets.time)} steps and {len(targets.names)} points, with "
            f"{int(targets.valid.sum())} measured values in all.")  # fmt: skip
        if targets.noise is None:
            say("The targets have no noise model. Without one `twin diagnose` cannot test: measure them with "
                "`twin measure`, or state sd_mm or still_steps under [noise] of targets.toml.")  # fmt: skip
        elif targets.noise.basis:
            say(targets.noise.basis)
    if project.config.study is not None and fresh(project, ("study",)) is None:
        say("`twin study` makes the figures and the table of the study; it calibrates first where needed.")


def _check_engine(project: Project, say: Say) -> None:
    """Say which other program solves the model, where one does; ValueError where it is not installed."""
    if project.config.model.engine == EMBEDDED:
        return
    from twin.bench.engines import jobs_of

    if (jobs := jobs_of(project)) is not None:
        say(f"{jobs.release} solves the model.")


def _check_recorded(project: Project, say: Say, *, draws: bool) -> None:
    """Say what was read of the pressure log and seen in films that are not measured yet; ValueError where
    they are not right, or the log is shorter than the film."""
    pressure = project.config.pressure
    if project.config.imports and not project.targets_folder.is_dir():
        names = ", ".join(table.file for table in project.config.imports)
        say(f"{names}: {said_of_targets(import_targets(project, say)[0])}")
    if project.targets_folder.is_dir() or pressure is None or not project.config.cameras:
        return
    films = films_of(project)
    for film in films:
        _check_one(film.project, say, before=f"Film {film.name}: ", after=_said_of(film), draws=draws)
    if not films:
        _check_one(project, say, draws=draws)


def _said_of(film: OneFilm) -> str:
    """Gravity and role of a film of several, as twin.toml states them."""
    turned = "" if film.table.gravity is None else f" Gravity: {list(film.table.gravity)}."
    return turned + (" It is held out: predicted, never fitted." if film.table.held_out else "")


def _check_one(project: Project, say: Say, *, draws: bool, before: str = "", after: str = "") -> None:
    """Say what was read of the log of the project's one film, and seen in that."""
    from twin.inputs.filmcheck import check_films

    log, read, odd = _log_line(project)
    say(f"{before}{read}{after}")
    for sentence in odd:
        say(sentence)
    check_films(project, log, say, draws=draws)


def _log_line(project: Project) -> tuple[Log, str, tuple[str, ...]]:
    """The pressure log of a film, a sentence on its contents, and remarks on it; ValueError where it is not
    right, or shorter than the film."""
    from twin.gauge.pressurelog import check_lasts
    from twin.inputs.recordings import gauge_of, log_of, pressure_table, said_of_log
    from vision.film.series import open_film

    pressure = pressure_table(project)
    log, table = log_of(project, pressure), project.config.cameras[0]
    time, still = (open_film(project.path(f), fps=table.fps).time for f in (table.film, table.static))
    odd = _unused_rate(table, project)
    if pressure.join == "stamps":
        gauge_of(project, time, still, log, table.film_start_s)
        odd += said_of_log(project, time, log, table.film_start_s)
    elif log.doubt:
        odd += (log.doubt,)
    check_lasts(log, float(time[-1] - time[0]))
    return log, (
        f"{log.path.name}: {log.source}, {log.pressure.min():.3g} to {log.pressure.max():.3g} MPa, "
        f"{log.time[-1] - log.time[0]:.1f} s long. The film lasts {time[-1] - time[0]:.1f} s."
    ), odd


def _unused_rate(table: CameraTable, project: Project) -> tuple[str, ...]:
    """A sentence on a frame rate that is stated for a video file, whose own time stamps count."""
    film = project.path(table.film)
    if table.fps is None or not film.is_file():
        return ()
    return (
        f"cameras.fps = {table.fps:g} is for pictures: {film.name} is a video file, and its own time "
        "stamps are used.",
    )


def check_finger(project: Project, say: Say) -> None:
    """Say what is to be known of the finger's mesh and of points on it; ValueError where they are not
    right."""
    from twin.bench.meshshapes import poor_shapes, shape_table
    from twin.bench.workbench import one_side, places_of, structure_of
    from twin.calibrated.positions import check_points
    from twin.model.structure import size_doubt

    structure = structure_of(project)
    check_points(project.config.points, structure, mirrored=one_side(project))
    places = places_of(project, structure).values()
    for line in (*structure.remarks, size_doubt(structure.case), *(p.sentence for p in places)):
        if line:
            say(line)
    if project.config.model.deck is not None:
        from twin.model.discretisation import stiffness_doubt

        for line in (*shape_table(structure), poor_shapes(structure), stiffness_doubt(structure.case)):
            if line:
                say(line)


def _check_effects(project: Project) -> None:
    """Raise ValueError where an effect that twin.toml names is unknown, or its file not right."""
    labels, sought = project.config.model.effects, project.config.diagnose.candidates
    if not labels and not sought and not project.config.model.effect_files:
        return
    from twin.bench.workbench import own_of
    from twin.contract.promises import check_effect
    from twin.effects.library import effect, effects_of

    project_effects = own_of(project)
    for label in labels:
        effect(label, users=project_effects)
    for text in sought:
        effects_of(text, users=project_effects)
    own = [e for e in project_effects if e.origin is not None]  # open dimensions fit the body's mesh alone
    for sentence in (s for e in own for s in check_effect(e, solves=False)):
        raise ValueError(sentence)


def _missing_files(project: Project) -> list[str]:
    """Files that twin.toml names and that are missing; no film is asked for once its targets are there."""
    deck = project.config.model.deck
    if deck is not None and (gone := _no_file(project, deck, "model.deck")):
        return gone
    curves = [(test.file, f"material_tests.{test.name}.file") for test in project.config.material_tests]
    if gone := [line for file, key in curves for line in _no_file(project, file, key)]:
        return gone
    if project.targets_folder.is_dir():
        return []
    if imports := project.config.imports:
        return [f"{path} (import.{key})" for table in imports for key in ("file", "log")
                if (path := getattr(table, key)) is not None and not project.path(path).exists()]  # fmt: skip
    if not project.config.cameras or project.config.pressure is None:
        return ["targets/targets.csv (there is no [[cameras]] to measure them with)"]
    missing = []
    for camera in project.config.cameras:
        named = {"cameras.film": camera.film, "cameras.static": camera.static}
        missing += [f"{path} ({key})" for key, path in named.items() if not any(project.root.glob(path))]
        calibration = camera.camera_file or camera.boards or ""
        key = "camera_file" if camera.camera_file else "boards"
        missing += [] if any(project.root.glob(calibration)) else [f"{calibration} (cameras.{key})"]
    for film in project.config.films[1:]:  # the first is that of the camera
        film_files = {"file": film.file, "static": film.static, "pressure": film.pressure}
        missing += [f"{path} (films.{film.name}.{key})" for key, path in film_files.items()
                    if path is not None and not any(project.root.glob(path))]  # fmt: skip
    mended = project.config.measure.corrections
    if mended is not None:
        missing += _no_file(project, mended, "measure.corrections")
    log = project.config.films[0].pressure if project.config.films else None
    log = log or project.config.pressure.file
    return [*missing, *_no_file(project, log, "pressure.file")]


def _no_file(project: Project, path: str, key: str) -> list[str]:
    """A remark for the key of a missing file; empty where the file exists."""
    full = project.path(path)
    what = f"{key}: it is a folder, wanted a file" if full.is_dir() else key
    return [] if full.is_file() else [f"{path} ({what})"]


def _check_points(project: Project, targets: Targets) -> None:
    """Raise ValueError where twin.toml and the targets name different points."""
    point_names = [point.name for point in project.config.points]
    unknown = [p.name for p in targets.points if p.kind is PointKind.UNKNOWN and p.name not in point_names]
    if unknown:
        raise ValueError(
            f"targets point {unknown[0]!r} has no place on the finger: add it to [[points]] in twin.toml "
            "with its position_mm or its node"
        )
    for name in project.config.objective_points:
        if name not in targets.names:
            raise ValueError(
                f"calibrate.objective_points = {name!r}: targets have {', '.join(targets.names)}"
            )


def _check_motion(project: Project, targets: Targets, say: Say) -> None:
    """Say what is odd in the targets; ValueError where they are not of the project's finger."""
    from twin.bench.workbench import check_plausible, structure_of
    from twin.sanity import doubts

    case = structure_of(project).case
    check_plausible(project, targets, case)
    for sentence in doubts(replace(targets, points=tuple(_placed(project, targets))), case):
        say(sentence)
    _check_inertia(project, targets, case, say)


def _check_inertia(project: Project, targets: Targets, case: "Case", say: Say) -> None:
    """Say which steps are not quasi-static, and what statics make of them; the model's vibration is asked for
    where it may count."""
    from twin.effects.requirements import SLOWEST_Hz
    from twin.ringing.quasistatic import not_static, said

    stated = project.config.calibrate.ringing_Hz
    if stated is not None:
        flags = not_static(targets, stated)
        say(f"ringing_Hz = {stated:g}: {int(flags.sum())} of {len(flags)} steps are left out of all fits, as "
            "inertia moves the finger there.")  # fmt: skip
    elif not _follows_inertia(project) and not_static(targets, SLOWEST_Hz).any():
        from twin.bench.firstvibration import first_vibration

        hz, source = first_vibration(project, case)
        if sentence := said(targets, hz, source):
            say(sentence)


def _follows_inertia(project: Project) -> bool:
    """True if the model has the effect inertia."""
    return any(label.partition(":")[0] == "inertia" for label in project.config.model.effects)


def _placed(project: Project, targets: Targets) -> Iterator[TargetPoint]:
    """Points of the targets; where these have no place, it comes from twin.toml."""
    positions = {point.name: point.position_mm for point in project.config.points}
    for point in targets.points:
        position = positions.get(point.name)
        if point.kind is PointKind.UNKNOWN and position is not None:
            yield replace(point, kind=PointKind.PLACE, position=position)
        else:
            yield point


def _next(project: Project) -> str:
    """The next command: the first stage that is not done or stale, "list" where all are done."""
    gone = not project.targets_folder.is_dir()  # a run that made targets does not bring them back
    todo = (
        stage for stage in _ahead(project)
        if fresh(project, (stage.name,)) is None or (gone and TARGETS in stage.writes)
    )  # fmt: skip
    for stage in todo:
        named = named_effects(project) if stage.when is When.NAMED else []
        if stage.when is When.ALWAYS or named:
            return shlex.join([stage.name, *(named if len(named) == 1 else ())])
    return "list"


def _ahead(project: Project) -> list[Stage]:
    """The stages that a project goes through: with targets there, those that come after them."""
    stages = [stage for stage in STAGES if project.config.cameras or stage.name != "camera"]
    last = [k for k, stage in enumerate(stages) if TARGETS in stage.writes][-1]
    return stages[last + 1 :] if project.targets_folder.is_dir() else stages
