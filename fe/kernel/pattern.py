"""Sparsity pattern (upper triangle, CSR) of a matrix assembled from elements, and positions of entries in it.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from fe.element import Integers
from fe.kernel import compiled

Places = NDArray[np.int32]
ROWS = 4096  # found at once: a product of the whole weighs as much as the factors


@dataclass(frozen=True)
class Pattern:
    """Sparse upper triangle with its diagonal (CSR): indptr (n + 1,), indices (nnz,)."""

    indptr: Places
    indices: Places

    @staticmethod
    def of(unknowns: Integers, size: int) -> "Pattern":
        """Pattern in which all unknowns (e, k) of an element are coupled; -1 stands for no unknown.

        >>> pattern = Pattern.of(np.array([[0, 1, -1], [1, 2, -1]]), 3)
        >>> pattern.indptr, pattern.indices
        (array([0, 2, 4, 5], dtype=int32), array([0, 1, 1, 2, 2], dtype=int32))
        """
        e, k = np.nonzero(unknowns >= 0)
        member = sp.csr_matrix((np.ones(len(e), bool), (e, unknowns[e, k])), shape=(len(unknowns), size))
        of, indptr, indices = member.T.tocsr(), [np.zeros(1, np.int32)], []
        for row in range(0, size, ROWS):
            part = sp.triu(of[row : row + ROWS] @ member, row, format="csr")
            part.sort_indices()
            indptr.append(indptr[-1][-1] + part.indptr[1:])
            indices.append(part.indices)
        return Pattern(np.concatenate(indptr), np.concatenate(indices))

    def joined(self, second: "Pattern") -> "Pattern":
        """Union of two patterns."""
        size = len(self.indptr) - 1
        a, b = (
            sp.csr_matrix((np.ones(len(q.indices), np.int32), q.indices, q.indptr), shape=(size, size))
            for q in (self, second)
        )
        both = a + b
        both.sort_indices()
        return Pattern(both.indptr, both.indices)

    @property
    def entries(self) -> tuple[Integers, Integers]:
        """Row and column (nnz,) of every entry."""
        rows = np.repeat(np.arange(len(self.indptr) - 1), np.diff(self.indptr))
        return rows, self.indices.astype(np.int64)

    def places(self, rows: Integers, columns: Integers, *, mirrored: bool = False) -> Places:
        """Positions (e, a, b) of the entries at rows (e, a) and columns (e, b).

        Entries below the diagonal map to their transposed entry if `mirrored`. Otherwise, and for index -1,
        they map to a dummy slot behind the last entry.
        """
        out = np.empty((*rows.shape, columns.shape[1]), np.int32)
        # each kind of array is compiled anew
        indices = np.ascontiguousarray(rows), np.ascontiguousarray(columns)
        compiled.places(self.indptr, self.indices, *indices, mirrored, out)
        return out
