"""The effects that a text names, each in the law that the newest diagnosis chose for it, and the start of
their fit."""

from typing import Any

from twin import files
from twin.bench.fits import fresh
from twin.bench.workbench import law_of_project, own_of
from twin.calibrated.effectstarts import Start
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.effects.labels import AND, OR, name_of
from twin.effects.library import effect, effects_of
from twin.effects.ownfiles import own_effects
from twin.effects.protocol import Effect
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.project.folder import Project
from twin.project.trust import programs, remember


def laws_of(project: Project, text: str, say: Say) -> tuple[tuple[Effect, ...], Start]:
    """The effects that a text names as a verdict does, `creep + gravity or tube`, and the start values of
    their fit in the newest diagnosis. Of alternatives the first is taken, and a line says so."""
    first_group, *others = effects_of(
        named_effect(project, text), users=own_of(project), law=law_of_project(project)
    )
    if others:
        labels = [AND.join(e.label for e in group) for group in (first_group, *others)]
        say(f"Taken is {labels[0]}; name {OR.join(labels[1:])} instead to take that.")
    laws, starts = _refitted(project)
    chosen = tuple(laws.get(e.label, e) for e in first_group)
    return chosen, next((starts[e.label] for e in chosen if e.label in starts), {})


def _refitted(project: Project) -> tuple[dict[str, Effect], dict[str, Start]]:
    """What the newest diagnosis refitted: effects by name, in the laws that it chose or that came nearest,
    and the start values of their fits by law; nothing without a valid diagnosis."""
    path = fresh(project, ("diagnose",), "diagnosis.json")
    if path is None:
        return {}, {}
    record, kept = files.read(DiagnosisRecord, path), path.with_name("kept.json")
    rows = [row for row in reversed(record.ranking) if row.parameters]
    laws = [row.law for row in rows]
    starts: dict[str, Start] = {row.law: {n: e.value for n, e in row.parameters.items()} for row in rows}
    if record.law and kept.exists():
        named = record.law.split(AND)
        laws += named
        starts |= dict.fromkeys(named, files.read(FitRecord, kept).start or {})
    options: dict[str, Any] = {"users": own_of(project), "law": law_of_project(project)}
    return {name_of(law): effect(law, **options) for law in laws}, starts


def named_effect(project: Project, name: str) -> str:
    """The name of an effect; for a Python file of the project the name of its effect.

    A file named on the command line is trusted from then on. ValueError where twin.toml does not name it, or
    it does not define exactly one effect.
    """
    if not name.endswith(".py"):
        return name
    effect_files = project.config.model.effect_files
    if name not in effect_files:
        raise ValueError(
            f"{name}: not an effect file of this project, which has {', '.join(effect_files) or 'none'}; "
            "name it under [model] effect_files of twin.toml"
        )
    remember(project.root, programs(project.root, [name]))
    names = [effect.name for effect in own_effects(project.root, (name,))]
    if len(names) != 1:
        raise ValueError(f"{name} defines {', '.join(names)}: name one of them instead of the file")
    return names[0]
