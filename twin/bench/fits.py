"""The valid runs of a project: fits, comparisons and diagnoses of its present targets, mesh and settings."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from twin import files
from twin.chain import DECK, FIT, STAGES, TARGETS, Stage, When, kinds_writing
from twin.effects.labels import checked_groups, name_of
from twin.judging.fitrecord import FitRecord
from twin.project.folder import Project, kind_of
from twin.project.record import changed_files, changed_format, changed_place, changed_tables
from twin.project.trust import leads_out, links
from twin.records import Record

if TYPE_CHECKING:
    from calibrate import Fit


Found = TypeVar("Found", bound=Record)


def stale(project: Project, folder: Path) -> list[str]:
    """Changes of the project since a run was made, one clause each; [] for a valid run."""
    stage = next((stage for stage in STAGES if stage.name == kind_of(folder)), None)
    if stage is None or project.info(folder).status != "done":
        return []
    if stage.when is not When.ALWAYS and (difference := _other_effects(project, folder)):
        return [difference]
    return _changes(project, folder, stage)


def holds(project: Project, folder: Path) -> bool:
    """True for a done run of the present targets, mesh and settings, whatever its effects."""
    stage = next((stage for stage in STAGES if stage.name == kind_of(folder)), None)
    return stage is not None and _is_done(project, folder) and not _changes(project, folder, stage)


def _changes(project: Project, folder: Path, stage: Stage) -> list[str]:
    """Changes since a run of a stage was made, but for the effects in the model."""
    present = [project.targets_folder] if TARGETS in stage.reads else []
    present += project.deck_files() if DECK in stage.reads else []
    present += project.material_files() if "[material_tests]" in stage.reads else []
    info = project.info(folder)
    model = info.config.model
    labels = info.extra.effects if "effects" in info.extra.model_fields_set else model.effects
    if "[diagnose]" in stage.reads or (model.effect_files and _has_own(labels)):
        return changes(project, folder, tables=stage.tables, present=[*present, *project.effect_files()])
    but = [*model.effect_files, *map(project.shown, project.effect_files())]
    return changes(project, folder, tables=stage.tables, present=present, but=but)


def _other_effects(project: Project, folder: Path) -> str:
    """A clause on a run with other effects than twin.toml; "" where they agree."""
    path, now = folder / FIT, project.config.model.effects
    if not path.is_file():
        return ""
    fit = files.read(FitRecord, path)
    then = fit.effects if "effects" in fit.model_fields_set else now
    if then == now:
        return ""
    return f"its effects are {', '.join(then) or 'none'}, those of twin.toml {', '.join(now) or 'none'}"


def _has_own(labels: Sequence[str]) -> bool:
    """True where a model has an effect of the user's own files: only then does its fit depend on them."""
    if not labels:
        return False
    from twin.effects.library import all_effects

    library = {e.name for e in all_effects()}
    return any(name_of(label) not in library for label in labels)


def fresh(project: Project, kinds: tuple[str, ...], file: str = "run.json") -> Path | None:
    """The file of the newest done run of these kinds that has it and belongs to the present project."""
    return next(every_fresh(project, kinds, file), None)


def newest(project: Project, record: type[Found], kinds: tuple[str, ...] = ()) -> Found | None:
    """The record of the newest done run that has it and belongs to the present project."""
    path = fresh(project, kinds or kinds_writing(record.file), record.file)
    return files.read(record, path) if path else None


def every_fresh(project: Project, kinds: tuple[str, ...], file: str) -> Iterator[Path]:
    """The files of all done runs of these kinds that belong to the present project, the newest first."""
    return (path for path in _having(project, kinds, file) if not stale(project, path.parent))


def stale_sentences(project: Project, kinds: tuple[str, ...], file: str = "run.json") -> list[str]:
    """A sentence for each stale run of these kinds that is newer than the newest valid one."""
    sentences = []
    for path in _having(project, kinds, file):
        why = stale(project, path.parent)
        if not why:
            break
        sentences.append(f"{project.shown(path.parent)} is stale: {why[0]}; it is not used")
    return sentences


def newest_fit(project: Project) -> "Fit":
    """The newest fit of the model that twin.toml has now, made from the targets, mesh and settings of now.

    ValueError names what is stale, or says to calibrate first.
    """
    return files.read(FitRecord, fit_file(project)).fit


def fit_file(project: Project) -> Path:
    """The fit.json of `newest_fit`."""
    effects = project.config.model.effects
    refused, others = "", False
    for path in _having(project, kinds_writing(FIT), FIT):
        fit = files.read(FitRecord, path)
        if "effects" not in fit.model_fields_set or fit.effects != effects:
            others = True
            continue
        why = stale(project, path.parent)
        if not why:
            return path
        refused = refused or f"fit of {project.shown(path.parent)} is stale: {why[0]}"
    if refused:
        raise ValueError(f"{refused}; run twin calibrate")
    what = f"for effects {list(effects)}" if others else "in this project"
    raise ValueError(f"no fit {what}; run twin calibrate")


def held_fit(project: Project, effects: Sequence[str]) -> FitRecord | None:
    """The newest fit with these effects that holds for targets, mesh and settings of now; None without."""
    fits = _fits_with(project, effects)
    return next((fit for path, fit in fits if holds(project, path.parent)), None)


def former_fit(project: Project, effects: Sequence[str]) -> FitRecord | None:
    """The newest fit with these effects, whether or not it still holds; None where there is none."""
    return next((fit for _, fit in _fits_with(project, effects)), None)


def _fits_with(project: Project, effects: Sequence[str]) -> Iterator[tuple[Path, FitRecord]]:
    """The fits with these effects and their files, newest first."""
    every = ((path, files.read(FitRecord, path)) for path in _having(project, kinds_writing(FIT), FIT))
    return ((p, f) for p, f in every if "effects" in f.model_fields_set and f.effects == tuple(effects))


def named_effects(project: Project) -> list[str]:
    """The effects that the newest diagnosis names; none in a tie. ValueError without one that still holds."""
    path = fresh(project, ("diagnose",), "diagnosis.json")
    if path is None:
        why = stale_sentences(project, ("diagnose",), "diagnosis.json")
        raise ValueError(f"{why[0] if why else 'no diagnosis yet'}; run twin diagnose, or name the effect")
    from twin.diagnosis.diagnosisrecord import DiagnosisRecord

    record = files.read(DiagnosisRecord, path)
    named = () if record.ties else record.named
    try:
        return [checked_groups(label) for label in named]
    except ValueError as error:
        raise ValueError(f"{path}: named = {list(named)}: {error}; {files.AGAIN}") from None


def _having(project: Project, kinds: tuple[str, ...], file: str) -> list[Path]:
    """The files of a name in the done runs of these kinds, newest first."""
    folders = [f for f in reversed(project.runs()) if kind_of(f) in kinds and (f / file).is_file()]
    return [folder / file for folder in folders if _is_done(project, folder)]


def _is_done(project: Project, folder: Path) -> bool:
    return project.info(folder).status == "done"


# The effects of a fit stand in fit.json: twin.toml gets them after the fit. Names of own effect files say
# nothing of what they hold, which the digests do.
ELSEWHERE = {("model", "effects"), ("model", "effect_files")}
# How a job runs changes no figure; which program solves does.
RUNNING = {("model", f"engine_{key}") for key in ("cpus", "jobs", "memory", "command", "timeout_s")}


def changes(
    project: Project, folder: Path, *, tables: Sequence[str], present: Sequence[Path], but: Sequence[str] = ()
) -> list[str]:
    """Changes since the run in `folder` was made, one clause each; [] without any.

    tables: names of the tables of twin.toml that it depends on.   present: the files and folders that it
    would read now, next to those that it has recorded.   but: recorded files that do not count.
    """
    info = project.info(folder)
    if not {"inputs", "config"} <= info.model_fields_set:
        return ["its run.json does not say what it was made from"]
    recorded = {name: digest for name, digest in info.inputs.items() if name not in but}
    now, was = project.config.model_dump(mode="json"), info.config.model_dump(mode="json", exclude_unset=True)
    states = {name: now[name] for name in tables if name in was and name in now}  # a run states what it reads
    stated = project.config.model_dump(mode="json", exclude_defaults=True)
    return [
        *changed_format(info),
        *changed_files(recorded, _files(project, recorded, present)),
        *(changed_place(*k) for k in changed_tables(was, states, stated) if k not in ELSEWHERE | RUNNING),
    ]


def _files(project: Project, recorded: Iterable[str], present: Sequence[Path]) -> Mapping[str, str]:
    """The digests of the present files, and of the recorded ones that are still there."""
    now = files.digest_of([path for path in present if path.exists()], root=project.root)
    elsewhere = [project.path(name) for name in recorded if name not in now]
    return now | files.digest_of([path for path in elsewhere if _may_read(project, path)], root=project.root)


def _may_read(project: Project, path: Path) -> bool:
    """True for an existing file that is the project's own, or a trusted link."""
    if not path.is_file():
        return False
    if not leads_out(path, project.root):
        return True
    return path in [project.path(link.name) for link in links(project.root, project.config)]
