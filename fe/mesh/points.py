"""Sparse operator that interpolates nodal values at material points; nearest point of a body."""

import numpy as np
import scipy.sparse as sp

from fe.case import Case
from fe.element import Array, Element

OUTSIDE = 0.02  # local units, of which an element has two
ROUNDING_MM = 1e-9


def interpolation(case: Case, points: Array) -> sp.csr_matrix:
    """Operator (p, n) with the shape functions of undeformed `points` (p, 3) mm.

    Raises ValueError for a point more than 1e-2 of its element's size outside the structure: meshes of one
    geometry differ by as much.

    >>> from fe import Lattice, Material, finger_case
    >>> case = finger_case(Material(C10=0.1), lattice=Lattice(per_bellow=1))
    >>> (interpolation(case, np.array([[110.0, 11.5, 0.0]])) @ case.nodes).round(6)
    array([[110. ,  11.5,   0. ]])
    """
    rows, cols, values = [], [], []
    for r, x in enumerate(np.atleast_2d(points)):
        element, N = _locate(case, x)
        rows += [r] * len(N)
        cols += list(case.connectivity[element])
        values += list(N)
    return sp.csr_matrix((values, (rows, cols)), shape=(len(np.atleast_2d(points)), len(case.nodes)))


def _locate(case: Case, x: Array) -> tuple[int, Array]:
    X, kind = case.nodes[case.connectivity], case.element
    margin = 0.05 * np.ptp(X, axis=1)
    near = ((X.min(1) - margin <= x) & (X.max(1) + margin >= x)).all(axis=1)
    for nearest_node in (False, True):  # in an element with a bent wall Newton may find another place
        for element in np.flatnonzero(near):
            node = np.linalg.norm(X[element] - x, axis=1).argmin()
            xi = _inverse(kind, X[element], x, kind.local[node] if nearest_node else None)
            if kind.inside(xi) < OUTSIDE:
                return int(element), kind.shape(xi[None])[0][0]
    raise ValueError(
        f"point ({x[0]:g}, {x[1]:g}, {x[2]:g}) mm: not in the structure, wanted a material point of it "
        "(mm, undeformed); correct the point's position or its node"
    )


def nearest(case: Case, x: Array) -> Array:
    """Material point (3,) mm of the structure nearest to x (3,) mm; x itself inside the structure."""
    X, kind = case.nodes[case.connectivity], case.element
    box = np.linalg.norm(np.maximum(np.maximum(X.min(1) - x, x - X.max(1)), 0.0), axis=1)
    best, away = x, np.inf
    for e in np.argsort(box, kind="stable"):
        if box[e] >= away:
            break
        point = kind.shape(_within(kind, X[e], x)[None])[0][0] @ X[e]
        if np.linalg.norm(point - x) < away:
            best, away = point, float(np.linalg.norm(point - x))
    return x if away < ROUNDING_MM else best


def _within(kind: Element, X: Array, x: Array) -> Array:
    """Local coordinates of the element's point nearest to x; in a tetrahedron, where the line from its centre
    to x leaves it."""
    xi = _inverse(kind, X, x)
    if kind.simplex:
        middle = kind.local.mean(axis=0)
        ways = middle + np.linspace(0.0, 1.0, 1001)[:, None] * (xi - middle)
        return np.asarray(max(enumerate(ways), key=lambda way: (kind.inside(way[1]) <= 0, way[0]))[1])
    xi = np.clip(xi, -1.0, 1.0)
    for _ in range(5):  # along the faces that it lies on
        N, dN = kind.shape(xi[None])
        free = np.abs(xi) < 1.0
        slope = np.einsum("ai,aJ->iJ", X, dN[0])[:, free]
        xi[free] = np.clip(xi[free] + np.linalg.lstsq(slope, x - N[0] @ X, rcond=None)[0], -1.0, 1.0)
    return xi


def _inverse(kind: Element, X: Array, x: Array, start: Array | None = None) -> Array:
    """Local coordinates of x in one element, by Newton's method from a start, by default its centre."""
    xi = kind.local.mean(axis=0) if start is None else start
    for _ in range(20):
        N, dN = kind.shape(xi[None])
        step = np.linalg.lstsq(np.einsum("ai,aJ->iJ", X, dN[0]), x - N[0] @ X, rcond=None)[0]
        xi = np.clip(xi + step, -2, 2)
        if np.abs(step).max() < 1e-12:
            break
    return xi


SAMPLES = 9  # points of a face in each direction, among which the search for its nearest place begins
SHRINK = 30  # times the search's step is halved: from a quarter to 1e-10 of a face


def nearest_on_faces(kind: Element, faces: Array, x: Array) -> Array:
    """Point (3,) mm nearest to x (3,) mm on faces (f, m, 3) mm of elements of one kind.

    >>> from fe.element import ELEMENTS
    >>> square = np.array([[[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]])
    >>> nearest_on_faces(ELEMENTS["C3D8"], square, np.array([0.5, 3.0, 1.0])).round(6)
    array([0.5, 2. , 0. ])
    """
    grid = np.linspace(0.0 if kind.simplex else -1.0, 1.0, SAMPLES)
    st = kind.clipped_to_face(np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2))
    away = np.linalg.norm(np.einsum("km,fmi->fki", kind.on_face(st)[0], faces) - x, axis=2)
    near = np.argsort(away.min(axis=1))[:SAMPLES]  # a neighbour of the face with the nearest sample, perhaps
    return _narrowed(kind, faces[near], x, st[away[near].argmin(axis=1)])


def _narrowed(kind: Element, faces: Array, x: Array, st: Array) -> Array:
    """Point (3,) nearest to x on faces (f, m, 3) mm, by grid searches of shrinking size about face
    coordinates st (f, 2)."""
    around = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 5)] * 2), axis=-1).reshape(-1, 2)
    every = np.arange(len(faces))
    for step in 0.25 * 0.5 ** np.arange(SHRINK):
        tried = kind.clipped_to_face((st[:, None] + step * around).reshape(-1, 2))
        N = kind.on_face(tried)[0].reshape(len(faces), len(around), -1)
        places = N @ faces
        away = np.linalg.norm(places - x, axis=2)
        best = away.argmin(axis=1)
        st = tried.reshape(*places.shape[:2], 2)[every, best]
    face = int(away.min(axis=1).argmin())
    return np.asarray(places[face, best[face]])
