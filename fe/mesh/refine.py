"""The structure on a finer or richer mesh, with its geometry, sets, surfaces and supports.

Children are placed by their parent's own shape functions. Polynomials of every element's kind go over into
polynomials of that kind in each part, so that the geometry is exact, curved faces included.
"""

from dataclasses import replace

import numpy as np

from fe.case import Block, Case, Support
from fe.element import ELEMENTS, HEX27, Array, Element, Flags, Integers, barycentric

# A tetrahedron's eight parts, by its corners 0 .. 3 and the middles of their edges (Bey 1995, doi
# 10.1007/BF02238487).
_PARTS = (
    ("0", "01", "02", "03"), ("01", "1", "12", "13"), ("02", "12", "2", "23"), ("03", "13", "23", "3"),
    ("01", "02", "03", "13"), ("01", "02", "12", "13"), ("02", "03", "13", "23"), ("02", "12", "13", "23"),
)  # fmt: skip
_UNIT = 512  # shape functions at the children's nodes are whole multiples of 1 / _UNIT


def refined(case: Case) -> Case:
    """The case with every element divided into eight of its type. Old nodes keep their labels.

    >>> from fe import Lattice, Material, finger_case
    >>> case = finger_case(Material(C10=0.1), lattice=Lattice(per_bellow=1))
    >>> len(refined(case).connectivity) == 8 * len(case.connectivity)
    True
    """
    return _divided(case, case.element, _parts(case.element))


def enriched(case: Case) -> Case:
    """The case with 27-node hexahedra, or with 10-node tetrahedra in place of 4-node ones, on its own
    geometry. ValueError for elements that cannot be enriched."""
    if case.element.simplex and len(case.element.local) == 4:
        tet = ELEMENTS["C3D10"]
        return _divided(case, tet, tet.local[None])
    if case.element.simplex:
        raise ValueError(f"elements of type {case.element.name}: wanted hexahedra, or C3D4")
    return _divided(case, HEX27, HEX27.local[None])


def _parts(kind: Element) -> Array:
    """The nodes (8, n, 3) of an element's parts in its own coordinates."""
    if not kind.simplex:
        return kind.local / 2 + ELEMENTS["C3D8"].local[:, None] / 2
    corners, out = kind.local[:4], []
    for part in _PARTS:
        x = np.array([corners[[int(c) for c in name]].mean(axis=0) for name in part])
        if np.linalg.det(x[1:] - x[0]) < 0:
            x = x[[0, 2, 1, 3]]
        out.append(barycentric(kind.local) @ x)
    return np.array(out)


def _divided(case: Case, kind: Element, local: Array) -> Case:
    """The case with elements of type `kind` in place of each one, their nodes at `local` (c, n, 3) in it."""
    parents, (children, n, _) = case.connectivity, local.shape
    weights = case.element.shape(local.reshape(-1, 3))[0]  # (c n, m)
    # the same node has the same weights on the same nodes, in whichever element: a linear hash tells them
    numerators = np.rint(weights * _UNIT).astype(np.int64)
    code = np.random.default_rng(0).integers(-(2**62), 2**62, len(case.nodes))
    keys, index, number = np.unique(code[parents] @ numerators.T, return_index=True, return_inverse=True)
    old = np.searchsorted(keys, code * _UNIT)  # places of the old nodes, which are all among the new ones
    order = np.concatenate([old, np.setdiff1d(np.arange(len(keys)), old)])
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    owner, which = np.divmod(index[order], children * n)
    W, rows = weights[which], parents[owner]  # (new, m)
    added = case.labels.max(initial=0) + 1 + np.arange(len(order) - len(case.nodes))

    def spread(values: Array) -> Array:
        return np.asarray(np.einsum("nm,nmi->ni", W, values[rows]), float)

    nodes = spread(case.nodes)
    nodes[: len(case.nodes)] = case.nodes
    sets = {name: _inside(members, W, rows, len(case.nodes)) for name, members in case.node_sets.items()}
    return replace(
        case,
        nodes=nodes,
        labels=np.concatenate([case.labels, added]),
        blocks=(Block(kind.name, place[number].reshape(-1, n)),),
        node_sets=sets,
        element_sets={k: _numbers(e, children) for k, e in case.element_sets.items()},
        surfaces={k: _faces(case.element, kind, weights, f, children) for k, f in case.surfaces.items()},
        supports=tuple(_support(s, case, sets, spread) for s in case.supports),
    )


def _numbers(elements: Integers, children: int) -> Integers:
    return np.asarray((children * elements[:, None] + np.arange(children)).ravel(), np.int64)


def _inside(members: Integers, W: Array, rows: Integers, count: int) -> Integers:
    """Rows of the new nodes in a set: those interpolated from its members alone."""
    member = np.zeros(count, bool)
    member[members] = True
    return np.flatnonzero((member[rows] | (W == 0)).all(axis=1))


def _faces(kind: Element, new: Element, weights: Array, faces: Integers, children: int) -> Integers:
    """Faces (f, 2) of the children that lie on `faces` (k, 2) of their parents."""
    used = (weights != 0).reshape(children, -1, len(kind.local))
    out = []
    for face, corners in enumerate(kind.faces):
        off: Flags = np.ones(len(kind.local), bool)
        off[corners] = False
        on = ~(used & off).any(axis=2)  # (c, n): nodes of the children that lie on the face
        part, face_of_part = np.nonzero(on[:, new.faces].all(axis=2))
        parents = faces[faces[:, 1] == face, 0]
        rows = np.broadcast_arrays(children * parents[:, None] + part, face_of_part)
        out.append(np.stack(rows, axis=-1).reshape(-1, 2))
    return np.concatenate(out)


def _support(s: Support, case: Case, sets: dict[str, Integers], spread: object) -> Support:
    if s.value is None:
        return s
    field = np.zeros_like(case.nodes)
    field[case.node_sets[s.nodes]] = s.value
    return replace(s, value=spread(field)[sets[s.nodes]])  # type: ignore[operator]


def free_faces(case: Case) -> Integers:
    """Faces (f, 2) = (element, face) that belong to a single element: the whole skin."""
    return unshared(case.element, case.connectivity)


def unshared(kind: Element, connectivity: Integers) -> Integers:
    """Faces (f, 2) that belong to a single element, of elements (e, m) of one kind.

    >>> len(unshared(ELEMENTS["C3D8"], np.arange(8)[None]))
    6
    """
    nodes = np.sort(connectivity[:, kind.faces[:, list(kind.corners)]], axis=2)  # (e, faces, corners)
    _, group, count = np.unique(
        nodes.reshape(-1, nodes.shape[2]), axis=0, return_inverse=True, return_counts=True
    )
    alone = np.flatnonzero(count[group.reshape(-1)] == 1)
    return np.stack(np.divmod(alone, len(kind.faces)), axis=1).astype(np.int64)
