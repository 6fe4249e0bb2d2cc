"""A symmetric system some of whose unknowns follow others: x = T y, and T^T K T y = T^T b is solved."""

import numpy as np
import scipy.sparse as sp

from fe.element import Array
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
