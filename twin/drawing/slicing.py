"""Cuts an undeformed mesh with a plane: polygons of the material that the plane meets."""

from itertools import permutations

import numpy as np

from fe import Case
from fe.element import HEX27, Integers
from twin.targets import Array

ASIDE = 1e-6  # of the mesh's size: by so much a plane is moved off nodes that lie on it
_EDGES = np.array([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])


def cut(case: Case, *, axis: int, place: float) -> list[Array]:
    """Polygons (k, 2) in mm where the plane x[axis] = place, in mm, meets the elements; the other two axes in
    their order. Curved elements are taken as two straight ones in each direction."""
    low, high = case.nodes[:, axis].min(), case.nodes[:, axis].max()
    aside = ASIDE * float(high - low)
    place = float(np.clip(place + 0.37 * aside, low + aside, high - aside))
    X = case.nodes[case.connectivity]
    X = X[(X[..., axis].min(axis=1) < place) & (X[..., axis].max(axis=1) > place)]
    tets = _tetrahedra(case, X)
    tets = tets[(tets[..., axis].min(axis=1) < place) & (tets[..., axis].max(axis=1) > place)]
    keep = [k for k in range(3) if k != axis]
    return [_polygon(tet, axis, place)[:, keep] for tet in tets]


def _tetrahedra(case: Case, X: Array) -> Array:
    """Straight tetrahedra (t, 4, 3) that fill elements X (e, n, 3)."""
    kind = case.element
    if kind.simplex:
        return X[:, :4]
    grid = np.einsum("qa,eai->eqi", kind.shape(HEX27.local)[0], X)  # (e, 27, 3)
    return grid[:, _PARTS].reshape(-1, 4, 3)


def _parts() -> Integers:
    """The corners (48, 4) of six tetrahedra in each of the eight parts of a hexahedron of 27 nodes."""
    found = []
    for start in np.ndindex(2, 2, 2):
        for order in permutations(range(3)):
            corner = np.array(start)
            path = [corner]
            for axis in order:
                corner = corner + np.eye(3, dtype=np.int64)[axis]
                path.append(corner)
            found.append(np.array(path) @ np.array([1, 3, 9]))
    return np.array(found)


_PARTS = _parts()


def _polygon(tet: Array, axis: int, place: float) -> Array:
    """The corners (3 or 4, 3) in turn of the cut through one tetrahedron (4, 3)."""
    above = tet[:, axis] - place
    ends = _EDGES[above[_EDGES[:, 0]] * above[_EDGES[:, 1]] < 0]
    part = above[ends[:, 0]] / (above[ends[:, 0]] - above[ends[:, 1]])
    points = tet[ends[:, 0]] + part[:, None] * (tet[ends[:, 1]] - tet[ends[:, 0]])
    flat = np.delete(points - points.mean(axis=0), axis, axis=1)
    return np.asarray(points[np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))])
