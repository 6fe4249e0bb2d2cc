"""Closest point of a curved face to a given point, by Newton's method, compiled by numba.

A face is a polynomial x(s, t) = sum of P_k s^i t^j with k = 3 i + j, for every kind of element. At the
closest point x - y is normal to the face (Konyukhov & Schweizerhof 2006, doi 10.1007/s00466-005-0028-4, on
its existence).
"""

from typing import NamedTuple

import numpy as np

from fe.element import Array, Element, Integers
from fe.terms import machine_code, part

TURNS = 20  # of Newton's method at most: it takes 4
EDGE = 0.05  # beyond its edges a face still serves, of half its length: no point falls between two faces
BEHIND = 1e-3  # of half a face's length: how far behind a face a point may lie at rest and still touch it


class Candidates(NamedTuple):
    """Slave faces (s,) with the positions y (s, q, 3) mm of their points, unit normals (s, q, 3), positions
    at_rest (s, q, 3) mm; candidates for contact: master[indptr[k] : indptr[k + 1]]."""

    slave: Integers
    y: Array
    normal: Array
    at_rest: Array
    indptr: Integers
    master: Integers


def polynomials(element: Element) -> Array:
    """Coefficients (9, m) of the shape functions of an element's face over the powers s^i t^j."""
    half = (0.0, 0.5, 1.0) if element.simplex else (-1.0, 0.0, 1.0)
    powers = [(i, j) for i in range(3) for j in range(3) if not element.simplex or i + j < 3]
    st = np.array([(s, t) for s in half for t in half if not element.simplex or s + t <= 1])
    values = np.stack([st[:, 0] ** i * st[:, 1] ** j for i, j in powers], axis=1)
    out = np.zeros((9, len(element.faces[0])))
    out[[3 * i + j for i, j in powers]] = np.linalg.solve(values, element.on_face(st)[0])
    return out


def powers(s: Array, t: Array) -> Array:
    """Powers s^i t^j (6, k, 9) at coordinates s, t (k,), and their derivatives by s, t, ss, st, tt.

    >>> powers(np.array([2.0]), np.array([3.0]))[0]
    array([[ 1.,  3.,  9.,  2.,  6., 18.,  4., 12., 36.]])
    """
    ones, none = np.ones_like(s), np.zeros_like(s)

    def row(x: Array, order: int) -> Array:
        return np.stack([(ones, x, x * x), (none, ones, 2 * x), (none, none, 2 * ones)][order], axis=-1)

    orders = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    return np.stack([np.einsum("ki,kj->kij", row(s, a), row(t, b)).reshape(-1, 9) for a, b in orders])


@part
def _place(P: Array, s: float, t: float, out: Array) -> None:
    """Fill out (6, 3) with x and its derivatives by s, t, ss, st, tt."""
    for c in range(3):
        a = P[0, c] + s * (P[3, c] + s * P[6, c])
        b = P[1, c] + s * (P[4, c] + s * P[7, c])
        d = P[2, c] + s * (P[5, c] + s * P[8, c])
        b_s, d_s = P[4, c] + 2 * s * P[7, c], P[5, c] + 2 * s * P[8, c]
        out[0, c] = a + t * (b + t * d)
        out[1, c] = P[3, c] + 2 * s * P[6, c] + t * (b_s + t * d_s)
        out[2, c] = b + 2 * t * d
        out[3, c] = 2 * (P[6, c] + t * (P[7, c] + t * P[8, c]))
        out[4, c] = b_s + 2 * t * d_s
        out[5, c] = 2 * d


@part
def _dot(a: Array, b: Array) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def _upright(x: Array, n: Array) -> None:
    """Fill n (3,) with the outward unit normal at a face point x (6, 3)."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        n[i] = x[1, j] * x[2, k] - x[1, k] * x[2, j]
    size = max(np.sqrt(_dot(n, n)), 1e-300)
    for i in range(3):
        n[i] /= size


@part
def _solved(P: Array, y: Array, simplex: bool, x: Array, apart: Array, st: Array) -> bool:
    """True if the closest point, at coordinates st (2,), was found; fills x (6, 3) there, and y - x."""
    st[0] = st[1] = 1 / 3 if simplex else 0.0
    for turn in range(TURNS):
        _place(P, st[0], st[1], x)
        for c in range(3):
            apart[c] = y[c] - x[0, c]
        bend = 1.0 if turn > 0 else 0.0  # far away the curvature leads astray
        a = _dot(x[1], x[1]) - bend * _dot(apart, x[3])
        b = _dot(x[1], x[2]) - bend * _dot(apart, x[4])
        d = _dot(x[2], x[2]) - bend * _dot(apart, x[5])
        det = a * d - b * b
        if not (det > 0 and a > 0):
            a, b, d = _dot(x[1], x[1]), _dot(x[1], x[2]), _dot(x[2], x[2])
            det = a * d - b * b
            if not det > 0:
                return False
        f, g = _dot(apart, x[1]), _dot(apart, x[2])
        ds, dt = (d * f - b * g) / det, (a * g - b * f) / det
        st[0] += min(max(ds, -1.0), 1.0)
        st[1] += min(max(dt, -1.0), 1.0)
        if abs(st[0]) > 4 or abs(st[1]) > 4:
            return False
        if abs(ds) + abs(dt) < 1e-13:
            return True
    return abs(ds) + abs(dt) < 1e-9


@part
def _within(simplex: bool, st: Array) -> bool:
    """True if coordinates st (2,) lie on the face, extended by EDGE."""
    if simplex:
        return min(st[0], st[1], 1 - st[0] - st[1]) > -EDGE / 2
    return max(abs(st[0]), abs(st[1])) < 1 + EDGE


@part
def _far(ball: Array, y: Array, touch: float) -> bool:
    """True if a point cannot touch a face, by the face's bounding sphere and height."""
    square = along = 0.0
    for i in range(3):
        square += (y[i] - ball[i]) ** 2
        along += (y[i] - ball[i]) * ball[3 + i]
    return along > ball[7] + touch or square - along**2 > ball[6] ** 2


@machine_code
def nearest(
    near: Candidates, ball: Array, P: Array, rest: Array, simplex: bool, touch: float,
    which: Integers, st: Array, depth: Array,
) -> None:
    """Fill, for every point (s, q), the face in contact or -1, its coordinates st (s, q, 2), and the depth
    (s, q) mm, which is above -touch.

    ball (f, 8): middle, normal, radius and height of every face in mm. P, rest (f, 9, 3) mm: polynomials of
    the faces, deformed and at rest. In contact is the nearest face that faces the point's own face, had the
    point in front of it at rest, and is penetrated by less than its length.
    """
    x, x0, n, n0 = np.empty((6, 3)), np.empty((6, 3)), np.empty(3), np.empty(3)
    apart, local = np.empty(3), np.empty(2)
    for k in range(len(near.slave)):
        for q in range(near.y.shape[1]):
            which[k, q], best = -1, 1e300
            for c in range(near.indptr[k], near.indptr[k + 1]):
                m = near.master[c]
                if _far(ball[m], near.y[k, q], touch):
                    continue
                if not _solved(P[m], near.y[k, q], simplex, x, apart, local) or not _within(simplex, local):
                    continue
                _upright(x, n)
                d = -_dot(apart, n)
                long = 2 * np.sqrt(max(_dot(x[1], x[1]), _dot(x[2], x[2])))
                if d <= -touch or d > long or abs(d) >= best or _dot(n, near.normal[k, q]) >= 0:
                    continue
                _place(rest[m], local[0], local[1], x0)
                _upright(x0, n0)
                for i in range(3):
                    apart[i] = near.at_rest[k, q, i] - x0[0, i]
                if _dot(apart, n0) < -BEHIND * long / 2:
                    continue
                which[k, q], best, depth[k, q] = m, abs(d), d
                st[k, q, 0], st[k, q, 1] = local[0], local[1]
