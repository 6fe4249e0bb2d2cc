"""The command add: the model with one more effect, fitted and compared."""

from typing import Any

from twin.bench.effectchange import change_effects
from twin.bench.effectlaws import Start, begun, laws_of, nominal
from twin.bench.fits import named_effects, newest_fit
from twin.bench.workbench import Workbench
from twin.effects.labels import AND, name_of
from twin.effects.protocol import Effect
from twin.messages import Say
from twin.project.folder import Project


def run_add(project: Project, say: Say, *, name: str | None = None) -> dict[str, Any]:
    """The model with one more effect, in the law that the newest diagnosis kept, and compared; with the
    diagnosis' fit where it has one, else fitted.

    name: as a verdict names it, `creep` or `creep + gravity`. Without a name the effects are those that the
    newest diagnosis names together; where it names none, nothing is added.
    """
    text = AND.join(named_effects(project)) if name is None else name
    if not text and name is None:
        say("The diagnosis names no effect: nothing is added.")
        return {"stage": "add", "status": "skipped", "named": []}
    chosen, start = laws_of(project, text, say)
    bench = Workbench.of(project)
    chosen, start = _placed(bench, chosen, start, say)
    kept = [e for e in project.config.model.effects if name_of(e) not in {c.name for c in chosen}]
    return change_effects(bench, "add", (*kept, *(c.label for c in chosen)), start, say)


def _placed(
    bench: Workbench, chosen: tuple[Effect, ...], start: Start, say: Say
) -> tuple[tuple[Effect, ...], Start]:
    """The effects, those of which it must be stated which (a marker and a time) where these data show them
    most."""
    model, out = bench.model(), []
    for e in chosen:
        if e.at(nominal(e, model.test), model.test) is not e:
            e, own = begun(bench.judged_fit(model, newest_fit(bench.project), say), e)
            start = {**own, **start}
        out.append(e)
    return tuple(out), start
