"""Linear systems derived from a symmetric sparse one.

`Reduced`: some unknowns follow others, x = T y, and T^T K T y = T^T b is solved. `Wider`: the pattern has
room for faces that touch each other. `coupled`: an unsymmetric addition on few degrees of freedom.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import LinearOperator, gmres

from fe.element import Array, Integers
from fe.kernel.matrix import Symmetric
from fe.kernel.pattern import Pattern, Places


class Reduced:
    """As `Symmetric`, of all unknowns, with followers by T (n, m): a row of it is one unknown."""

    def __init__(self, pattern: Pattern, T: sp.csr_matrix) -> None:
        self._T = T
        self._gather, indptr, indices = _products(pattern, T)
        self._matrix = Symmetric(indptr, indices)

    def factorise(self, data: Array) -> None:
        """Factorise by the upper triangle (nnz,) of the system of all unknowns."""
        self._matrix.factorise(self._gather @ data)

    @property
    def count(self) -> int:
        """How many times it was factorised."""
        return self._matrix.count

    @property
    def negative(self) -> int | None:
        """How many eigenvalues of the reduced matrix are negative; None where that is not told."""
        return self._matrix.negative

    def solve(self, b: Array) -> Array:
        """All unknowns (n,) or (n, k) for right-hand sides of the same shape."""
        return np.asarray(self._T @ self._matrix.solve(np.asarray(self._T.T @ b)))


def _products(pattern: Pattern, T: sp.csr_matrix) -> tuple[sp.csr_matrix, Places, Places]:
    """How the upper triangle of T^T K T comes of that of K, and its pattern (CSR)."""
    size = T.shape[1]
    row = np.repeat(np.arange(len(pattern.indptr) - 1), np.diff(pattern.indptr))
    column, count = pattern.indices.astype(np.int64), np.diff(T.indptr)
    many = count[row].astype(np.int64) * count[column]
    entry = np.repeat(np.arange(len(row)), many)
    within = np.arange(len(entry)) - np.repeat(np.cumsum(many) - many, many)
    i, j = np.divmod(within, count[column][entry])
    i, j = T.indptr[row[entry]] + i, T.indptr[column[entry]] + j
    a, b, w = T.indices[i].astype(np.int64), T.indices[j].astype(np.int64), T.data[i] * T.data[j]
    # an entry off the diagonal stands for its mirror image, too, whose product is at (b, a)
    off = (row != column)[entry]
    both = off & (a == b)
    keep = off | (a <= b)
    w = np.where(both, 2 * w, w)
    low, high = np.minimum(a, b)[keep], np.maximum(a, b)[keep]
    diagonal = np.arange(size)
    keys, place = np.unique(np.concatenate([low * size + high, diagonal * (size + 1)]), return_inverse=True)
    gather = sp.csr_matrix((w[keep], (place[: len(low)], entry[keep])), shape=(len(keys), len(row)))
    indptr = np.searchsorted(keys, np.arange(size + 1) * size).astype(np.int32)
    return gather, indptr, (keys % size).astype(np.int32)


@dataclass(frozen=True)
class Wider:
    """The wider pattern, where (nnz,) the entries of the narrow one are in it, and its solver."""

    pattern: Pattern
    narrow: Places
    matrix: Symmetric | Reduced

    @staticmethod
    def of(narrow: Pattern, unknowns: Integers, solver: Callable[[Pattern], Symmetric | Reduced]) -> "Wider":
        """The pattern in which the unknowns (g, k) of each group meet each other, too; -1 is none of them."""
        pattern = narrow.joined(Pattern.of(unknowns, len(narrow.indptr) - 1))
        rows, columns = narrow.entries
        places = pattern.places(rows[:, None], columns[:, None]).ravel()
        return Wider(pattern, places, solver(pattern))

    def spread(self, data: Array) -> Array:
        """The values (nnz,) of the narrow pattern in the wider one."""
        out = np.zeros(len(self.pattern.indices))
        out[self.narrow] = data
        return out


LEFT = 1e-10  # of the addition's forces: derivatives are to be exact to 1e-6
KRYLOV = 60


def addition(parts: Sequence[tuple[Integers, Array]], size: int) -> csr_matrix:
    """The matrix (size, size) of small ones (g, k, k) at degrees of freedom (g, k)."""
    out = csr_matrix((size, size))
    for dofs, C in parts:
        r, c = np.broadcast_arrays(dofs[:, :, None], dofs[:, None])
        out = out + csr_matrix((C.ravel(), (r.ravel(), c.ravel())), shape=(size, size))
    return out


def coupled(C: csr_matrix, u: Array, answer: Callable[[Array], Array]) -> Array:
    """The forces f (n,) N of an addition to a tangent, f = C (u + answer(f)), by GMRES (Saad & Schultz 1986,
    doi 10.1137/0907058).

    C (n, n) N/mm: the addition; u (n,) mm: the change without it; answer: the change (n,) mm that residual
    forces (n,) N bring about. The nearest f found is taken where it does not come to rest.
    """
    rows = np.flatnonzero(np.diff(C.indptr))
    own = C[rows]

    def spread(f: Array) -> Array:
        out = np.zeros(len(u))
        out[rows] = f
        return out

    left = LinearOperator((len(rows),) * 2, matvec=lambda f: f - own @ answer(spread(f)), dtype=float)
    return spread(gmres(left, own @ u, rtol=LEFT, restart=KRYLOV, maxiter=1)[0])
