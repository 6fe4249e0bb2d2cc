"""The command add: the model with one more effect, refitted and compared."""

from typing import Any

from twin.bench.effectchange import change_effects
from twin.bench.fits import named_effects
from twin.bench.laws import law_of
from twin.project.folder import Project, Say


def run_add(project: Project, say: Say, *, name: str | None = None) -> dict[str, Any]:
    """The model with one more effect, in the law that the newest diagnosis kept: refitted and compared.

    Without a name the effects are those that the newest diagnosis names together; where it names none,
    nothing is added.
    """
    names = [name] if name is not None else named_effects(project)
    if not names:
        say("The diagnosis names no effect: nothing is added.")
        return {"stage": "add", "status": "skipped", "named": names}
    laws = [law_of(project, one) for one in names]
    chosen, start = [law for law, _ in laws], {k: x for _, values in laws for k, x in values.items()}
    kept = [e for e in project.config.model.effects if e.partition(":")[0] not in {c.name for c in chosen}]
    return change_effects(project, "add", (*kept, *(c.label for c in chosen)), start, say)
