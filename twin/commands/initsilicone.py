"""What a finger takes over from another shape of the same silicone: `twin init --like A --body ...`."""

from collections.abc import Sequence
from typing import Any

from twin.bench.workbench import law_of_project, own_of
from twin.effects.library import effect
from twin.effects.mechanism import Owner
from twin.effects.phrases import listed
from twin.effects.protocol import Effect
from twin.project.folder import Project

WHY = {
    Owner.BODY: "of the other body's shape", Owner.RIG: "of the other film and its rig",
}  # fmt: skip


def of_silicone(former: Project) -> tuple[dict[str, Any], list[str]]:
    """Keys of [model] that belong to the silicone of a project, and sentences on what is taken and what is
    not. An effect from a file of the user's stays, whatever it belongs to."""
    law, own, table = law_of_project(former), own_of(former), former.config.model
    found = [effect(label, users=own, law=law) for label in table.effects]
    kept = [e for e in found if e.owner is Owner.SILICONE and e.origin is None]
    taken = {"law": law.name, "effects": tuple(e.label for e in kept), "fixed": table.fixed,
             "density_kg_m3": table.density_kg_m3}  # fmt: skip
    what = [f"the law {law.name}", *(e.label for e in kept)]
    what += [f"{name} = {value:g} MPa, fixed" for name, value in table.fixed.items()]
    what += [] if table.density_kg_m3 is None else [f"a density of {table.density_kg_m3:g} kg/m3"]
    first = f"Of the silicone of {former.root.name} it has {listed(what)}."
    return taken, [first, *_left(found, kept)]


def _left(found: Sequence[Effect], kept: Sequence[Effect]) -> list[str]:
    """A sentence for each reason to leave an effect behind."""
    left = [e for e in found if e not in kept]
    own = "of a file of yours: copy it, and name it under effect_files"
    why = {e.label: WHY.get(e.owner, own) for e in left}
    return [
        f"Left behind: {listed([label for label in why if why[label] == reason])}, {reason}."
        for reason in dict.fromkeys(why.values())
    ]
