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
from fe.kernel.matrix import Pattern, Places, Symmetric


class Reduced:
    """Solver like `Symmetric` for all unknowns, with the dependent ones x = T y, T (n, m)."""

    def __init__(self, pattern: Pattern, T: sp.csr_matrix, *, definite: bool = True) -> None:
        self._T = T
        self._gather, indptr, indices = _products(pattern, T)
        self._matrix = Symmetric(indptr, indices, definite=definite)

    def begin(self) -> None:
        """As `Symmetric.begin`."""
        self._matrix.begin()

    def factorise(self, data: Array) -> None:
        """Factorise by the upper triangle (nnz,) of the system of all unknowns."""
        self._matrix.factorise(self._gather @ data)

    @property
    def count(self) -> int:
        """Number of factorisations."""
        return self._matrix.count

    @property
    def negative(self) -> int | None:
        """Number of negative eigenvalues of the reduced matrix; None if the solver does not report it."""
        return self._matrix.negative

    def solve(self, b: Array) -> Array:
        """All unknowns (n,) or (n, k) for right-hand sides (n,) or (n, k)."""
        return np.asarray(self._T @ self._matrix.solve(np.asarray(self._T.T @ b)))


def _products(pattern: Pattern, T: sp.csr_matrix) -> tuple[sp.csr_matrix, Places, Places]:
    """Matrix that maps the upper triangle of K to the upper triangle of T^T K T, and its pattern (CSR)."""
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
    """A pattern with room for faces that touch each other: narrow (nnz,), the positions of the original
    entries in it, and its solver."""

    pattern: Pattern
    narrow: Places
    matrix: Symmetric | Reduced

    @staticmethod
    def of(narrow: Pattern, unknowns: Integers, solver: Callable[[Pattern], Symmetric | Reduced]) -> "Wider":
        """The pattern `narrow`, extended by couplings between all unknowns (g, k) of each group; -1 stands
        for no unknown."""
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
    """Sparse matrix (size, size) of dense blocks (g, k, k) at degrees of freedom (g, k).

    >>> addition([(np.array([[0, 2]]), np.array([[[1.0, 2.0], [3.0, 4.0]]]))], 3).toarray()
    array([[1., 0., 2.],
           [0., 0., 0.],
           [3., 0., 4.]])
    """
    out = csr_matrix((size, size))
    for dofs, C in parts:
        r, c = np.broadcast_arrays(dofs[:, :, None], dofs[:, None])
        out = out + csr_matrix((C.ravel(), (r.ravel(), c.ravel())), shape=(size, size))
    return out


def coupled(C: csr_matrix, u: Array, answer: Callable[[Array], Array]) -> Array:
    """Forces f (n,) N of an unsymmetric addition to a tangent, f = C (u + answer(f)), by GMRES (Saad &
    Schultz 1986, doi 10.1137/0907058).

    C (n, n) N/mm: the addition; u (n,) mm: the solution without it; answer: the change (n,) mm due to
    residual forces (n,) N. If GMRES does not converge, its best f is used.
    """
    rows = np.flatnonzero(np.diff(C.indptr))
    C_rows = C[rows]

    def spread(f: Array) -> Array:
        out = np.zeros(len(u))
        out[rows] = f
        return out

    operator = LinearOperator((len(rows),) * 2, matvec=lambda f: f - C_rows @ answer(spread(f)), dtype=float)
    return spread(gmres(operator, C_rows @ u, rtol=LEFT, restart=KRYLOV, maxiter=1)[0])
