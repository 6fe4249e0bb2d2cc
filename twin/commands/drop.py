"""The command drop: the model without one of its effects."""

from collections.abc import Sequence
from typing import Annotated, Any

from typer import Argument

from twin.bench.effectchange import change_effects
from twin.bench.effectlaws import named_effect
from twin.bench.workbench import Workbench
from twin.commands.add import one_after_another
from twin.effects.labels import OPEN, groups, name_of
from twin.messages import Say
from twin.project.folder import Project


def run_drop(
    project: Project,
    say: Say,
    names: Annotated[Sequence[str], Argument(
        metavar="EFFECT...", help="names of effects, such as creep, dropped one after the other")],
) -> dict[str, Any]:
    """The model without an effect, or without those that a verdict names together: refitted and compared."""
    return one_after_another(_drop, project, say, names)


def _drop(project: Project, say: Say, name: str) -> dict[str, Any]:
    labels = project.config.model.effects
    present = {name_of(label) for label in labels}
    named = [{name_of(x) for x in group} for group in groups(named_effect(project, name))]
    gone = next((names for names in named if names <= present), None)
    if gone is None:
        raise ValueError(f"effect {name!r} is not in the model, which has {', '.join(labels) or 'none'}")
    if OPEN in gone:
        raise ValueError(f"{OPEN} is [model.open] of twin.toml: remove that table, and run twin calibrate")
    remaining = tuple(label for label in labels if name_of(label) not in gone)
    return change_effects(Workbench.of(project), "drop", remaining, {}, say)
