"""Element types: shape functions, faces, quadrature and pressure modes, by name.

`hex27` is the project's own: 27 nodes (tri-quadratic, Q2), numbered as the tensor product: node i + 3 j + 9 k
sits at (xi, eta, zeta) = (i - 1, j - 1, k - 1). The others carry Abaqus names, node orders and face numbers.
All are mixed: displacement and pressure modes, which belong to one element alone, or, in the 10-node
tetrahedron, to the corners of the mesh (Taylor & Hood 1973, doi 10.1016/0045-7930(73)90027-3).
"""

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
Shape = Callable[[Array], tuple[Array, Array]]
Modes = Literal["linear", "constant", "points", "corners"]


@dataclass(frozen=True, eq=False)
class Element:
    """One type of element.

    local (n, 3): coordinates of its nodes; shape: values (k, n) and gradients (k, n, 3) at points (k, 3);
    points (q, 3) and weights (q,): quadrature; faces (f, m): local nodes of each face, all in one order, of
    which `corners` are its corners in a turn to the right about the outward normal; face_points (k, 2) and
    face_weights (k,): their quadrature; modes: of the pressure (see `pressure_modes`).
    """

    name: str
    _: KW_ONLY
    local: Array
    shape: Shape
    points: Array
    weights: Array
    faces: Integers
    corners: tuple[int, ...]
    face_points: Array
    face_weights: Array
    modes: Modes

    @property
    def shared(self) -> bool:
        """True if pressure unknowns lie at corners shared by elements, so that they cannot be eliminated
        elementwise."""
        return self.modes == "corners"

    @property
    def simplex(self) -> bool:
        """True for a tetrahedron."""
        return len(self.corners) == 3

    @cached_property
    def at_points(self) -> tuple[Array, Array]:
        """Shape functions (q, n) and their gradients (q, n, 3) at the quadrature points.

        >>> N, dN = HEX27.at_points
        >>> N.shape, dN.shape, bool(np.allclose(N.sum(axis=1), 1.0))
        ((27, 27), (27, 27, 3), True)
        """
        return self.shape(self.points)

    def pressure_modes(self, x: Array) -> Array:
        """Values (e, q, m) of the pressure modes; x (e, q, 3): quadrature points about the element's centre,
        in units of its size.

        linear: 1, x, y, z. constant: 1. points: a value at each quadrature point. corners: linear between the
        values at the corners.
        """
        constant = np.ones((*x.shape[:2], 1))
        if self.modes == "linear":
            return np.concatenate([constant, x], axis=-1)
        if self.modes == "constant":
            return constant
        fixed = np.eye(len(self.points)) if self.modes == "points" else barycentric(self.points)
        return np.broadcast_to(fixed, (len(x), *fixed.shape)).copy()

    def on_face(self, st: Array) -> tuple[Array, Array]:
        """Values (k, m) and gradients (k, m, 2) of a face's shape functions at face coordinates st (k, 2).

        They are the solid's shape functions on its first face: all faces list their nodes in one order.

        >>> ELEMENTS["C3D8"].on_face(np.array([[0.0, 0.0]]))[0]
        array([[0.25, 0.25, 0.25, 0.25]])
        """
        corners = self.local[self.faces[0]][list(self.corners)]
        s, t = np.asarray(st).T
        if self.simplex:
            weights = np.stack([1 - s - t, s, t], axis=1)
            slopes = np.broadcast_to([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]], (len(s), 2, 3))
        else:
            a, b = np.array([-1.0, 1.0, 1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0])
            u, v = 1 + np.outer(s, a), 1 + np.outer(t, b)
            weights, slopes = u * v / 4, np.stack([a * v / 4, u * b / 4], axis=1)
        value, gradient = self.shape(weights @ corners)
        along = slopes @ corners  # (k, 2, 3)
        return value[:, self.faces[0]], gradient[:, self.faces[0]] @ np.swapaxes(along, 1, 2)

    def clipped_to_face(self, st: Array) -> Array:
        """Face coordinates (k, 2), clipped to the face.

        >>> HEX27.clipped_to_face(np.array([[1.2, -0.3]]))
        array([[ 1. , -0.3]])
        """
        if not self.simplex:
            return np.clip(st, -1.0, 1.0)
        st = np.clip(st, 0.0, 1.0)
        return st / np.maximum(st.sum(axis=1, keepdims=True), 1.0)

    def inside(self, xi: Array) -> float:
        """Distance of a local point (3,) outside the element, in local units; not positive inside."""
        if self.simplex:
            return float(max(-xi.min(), xi.sum() - 1))
        return float(np.abs(xi).max()) - 1


def gauss(dimensions: int, order: int = 3) -> tuple[Array, Array]:
    """Points (k, d) and weights (k,) of the tensor Gauss rule with `order` points a direction on [-1, 1]**d.

    >>> points, weights = gauss(2, 2)
    >>> points.shape, float(weights.sum())
    ((4, 2), 4.0)
    """
    x, w = np.polynomial.legendre.leggauss(order)
    points = np.stack(np.meshgrid(*[x] * dimensions, indexing="ij"), axis=-1).reshape(-1, dimensions)
    weights = np.prod(
        np.stack(np.meshgrid(*[w] * dimensions, indexing="ij"), axis=-1).reshape(-1, dimensions), -1
    )
    return points, weights


def _lagrange(x: Array) -> tuple[Array, Array]:
    value = np.stack([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2], axis=-1)
    slope = np.stack([x - 0.5, -2 * x, x + 0.5], axis=-1)
    return value, slope


def _q2(xi: Array) -> tuple[Array, Array]:
    """27-node hexahedron."""
    (a, da), (b, db), (c, dc) = (_lagrange(np.asarray(xi)[:, d]) for d in range(3))

    def product(f: Array, g: Array, h: Array) -> Array:
        return np.einsum("nk,nj,ni->nkji", h, g, f).reshape(len(f), 27)

    gradient = np.stack([product(da, b, c), product(a, db, c), product(a, b, dc)], axis=-1)
    return product(a, b, c), gradient


def _serendipity(nodes: Array) -> Shape:
    """8- or 20-node hexahedron with local nodes (n, 3)."""

    def shape(xi: Array) -> tuple[Array, Array]:
        x = np.asarray(xi)[:, None, :]
        sign = nodes[None]  # (1, n, 3), 0 along the edge of a middle node
        middle = (sign == 0).any(-1)
        factor = np.where(sign == 0, 1 - x * x, 1 + sign * x)
        slope = np.where(sign == 0, -2 * x, sign + 0 * x)
        last = (sign * x).sum(-1) - 2 if len(nodes) == 20 else np.ones(factor.shape[:2])
        scale = np.where(middle, 0.25, 0.125)
        product = factor.prod(-1)
        value = scale * product * np.where(middle, 1.0, last)
        gradient = np.empty_like(factor)
        for d in range(3):
            others = slope[..., d] * factor[..., d - 1] * factor[..., d - 2]
            corner_slope = product * sign[..., d] if len(nodes) == 20 else 0.0
            gradient[..., d] = scale * np.where(middle, others, others * last + corner_slope)
        return value, gradient

    return shape


def barycentric(xi: Array) -> Array:
    """Barycentric coordinates (k, 4) of local points (k, 3) in a tetrahedron.

    >>> barycentric(np.array([[0.25, 0.25, 0.25]]))
    array([[0.25, 0.25, 0.25, 0.25]])
    """
    return np.column_stack([1 - xi.sum(axis=1), xi])


_TET_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))


def _quadratic_tet(xi: Array) -> tuple[Array, Array]:
    """10-node tetrahedron."""
    L = barycentric(np.asarray(xi))
    dL = np.vstack([-np.ones(3), np.eye(3)])
    value = np.column_stack([L * (2 * L - 1)] + [4 * L[:, a] * L[:, b] for a, b in _TET_EDGES])
    corner = (4 * L - 1)[..., None] * dL
    edges = [4 * (L[:, a, None] * dL[b] + L[:, b, None] * dL[a]) for a, b in _TET_EDGES]
    return value, np.concatenate([corner, np.stack(edges, axis=1)], axis=1)


# Abaqus: floor 1 2 3 4, ceiling 5 6 7 8, then the middles of their edges and of the pillars.
_SQUARE = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
_HEX8 = np.array([(*xy, z) for z in (-1, 1) for xy in _SQUARE], float)
_HEX_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
_HEX20: Array = np.vstack([_HEX8, [(_HEX8[a] + _HEX8[b]) / 2 for a, b in _HEX_EDGES]])
_HEX_FACES = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))  # S1 .. S6
_TET10 = np.vstack([np.zeros(3), np.eye(3)])
_TET10 = np.vstack([_TET10, [(_TET10[a] + _TET10[b]) / 2 for a, b in _TET_EDGES]])
_TET_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3))  # S1 .. S4
_TET_POINTS = np.full((4, 3), (5 - np.sqrt(5)) / 20)
_TET_POINTS[np.arange(1, 4), np.arange(3)] = (5 + 3 * np.sqrt(5)) / 20
# Six points of degree 4 on the unit triangle (Dunavant 1985, doi 10.1002/nme.1620210612).
_A, _B = 0.445948490915965, 0.091576213509771
_TRIANGLE = np.array(
    [(_A, _A), (1 - 2 * _A, _A), (_A, 1 - 2 * _A), (_B, _B), (1 - 2 * _B, _B), (_B, 1 - 2 * _B)]
)
_TRIANGLE_WEIGHTS = np.repeat([0.223381589678011, 0.109951743655322], 3) / 2


def _with_middles(faces: tuple[tuple[int, ...], ...], edges: object, corners: int) -> Integers:
    """Faces with the middle nodes of their edges behind their corners."""
    number = {frozenset(e): corners + k for k, e in enumerate(edges)}  # type: ignore[arg-type, var-annotated]
    return np.array(
        [[*f, *(number[frozenset((a, b))] for a, b in zip(f, (*f[1:], f[0]), strict=True))] for f in faces]
    )


# The nine nodes of each face of hex27, ordered (s + 3 t) so that d/ds x d/dt points out of the cell.
_LOCAL = np.arange(27).reshape(3, 3, 3)  # [k, j, i]
FACES: Integers = np.array(
    [
        _LOCAL[:, :, 0].T.ravel(),  # xi = -1
        _LOCAL[:, :, 2].ravel(),  # xi = +1
        _LOCAL[:, 0, :].ravel(),  # eta = -1
        _LOCAL[:, 2, :].T.ravel(),  # eta = +1
        _LOCAL[0, :, :].T.ravel(),  # zeta = -1
        _LOCAL[2, :, :].ravel(),  # zeta = +1
    ]
)
_HEX27: Array = np.stack(np.unravel_index(np.arange(27), (3, 3, 3))[::-1], axis=1) - np.ones(3)
_QUAD = (0, 1, 2, 3)


def _rules(volume: tuple[Array, Array], face: tuple[Array, Array]) -> dict[str, Array]:
    """The quadrature of an element, by the names of its fields."""
    return dict(zip(("points", "weights", "face_points", "face_weights"), (*volume, *face), strict=True))


HEX27 = Element(
    "hex27", local=_HEX27, shape=_q2, faces=FACES, corners=(0, 2, 8, 6), modes="linear",
    **_rules(gauss(3), gauss(2)),
)  # fmt: skip


def _hex20(name: str, order: int, modes: Modes) -> Element:
    faces, shape = _with_middles(_HEX_FACES, _HEX_EDGES, 8), _serendipity(_HEX20)
    rules = _rules(gauss(3, order), gauss(2, order))
    return Element(name, local=_HEX20, shape=shape, faces=faces, corners=_QUAD, modes=modes, **rules)


def _hex8(name: str) -> Element:
    rules, faces, shape = _rules(gauss(3, 2), gauss(2, 2)), np.array(_HEX_FACES), _serendipity(_HEX8)
    return Element(name, local=_HEX8, shape=shape, faces=faces, corners=_QUAD, modes="constant", **rules)


def _linear_tet(xi: Array) -> tuple[Array, Array]:
    """4-node tetrahedron."""
    value = barycentric(np.asarray(xi))
    return value, np.broadcast_to(np.vstack([-np.ones(3), np.eye(3)]), (len(value), 4, 3)).copy()


def _tet4(name: str) -> Element:
    """4-node tetrahedron with one integration point, as in Abaqus and CalculiX; its weight is the element's
    volume."""
    rules = _rules((np.full((1, 3), 0.25), np.full(1, 1 / 6)), (np.full((1, 2), 1 / 3), np.full(1, 0.5)))
    faces, local, shape = np.array(_TET_FACES), _TET10[:4], _linear_tet
    return Element(name, local=local, shape=shape, faces=faces, corners=(0, 1, 2), modes="constant", **rules)


def _tet10(name: str) -> Element:
    rules = _rules((_TET_POINTS, np.full(4, 1 / 24)), (_TRIANGLE, _TRIANGLE_WEIGHTS))
    faces, corners = _with_middles(_TET_FACES, _TET_EDGES, 4), (0, 1, 2)
    return Element(
        name, local=_TET10, shape=_quadratic_tet, faces=faces, corners=corners, modes="corners", **rules
    )


ELEMENTS = {
    e.name: e
    for e in (
        HEX27,
        *(_hex20(name, 2, "points") for name in ("C3D20R", "C3D20RH")),
        *(_hex20(name, 3, "linear") for name in ("C3D20", "C3D20H")),
        *(_hex8(name) for name in ("C3D8", "C3D8H")),
        *(_tet10(name) for name in ("C3D10", "C3D10H")),
        *(_tet4(name) for name in ("C3D4", "C3D4H")),
    )
}


def scatter(rows: Integers, values: Array, count: int) -> Array:
    """Sums (count,) of `values` at equal `rows`, two arrays of one size.

    >>> scatter(np.array([0, 2, 0]), np.array([1.0, 5.0, 2.0]), 4)
    array([3., 0., 5., 0.])
    """
    return np.asarray(np.bincount(rows.ravel(), weights=values.ravel(), minlength=count), np.float64)


# Triangles of a face with so many nodes, counter-clockwise from outside: Abaqus lists corners in a turn and
# then the middles of their edges, hex27 row by row.
_CUT = {
    3: [(0, 1, 2)],
    4: [(0, 1, 2), (0, 2, 3)],
    6: [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)],
    8: [(0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 6), (4, 6, 7)],
    9: [(a, *two) for a in (0, 1, 3, 4) for two in ((a + 1, a + 4), (a + 4, a + 3))],
}


def triangles(faces: Integers) -> Integers:
    """Triangles (t, 3) of faces (f, m) of any element, counter-clockwise from outside.

    >>> triangles(np.array([[7, 8, 9, 5]]))
    array([[7, 8, 9],
           [7, 9, 5]])
    """
    return faces[:, np.array(_CUT[faces.shape[1]])].reshape(-1, 3)
