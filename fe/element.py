"""Reference cube -> shape functions, faces and quadrature of the 27-node (tri-quadratic, Q2) hexahedron.

Local numbering is the tensor product: node i + 3 j + 9 k sits at (xi, eta, zeta) = (i - 1, j - 1, k - 1).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

NODES = 27
# The nine nodes of each face, ordered (s + 3 t) so that d/ds x d/dt points out of the cell.
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


def _lagrange(x: Array) -> tuple[Array, Array]:
    value = np.stack([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2], axis=-1)
    slope = np.stack([x - 0.5, -2 * x, x + 0.5], axis=-1)
    return value, slope


def shape(xi: Array) -> tuple[Array, Array]:
    """Values (n, 27) and gradients (n, 27, 3) of the shape functions at local points `xi` (n, 3)."""
    (a, da), (b, db), (c, dc) = (_lagrange(np.asarray(xi)[:, d]) for d in range(3))

    def product(f: Array, g: Array, h: Array) -> Array:
        return np.einsum("nk,nj,ni->nkji", h, g, f).reshape(len(f), 27)

    gradient = np.stack([product(da, b, c), product(a, db, c), product(a, b, dc)], axis=-1)
    return product(a, b, c), gradient


def face_shape(st: Array) -> tuple[Array, Array]:
    """Values (n, 9) and gradients (n, 9, 2) of a face's bi-quadratic shape functions at `st` (n, 2)."""
    (a, da), (b, db) = (_lagrange(np.asarray(st)[:, d]) for d in range(2))
    value = np.einsum("nt,ns->nts", b, a).reshape(len(a), 9)
    gradient = np.stack(
        [np.einsum("nt,ns->nts", b, da).reshape(-1, 9), np.einsum("nt,ns->nts", db, a).reshape(-1, 9)],
        axis=-1,
    )
    return value, gradient


def gauss(dimensions: int) -> tuple[Array, Array]:
    """Points (3**d, d) and weights (3**d,) of the three-point Gauss rule on [-1, 1]**d."""
    x = np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
    w = np.array([5.0, 8.0, 5.0]) / 9.0
    points = np.stack(np.meshgrid(*[x] * dimensions, indexing="ij"), axis=-1).reshape(-1, dimensions)
    weights = np.prod(
        np.stack(np.meshgrid(*[w] * dimensions, indexing="ij"), axis=-1).reshape(-1, dimensions), -1
    )
    return points, weights


def scatter(rows: Integers, values: Array, count: int) -> Array:
    """Sums (count,) of `values` over equal `rows`, two arrays of one size."""
    return np.asarray(np.bincount(rows.ravel(), weights=values.ravel(), minlength=count), np.float64)
