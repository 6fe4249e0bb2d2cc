"""The structure of a case of 27-node hexahedra in Abaqus elements, on its own nodes and labels."""

from dataclasses import replace
from itertools import permutations

import numpy as np

from fe.case import Block, Case
from fe.element import ELEMENTS, FACES, HEX27, Array, Integers, barycentric

_TETS = {name for name, e in ELEMENTS.items() if e.simplex}


def converted(case: Case, kind: str) -> Case:
    """The case in elements of type `kind`, a name of `fe.element.ELEMENTS`.

    Hexahedra keep their number; every hexahedron gives six tetrahedra (Kuhn 1960), number 6 k to 6 k + 5 of
    hexahedron k. Nodes that no element uses are left out. ValueError where tetrahedra of neighbours would not
    match, as on a lattice of type `ring`.

    >>> from fe import Lattice, Material, finger_case
    >>> case = finger_case(Material(C10=0.1), lattice=Lattice(per_bellow=1))
    >>> converted(case, "C3D20RH").connectivity.shape == (len(case.connectivity), 20)
    True
    """
    if kind in _TETS:
        changed = _into_tetrahedra(case, kind)
    else:
        local = _same_places(ELEMENTS[kind].local)
        faces = _same_faces(ELEMENTS[kind].faces, local)
        surfaces = {
            name: np.stack([rows[:, 0], faces[rows[:, 1]]], axis=1) for name, rows in case.surfaces.items()
        }
        changed = replace(case, blocks=(Block(kind, case.connectivity[:, local]),), surfaces=surfaces)
    return without_unused_nodes(changed)


def filled(case: Case, kind: str, u: Array) -> Array:
    """Displacements (k, n, 3) of all nodes of a hex27 case, interpolated from displacements u (k, n, 3) of
    the nodes that hexahedra of type `kind` have.

    Where an element is curved, its other nodes lie a little beside the places that the same coordinates have
    in a hexahedron without them: the field is followed there along its slope, so that a linear one is exact.
    """
    element = ELEMENTS[kind]
    nodes = case.connectivity[:, _same_places(element.local)]
    values, slopes = element.shape(HEX27.local)  # (27, m), (27, m, 3)
    x = case.nodes[nodes]  # (e, m, 3)
    off = case.nodes[case.connectivity] - values @ x  # (e, 27, 3)
    along = np.einsum("imd,emc->eicd", slopes, x)
    weights = values + np.einsum("imd,eid->eim", slopes, np.linalg.solve(along, off[..., None])[..., 0])
    out = np.array(u, float)
    out[:, case.connectivity] = np.einsum("eim,kemc->keic", weights, out[:, nodes])
    return out


def kept_nodes(case: Case, kind: str) -> Integers:
    """Rows (m,) of the nodes of a hex27 case that hexahedra of type `kind` have."""
    return np.unique(case.connectivity[:, _same_places(ELEMENTS[kind].local)])


def _same_places(local: np.ndarray) -> Integers:
    """The nodes of hex27 at the places (n, 3) of another hexahedron's nodes."""
    return np.array([int(np.abs(HEX27.local - x).sum(axis=1).argmin()) for x in local])


def _same_faces(faces: Integers, local: Integers) -> Integers:
    """For each face of hex27 the number of the other element's face that lies on it."""
    return np.array([[set(local[f]) <= set(face) for f in faces].index(True) for face in FACES])


def _into_tetrahedra(case: Case, kind: str) -> Case:
    element, paths = ELEMENTS[kind], []
    for order in permutations(range(3)):  # from corner (-1, -1, -1) to (1, 1, 1) along the axes in this order
        corners = -np.ones((4, 3))
        for step, axis in enumerate(order):
            corners[step + 1 :, axis] = 1
        if np.linalg.det(corners[1:] - corners[0]) < 0:
            corners = corners[[0, 2, 1, 3]]
        paths.append(_same_places(barycentric(element.local) @ corners))
    local = np.array(paths)  # (6, 10 or 4)
    connectivity = case.connectivity[:, local].reshape(-1, local.shape[1])
    _check_conforming(connectivity[:, element.faces[:, :3]].reshape(-1, 3))
    surfaces = {}
    every = [(t, f) for t in range(6) for f in range(4)]
    on_face = [[(t, f) for t, f in every if set(local[t, element.faces[f]]) <= set(face)] for face in FACES]
    for name, rows in case.surfaces.items():
        surfaces[name] = np.array([(6 * e + t, f) for e, face in rows for t, f in on_face[face]], np.int64)
    sets = {name: (6 * rows[:, None] + np.arange(6)).ravel() for name, rows in case.element_sets.items()}
    return replace(case, blocks=(Block(kind, connectivity),), surfaces=surfaces, element_sets=sets)


def _check_conforming(triangles: Integers) -> None:
    """ValueError where two neighbours cut the square between them along different diagonals.

    Then its four triangles are single and share their corners two by two: more than the surface has.
    """
    ordered = np.sort(triangles, axis=1)
    _, rows, count = np.unique(ordered, axis=0, return_index=True, return_counts=True)
    edges = np.sort(ordered[rows[count == 1]][:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=1)
    _, met = np.unique(edges, axis=0, return_counts=True)
    if (met % 2).any() or (count > 2).any() or (met > 2).any():
        raise ValueError(
            "the tetrahedra of neighbouring hexahedra do not fit each other; use a lattice of type block, "
            "or hexahedra"
        )


def without_unused_nodes(case: Case) -> Case:
    """The case without the nodes that belong to no element."""
    used = np.unique(case.connectivity)
    number = np.full(len(case.nodes), -1, np.int64)
    number[used] = np.arange(len(used))
    sets = {name: number[rows][number[rows] >= 0] for name, rows in case.node_sets.items()}
    supports = tuple(
        s if s.value is None else replace(s, value=s.value[number[case.node_sets[s.nodes]] >= 0])
        for s in case.supports
    )
    return replace(
        case,
        nodes=case.nodes[used],
        labels=case.labels[used],
        blocks=tuple(Block(b.type, number[b.connectivity]) for b in case.blocks),
        node_sets=sets,
        supports=supports,
    )
