"""The effects that a text names, each in the law that the newest diagnosis kept for it, and where their fit
begins."""

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
    """The effects that a text names as a verdict does, `creep + gravity or tube`, and where the newest
    diagnosis began the fit that it gave out for them. Of what it could not tell apart the first is taken, and
    the user hears so."""
    first, *others = effects_of(
        named_effect(project, text), users=own_of(project), law=law_of_project(project)
    )
    if others:
        labels = [AND.join(e.label for e in group) for group in (first, *others)]
        say(f"Taken is {labels[0]}; name {OR.join(labels[1:])} instead to take that.")
    kept, start = _kept(project)
    chosen = tuple(kept.get(e.label, e) for e in first)
    return chosen, start if {e.label for e in chosen} & {e.label for e in kept.values()} else {}


def _kept(project: Project) -> tuple[dict[str, Effect], Start]:
    """The effects that the newest diagnosis names, by name and in the laws that it kept, and where it began
    their fit; nothing without one that holds."""
    path = fresh(project, ("diagnose",), "diagnosis.json")
    law = files.read(DiagnosisRecord, path).law if path else None
    if path is None or not law or not path.with_name("kept.json").exists():
        return {}, {}
    how: dict[str, Any] = {"own": own_of(project), "law": law_of_project(project)}
    kept = {name_of(label): effect(label, **how) for label in law.split(AND)}
    return kept, files.read(FitRecord, path.with_name("kept.json")).start or {}


def named_effect(project: Project, name: str) -> str:
    """The name of an effect, or that of the effect in a Python file of the project: naming the file on the
    command line trusts it. ValueError where twin.toml does not name it, or it does not define one effect."""
    if not name.endswith(".py"):
        return name
    known = project.config.model.effect_files
    if name not in known:
        raise ValueError(
            f"{name}: not an effect file of this project, which has {', '.join(known) or 'none'}; name it "
            "under [model] effect_files of twin.toml"
        )
    remember(project.root, programs(project.root, [name]))
    found = [effect.name for effect in own_effects(project.root, (name,))]
    if len(found) != 1:
        raise ValueError(f"{name} defines {', '.join(found)}: name one of them instead of the file")
    return found[0]
