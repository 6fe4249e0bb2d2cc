"""Material points -> the sparse operator that interpolates nodal values there."""

import numpy as np
import scipy.sparse as sp

from fe.case import Case
from fe.element import Array, Element


def interpolation(case: Case, points: Array) -> sp.csr_matrix:
    """Operator (p, n) with the shape functions of undeformed `points` (p, 3) mm.

    Raises ValueError for a point more than 1e-3 of its element's size outside the structure.
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
    for element in np.flatnonzero(near):
        xi = _inverse(kind, X[element], x)
        if kind.inside(xi) < 1e-3:
            return int(element), kind.shape(xi[None])[0][0]
    raise ValueError(
        f"point ({x[0]:g}, {x[1]:g}, {x[2]:g}) mm: not in the structure, wanted a material point of it "
        "(mm, undeformed); correct the point's position or its node"
    )


def _inverse(kind: Element, X: Array, x: Array) -> Array:
    """Local coordinates of x in one element, by Newton's method from its centre."""
    xi = kind.local.mean(axis=0)
    for _ in range(20):
        N, dN = kind.shape(xi[None])
        step = np.linalg.lstsq(np.einsum("ai,aJ->iJ", X, dN[0]), x - N[0] @ X, rcond=None)[0]
        xi = np.clip(xi + step, -2, 2)
        if np.abs(step).max() < 1e-12:
            break
    return xi
