"""The command drop: the model without one of its effects."""

from typing import Any

from twin.bench.effectchange import change_effects
from twin.project.folder import Project, Say


def run_drop(project: Project, say: Say, *, name: str) -> dict[str, Any]:
    """The model without one of its effects: refitted and compared."""
    left = tuple(e for e in project.config.model.effects if e.partition(":")[0] != name.partition(":")[0])
    if len(left) == len(project.config.model.effects):
        raise ValueError(
            f"effect {name!r} is not in the model, which has "
            f"{', '.join(project.config.model.effects) or 'none'}"
        )
    return change_effects(project, "drop", left, {}, say)
