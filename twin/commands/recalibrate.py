"""A batch from its films to the report in one command: what is stale runs, what is fresh is skipped."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from twin import files
from twin.batches.former import former_of
from twin.batches.values import BatchChange, changes_of, values_of
from twin.bench.fits import fit_file, fresh, named_effects, newest, stale_sentences
from twin.bench.modeldifferences import other_effects
from twin.chain import STAGES, TARGETS, Stage, When, kinds_writing
from twin.commands.check import check_project
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.numerals import in_words
from twin.project.config import EMBEDDED, LEAST_SQUARES
from twin.project.folder import Project

FILM = STAGES[: next(k for k, stage in enumerate(STAGES) if TARGETS in stage.writes) + 1]
NO_NOISE = "no noise model"
MODEL = tuple(stage for stage in STAGES if stage not in FILM and stage.when is not When.ASKED)
ALONE = tuple(stage for stage in MODEL if stage.name != "review")  # whose report reads other batches, too


def run_recalibrate(project: Project, say: Say) -> dict[str, Any]:
    """Verdict, constants and changes of a project after every stale stage has run.

    A killed command goes on where it was: what is done stays, and the stage under way resumes its run.
    """
    done = run_stages(project, say, MODEL)
    project = Project.open(project.root, builtin=project.builtin)  # add has written its effect
    return {"stage": "recalibrate", "project": str(project.root), "stages": done} | _told(project, say)


def run_stages(project: Project, say: Say, model: Sequence[Stage]) -> dict[str, str]:
    """State, "done", "fresh" or "none", of each stage by name, once the stale stages of films and of `model`
    have run."""
    check_project(project, say)
    done = {stage.name: _filmed(project, stage, say) for stage in FILM}
    for stage in model:
        done[stage.name] = _once(project, stage, say)
        project = Project.open(project.root, builtin=project.builtin)  # add has written its effect
    return done


# -- what has to run -----------------------------------------------------------------------------------------


def _filmed(project: Project, stage: Stage, say: Say) -> str:
    """Run a stage that reads films, or another program's file; "none" where there are none, or the targets
    come from elsewhere."""
    if _without_films(project) or (stage.name == "camera" and not project.config.cameras):
        return "none"
    say(f"twin {stage.name}: {stage.title}")
    # it compares the digests of films and log itself, and targets of others are kept as targets-0001
    options = {"renew": True} if TARGETS in stage.writes else {}
    return str(stage.run(project, say, **options)["status"])


def _without_films(project: Project) -> bool:
    """True if the targets stand without films: none is named, the films are gone, or the targets were
    measured elsewhere."""
    if not project.targets_folder.is_dir():
        return False
    named = [r.film for r in project.config.cameras] or [r.file for r in project.config.imports]
    there = all(any(project.root.glob(file)) for file in named)
    return not named or not there or not (project.targets_folder / "source.json").is_file()


def _once(project: Project, stage: Stage, say: Say) -> str:
    """Run a stage unless it is fresh: "done", "fresh", or "none" where it has nothing to do."""
    why = _undiagnosed(project) if stage.name in ("diagnose", "add") else ""
    if why:
        if stage.name == "diagnose" and why != NO_NOISE:
            say(f"twin diagnose is left out: {why} cannot serve it.")
        return "none"
    kinds = ("add", "drop") if stage.when is When.NAMED else (stage.name,)
    run = _fresh_run(project, kinds)
    if run is not None:
        say(f"twin {stage.name}: fresh in runs/{run}, skipped.")
        return "fresh"
    if stage.when is When.NAMED and not named_effects(project):
        return "none"
    old = stale_sentences(project, kinds)
    say(f"twin {stage.name}: {stage.title}" + (f" ({old[0]})" if old else ""))
    return str(stage.run(project, say).get("status", "done"))


def _fresh_run(project: Project, kinds: tuple[str, ...]) -> str | None:
    """The newest run of these kinds that belongs to the present project and is younger than what it is built
    on."""
    path = fresh(project, kinds)
    if kinds == ("calibrate",) and not _has_fit(project):
        return None  # of the base alone: effects were written into twin.toml, or it was killed before them
    if path is None or any(_number(path.parent.name) < n for n in _needed(project, kinds)):
        return None
    return path.parent.name


def _has_fit(project: Project) -> bool:
    """True if the model has been fitted with the effects of twin.toml."""
    try:
        fit_file(project)
    except ValueError:
        return False
    return True


def _needed(project: Project, kinds: tuple[str, ...]) -> list[int]:
    """The numbers of the newest fresh runs that the results of these kinds depend on."""
    names = [stage.name for stage in MODEL]
    before = [name for name in names[: names.index(kinds[0])] if name != "compare"]
    groups = [("add", "drop") if name == "add" else (name,) for name in before]
    results = [fresh(project, group) for group in groups]
    return [_number(path.parent.name) for path in results if path is not None]


def _number(run: str) -> int:
    return int(run.partition("-")[0])


# -- what came out -------------------------------------------------------------------------------------------


def _told(project: Project, say: Say) -> dict[str, Any]:
    """Say verdict, constants, what changed, and where report and recording are; and return them."""
    record, diagnosed = files.read(FitRecord, fit_file(project)), newest(project, DiagnosisRecord)
    verdict = diagnosed.verdict if diagnosed else f"not diagnosed: {_undiagnosed(project) or NO_NOISE}"
    say(f"Verdict: {verdict}")
    say(f"{in_words(record.estimates)}.")
    former, changes = _changed(project, record, say)
    paths = {}
    for name, how in (("report.html", "open {} in a browser"), ("review.rrd", "rerun {}")):
        path = fresh(project, kinds_writing(name), name)
        if path is not None:
            paths[name] = str(path)
            say(f"{name}: {how.format(path)}")
    return {
        "verdict": verdict, "effects": list(project.config.model.effects),
        "parameters": files.plain(record.parameters), "intervals": files.plain(record.intervals),
        "like": former,
        "changes": [asdict(c) | {"difference": c.difference, "known": c.known} for c in changes],
    } | paths  # fmt: skip


def _undiagnosed(project: Project) -> str:
    """Reason, empty if none, for which a project is not diagnosed: engine, loss, or no noise model."""
    engine, loss = project.config.model.engine, project.config.calibrate.loss
    if engine != EMBEDDED:
        return f"engine = {engine!r}"
    if loss != LEAST_SQUARES:
        return f"loss = {loss!r}"
    return "" if project.targets().noise is not None else NO_NOISE


def _changed(
    project: Project, record: FitRecord, say: Say
) -> tuple[str | None, tuple[BatchChange, ...]]:
    """The former batch's name, and how this one differs from it, which is said."""
    try:
        former = former_of(project)
        if former is None:
            return None, ()
        then = files.read(FitRecord, fit_file(former))
    except files.UNREADABLE as error:
        say(f"Not compared with {project.config.project.like}: {error}.")
        return project.config.project.like, ()
    changes = changes_of(values_of(then), values_of(record))
    say(f"Beside {former.root.name}:")
    for change in changes:
        say(f"  {change.words}")
    for sentence in other_effects(former, then, project, record):
        say(f"  {sentence}")
    return former.root.name, changes
