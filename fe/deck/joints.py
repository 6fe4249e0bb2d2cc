"""Ties and rigid joints of a deck.

Tied nodes that coincide become one; other tied nodes follow the master's faces. Nodes of a rigid joint move
as its reference node does, which must not turn.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from fe.case import Case, Equation, Tie
from fe.deck.keywords import Place
from fe.deck.meshdraft import MeshDraft
from fe.kernel.tying import slaves

COINCIDENT = 1e-5  # of the longest side: nodes nearer to each other are one place
NEAR = 0.05  # of a master face's size: how far tied nodes may lie apart, as in Abaqus


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
        """This joint in the given components alone."""
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
        fixed = held.get(joint.reference, {})
        if not {3, 4, 5} <= set(fixed) or any(fixed[d] for d in (3, 4, 5)):
            raise ValueError(
                f"{joint.place}: *{joint.keyword}: its reference node {joint.reference} may turn, which is "
                f"not solved for; hold it by *BOUNDARY with {joint.reference}, 4, 6, or leave "
                f"*{joint.keyword} out and hold or load the nodes themselves"
            )
        nodes = [n for n in dict.fromkeys(joint.nodes) if n != joint.reference]
        stands.setdefault(joint.reference, nodes[0] if nodes else joint.reference)
        for d in joint.components:
            if d in fixed:
                supports.append((nodes, d, fixed[d]))
            else:
                leader = stands[joint.reference]
                equations += [Equation(((n, d, 1.0), (leader, d, -1.0))) for n in nodes if n != leader]
    return supports, equations, stands


def of_sheets(mesh: MeshDraft, tie: TieDraft) -> set[int]:
    """Numbers of the sheet elements in a tie's two surfaces; empty for a tie between solids."""
    return {e for name in (tie.slave, tie.master) for e, _ in mesh.surfaces[name] if e in mesh.sheets}


def merged(mesh: MeshDraft, ties: Iterable[TieDraft]) -> dict[int, int]:
    """Nodes of slave surfaces that lie on nodes of their master {slave: master}: they become one there."""
    every = np.array(list(mesh.nodes.values()))
    near, same = COINCIDENT * float(np.ptp(every, axis=0).max()), dict[int, int]()
    for tie in ties:
        slave, master = (np.array(mesh.nodes_on(mesh.surfaces[name])) for name in (tie.slave, tie.master))
        places = [np.array([mesh.nodes[n] for n in labels.tolist()]) for labels in (slave, master)]
        away, index = (np.asarray(x) for x in scipy.spatial.cKDTree(places[1]).query(places[0]))
        for a, b in zip(slave[away <= near].tolist(), master[index[away <= near]].tolist(), strict=True):
            a, b = _last(same, a), _last(same, b)
            if a != b:
                same[a] = b
    return {a: _last(same, a) for a in same}


def _last(same: Mapping[int, int], label: int) -> int:
    while label in same:
        label = same[label]
    return label


def with_one_node(mesh: MeshDraft, same: Mapping[int, int]) -> None:
    """Replace merged nodes {slave: master} in the elements and sets of a mesh."""
    for elements in (mesh.elements, mesh.sheets):
        for e, (kind, row) in elements.items():
            if not same.keys().isdisjoint(row):
                elements[e] = kind, [same.get(n, n) for n in row]
    for members in mesh.node_sets.values():
        members[:] = dict.fromkeys(same.get(n, n) for n in members)


def tied(case: Case, ties: Sequence[TieDraft]) -> Case:
    """The case with its ties as constraints; slave nodes are moved onto the master's faces. Ties whose nodes
    all coincide need none. ValueError for a tie without a slave node near enough to the master."""
    for tie in ties:
        faces = case.face_nodes(tie.master)
        surface_nodes = np.unique(case.face_nodes(tie.slave))
        rest = np.setdiff1d(surface_nodes, faces)
        if not len(rest):
            continue
        corners = case.nodes[faces[:, list(case.element.corners)]]
        size = float(np.linalg.norm(np.ptp(corners, axis=1), axis=1).mean())
        reach = NEAR * size if tie.tolerance is None else tie.tolerance
        joint = Tie(tie.slave, tie.master, reach)
        followers, _, _, places = slaves(case, joint)
        if not len(followers):
            if len(rest) < len(surface_nodes):
                continue
            raise ValueError(
                f"{tie.place}: *TIE of {tie.slave} to {tie.master}: no slave node lies within {reach:.3g} of "
                "the master; wanted surfaces that touch; state POSITION TOLERANCE, or move the part"
            )
        nodes = case.nodes.copy()
        nodes[followers] = places
        case = replace(case, nodes=nodes, ties=(*case.ties, joint))
    return case
