"""Division of hexahedra, wedges and tetrahedra of a mesh into 10-node tetrahedra on its nodes.

Every element is a cone from its node of the smallest label over the faces that do not contain it; every
square is cut along the diagonal from its own smallest label, so that neighbours match (Dompierre, Labbe,
Vallet & Camarero 1999, How to subdivide pyramids, prisms and hexahedra into tetrahedra, section 3).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from fe.element import ELEMENTS, Array, Integers


@dataclass(frozen=True)
class Solid:
    """A shape of elements: its corners on each face in a turn, and the pairs of corners between which its
    middle nodes lie."""

    faces: tuple[tuple[int, ...], ...]
    edges: tuple[tuple[int, int], ...]

    @property
    def corners(self) -> int:
        """Number of corners.

        >>> SOLIDS["C3D15"].corners, len(SOLIDS["C3D15"].edges)
        (6, 9)
        """
        return len({c for face in self.faces for c in face})

    def on_face(self, face: int) -> list[int]:
        """The nodes on a face, middle nodes behind the corners."""
        on = self.faces[face]
        return [*on, *(k for k, pair in enumerate(self.edges, self.corners) if set(pair) <= set(on))]


def _of(kind: str) -> Solid:
    """The shape of a type of element."""
    element = ELEMENTS[kind]
    corners = len({int(n) for face in element.faces for n in face[: len(element.corners)]})
    ends = [(a, b) for a, b in combinations(range(corners), 2)]
    edges = [
        next((a, b) for a, b in ends if np.allclose(element.local[a] + element.local[b], 2 * middle))
        for middle in element.local[corners:]
    ]
    faces = tuple(tuple(int(n) for n in face[list(element.corners)]) for face in element.faces)
    return Solid(faces, tuple(edges))


WEDGE = ((0, 1, 2), (3, 5, 4), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))  # S1 .. S5 of C3D6
WEDGE_EDGES = ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
SOLIDS = {
    **{kind: _of(kind) for kind in ELEMENTS if kind != "hex27"},
    **{kind: Solid(WEDGE, ()) for kind in ("C3D6", "C3D6H")},
    **{kind: Solid(WEDGE, WEDGE_EDGES) for kind in ("C3D15", "C3D15H")},
}


@dataclass(frozen=True)
class Divided:
    """Result of a division: tetrahedra by node labels (t, 10) and their parent elements (t,), by row. faces
    (k, 4): face of an element, (row, face), and face of a tetrahedron on it, (row, face). made: new nodes,
    each with its place (3,) mm and the labels of the corners between which it lies."""

    connectivity: Integers
    parents: Integers
    faces: Integers
    made: Mapping[int, tuple[Array, tuple[int, ...]]]


def divided(cells: Sequence[tuple[str, Sequence[int]]], places: Mapping[int, Array]) -> Divided:
    """Tetrahedra of elements (type of SOLIDS, node labels), with places {label: (3,) mm}.

    >>> cube = {n: x for n, x in enumerate(ELEMENTS["C3D8"].local)}
    >>> len(divided([("C3D8", range(8))], cube).parents)
    6
    """
    middles: dict[tuple[int, int], int] = {}
    for kind, row in cells:
        solid = SOLIDS[kind]
        for (a, b), middle in zip(solid.edges, row[solid.corners :], strict=True):
            middles[_pair(row[a], row[b])] = middle
    new_nodes: dict[int, tuple[Array, tuple[int, ...]]] = {}
    free = 1 + max(places)
    connectivity, parents, faces = list[list[int]](), list[int](), list[tuple[int, int, int, int]]()
    order = ELEMENTS["C3D10"]
    edges = SOLIDS["C3D10"].edges
    for number, (kind, row) in enumerate(cells):
        solid = SOLIDS[kind]
        x = np.array([places[n] for n in row])
        for four in _cone(solid, row):
            if np.linalg.det(x[list(four[1:])] - x[four[0]]) < 0:
                four = (four[0], four[2], four[1], four[3])
            tet = [row[c] for c in four]
            for a, b in edges:
                pair = _pair(tet[a], tet[b])
                if pair not in middles:
                    middles[pair] = free
                    new_nodes[free] = _between(solid, row, x, four[a], four[b])
                    free += 1
                tet.append(middles[pair])
            for f, corners in enumerate(order.faces[:, :3]):
                on = {four[c] for c in corners}
                there = (k for k, face in enumerate(solid.faces) if on <= set(face))
                faces += [(number, k, len(parents), f) for k in there]
            connectivity.append(tet)
            parents.append(number)
    return Divided(
        np.array(connectivity, np.int64), np.array(parents, np.int64), np.array(faces, np.int64), new_nodes
    )


def _pair(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _cone(solid: Solid, row: Sequence[int]) -> list[tuple[int, int, int, int]]:
    """Tetrahedra of an element by its corners."""
    top = min(range(solid.corners), key=row.__getitem__)
    out = []
    for face in solid.faces:
        if top in face:
            continue
        start = min(range(len(face)), key=lambda k: row[face[k]])
        turned = face[start:] + face[:start]
        out += [(top, turned[0], turned[k], turned[k + 1]) for k in range(1, len(face) - 1)]
    return out


def _between(
    solid: Solid, row: Sequence[int], x: Array, a: int, b: int
) -> tuple[Array, tuple[int, ...]]:
    """Place of a new node between two corners of an element at x (n, 3) mm, and the corners around it: two of
    an edge, four of a square, or all of the element (shape functions of 8 or 20 nodes)."""
    edge = {frozenset(pair) for face in solid.faces for pair in zip(face, (*face[1:], face[0]), strict=True)}
    if frozenset((a, b)) in edge:
        corners: tuple[int, ...] = (a, b)
    else:
        every = tuple(range(solid.corners))
        corners = next((face for face in solid.faces if {a, b} <= set(face)), every)
    middles = [k + solid.corners for k, pair in enumerate(solid.edges) if set(pair) <= set(corners)]
    place = x[list(corners)].mean(axis=0)
    if middles and len(corners) > 2:
        # 4 corners: weights -1/4 and 4 x 1/2; 8 corners: -1/4 and 12 x 1/4
        place = x[middles].sum(axis=0) * (2.0 / len(corners) if len(corners) == 4 else 0.25) - 0.25 * x[
            list(corners)
        ].sum(axis=0)
    return place, tuple(row[c] for c in corners)
