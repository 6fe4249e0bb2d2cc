"""The effects that a text names, each in the law that the newest diagnosis kept for it, and where their fit
begins."""

from typing import Any

from twin import files
from twin.bench.fits import fresh
from twin.bench.workbench import law_of_project, own_of
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.diagnosis.screening import screened
from twin.diagnosis.signatures import signatures_of
from twin.effects.labels import AND, OR, name_of
from twin.effects.library import effect, effects_of
from twin.effects.ownfiles import own_effects
from twin.effects.protocol import Effect, Test, Theta, Unsolvable
from twin.judging.fitrecord import FitRecord
from twin.judging.judged import Judged
from twin.messages import Say
from twin.model.prediction import Model
from twin.project.folder import Project
from twin.project.trust import programs, remember

Start = dict[str, float]
HALVED = 6  # times at most


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


def begun(now: Judged, chosen: Effect) -> tuple[Effect, Start]:
    """The effect with values to begin a fit at: of its narrowest law, at the size and in the entry of its
    tries that lower chi2 most to first order, carried on to the wider ones."""
    laws, test = chosen.laws(), now.model.test
    law = laws[0] if chosen.label in [one.label for one in laws] else chosen
    (found,) = screened(now, signatures_of(now, [law]))
    values = dict(found.start) or {**now.values, **nominal(law, test)}
    if chosen.label == law.label:
        return law.at(values, test), _within(now, chosen, values)
    for wider in laws[1:]:
        values = dict(wider.start(values))
        if wider.label == chosen.label:
            break
    return chosen, _within(now, chosen, values)


def _within(now: Judged, e: Effect, values: Start) -> Start:
    """The values, the effect's amplitudes halved towards null until a model can be made with them: where
    several are large at once, walls may close or all of the stiffness relax."""
    model = now.model.with_effect(e)
    for _ in range(HALVED):
        try:
            model.put(values)
            return values
        except Unsolvable:
            values = values | {p.name: ((p.null or 0.0) + values[p.name]) / 2 for p in e.amplitudes}
    return values


def nominal(e: Effect, test: Test) -> Start:
    """Values of an effect of which nothing is known: half a typical step from null, the middle of its
    tries."""
    half = {p.name: (p.null or 0.0) + 0.5 * p.step for p in e.parameters}
    tried = e.tries(test)
    stated = {p.name: p.start for p in e.parameters if p.start is not None}
    return {**half, **stated, **tried[len(tried) // 2]}


def begun_from(model: Model, known: Theta, start: Theta) -> dict[str, float]:
    """Values of a start, and known ones beside it; where no rubber is stable with them, as may be to first
    order, the known ones count."""
    values = {**known, **start}
    return values if model.allowed(values) else {**start, **known}
