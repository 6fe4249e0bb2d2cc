"""Rigid joints of a deck: nodes that move as a reference node does, which must not turn."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from fe.case import Equation
from fe.deck.keywords import Place


@dataclass(frozen=True)
class TieDraft:
    """Two surfaces that are tied, how far (deck's unit) a node may lie from the master, and the line."""

    slave: str
    master: str
    tolerance: float | None
    place: Place


@dataclass(frozen=True)
class Rigid:
    """Nodes that move as a reference node does, in some components."""

    reference: int
    nodes: list[int]
    components: tuple[int, ...]
    place: Place
    keyword: str

    def only(self, components: tuple[int, ...]) -> "Rigid":
        """The same joint in these components."""
        return replace(self, components=components)


def resolved(
    joints: Iterable[Rigid], held: Mapping[int, Mapping[int, float]]
) -> tuple[list[tuple[list[int], int, float]], list[Equation], dict[int, int]]:
    """Supports (nodes, component, mm), equations, and the node that each reference node stands for.

    held: components (0 to 5) of nodes that supports hold, with their displacements. ValueError where a
    reference node may turn.
    """
    supports, equations, stands = list[tuple[list[int], int, float]](), list[Equation](), dict[int, int]()
    for joint in joints:
        own = held.get(joint.reference, {})
        if not {3, 4, 5} <= set(own) or any(own[d] for d in (3, 4, 5)):
            raise ValueError(
                f"{joint.place}: *{joint.keyword}: its reference node {joint.reference} may turn, which is "
                f"not solved for; hold it by *BOUNDARY with {joint.reference}, 4, 6, or leave "
                f"*{joint.keyword} out and hold or load the nodes themselves"
            )
        nodes = [n for n in dict.fromkeys(joint.nodes) if n != joint.reference]
        stands.setdefault(joint.reference, nodes[0] if nodes else joint.reference)
        for d in joint.components:
            if d in own:
                supports.append((nodes, d, own[d]))
            else:
                first = stands[joint.reference]
                equations += [Equation(((n, d, 1.0), (first, d, -1.0))) for n in nodes if n != first]
    return supports, equations, stands
