"""The command add: the model with one more effect, fitted and compared."""

from collections.abc import Callable, Sequence
from typing import Annotated, Any

from typer import Argument

from twin.bench.effectchange import change_effects
from twin.bench.effectlaws import laws_of
from twin.bench.fits import named_effects, newest, newest_fit
from twin.bench.workbench import Workbench
from twin.calibrated.effectstarts import Start, begun, nominal
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.effects.labels import AND, name_of
from twin.effects.protocol import Effect
from twin.messages import Say
from twin.project.folder import Project


def run_add(
    project: Project,
    say: Say,
    names: Annotated[Sequence[str], Argument(
        metavar="[EFFECT]...",
        help="names of effects, such as creep, added one after the other; without a name the one that the "
        "diagnosis names")] = (),
) -> dict[str, Any]:
    """The model with one more effect, in the law that the newest diagnosis kept, and compared; with the
    diagnosis' fit where it has one, else fitted.

    A name is as a verdict states it, `creep` or `creep + gravity`. Where there is none, and the newest
    diagnosis names no effect or several that it cannot tell apart, nothing is added.
    """
    verdict = AND.join(named_effects(project)) if not names else ""
    if not names and not verdict:
        found = newest(project, DiagnosisRecord)
        why = "The diagnosis names no effect: nothing is added."
        if found and found.ties:
            why = f"{found.sentence} Nothing is added: name one, as in `twin add {found.named[0]}`."
        elif found and found.nearest:
            why += f" `twin add {found.nearest[0]}` adds what comes nearest."
        say(why)
        return {"stage": "add", "status": "skipped", "named": []}
    return one_after_another(_add, project, say, names or [verdict])


def _add(project: Project, say: Say, name: str) -> dict[str, Any]:
    chosen, start = laws_of(project, name, say)
    bench = Workbench.of(project)
    chosen, start = _placed(bench, chosen, start, say)
    added = {effect.name for effect in chosen}
    labels = [label for label in project.config.model.effects if name_of(label) not in added]
    return change_effects(bench, "add", (*labels, *(effect.label for effect in chosen)), start, say)


def one_after_another(
    change: Callable[[Project, Say, str], dict[str, Any]], project: Project, say: Say, names: Sequence[str]
) -> dict[str, Any]:
    """Result of the last of several changes of the model, each a fit of its own; `before` has the others."""
    results = [change(Project.open(project.root, builtin=project.builtin), say, name) for name in names]
    return results[-1] | ({"before": results[:-1]} if len(results) > 1 else {})


def _placed(
    bench: Workbench, chosen: tuple[Effect, ...], start: Start, say: Say
) -> tuple[tuple[Effect, ...], Start]:
    """The effects, each marker and moment that its label leaves open set to where the data show it most."""
    model, out = bench.model(), []
    for e in chosen:
        if e.at(nominal(e, model.test), model.test) is not e:
            e, first_guess = begun(bench.judged_fit(model, newest_fit(bench.project), say), e)
            start = {**first_guess, **start}
        out.append(e)
    return tuple(out), start
