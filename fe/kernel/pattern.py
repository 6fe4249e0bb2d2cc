"""The sparse upper triangle of a matrix in which the unknowns of each element meet, and places in it."""

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
    """A sparse upper triangle with its diagonal (CSR)."""

    indptr: Places
    indices: Places

    @staticmethod
    def of(unknowns: Integers, size: int) -> "Pattern":
        """The pattern in which all unknowns (e, k) of an element meet each other; -1 is none of them."""
        e, k = np.nonzero(unknowns >= 0)
        member = sp.csr_matrix((np.ones(len(e), bool), (e, unknowns[e, k])), shape=(len(unknowns), size))
        of, indptr, indices = member.T.tocsr(), [np.zeros(1, np.int32)], []
        for first in range(0, size, ROWS):
            part = sp.triu(of[first : first + ROWS] @ member, first, format="csr")
            part.sort_indices()
            indptr.append(indptr[-1][-1] + part.indptr[1:])
            indices.append(part.indices)
        return Pattern(np.concatenate(indptr), np.concatenate(indices))

    def joined(self, other: "Pattern") -> "Pattern":
        """The entries of both."""
        size = len(self.indptr) - 1
        one, two = (
            sp.csr_matrix((np.ones(len(q.indices), np.int32), q.indices, q.indptr), shape=(size, size))
            for q in (self, other)
        )
        both = one + two
        both.sort_indices()
        return Pattern(both.indptr, both.indices)

    @property
    def entries(self) -> tuple[Integers, Integers]:
        """Row and column (nnz,) of every entry."""
        rows = np.repeat(np.arange(len(self.indptr) - 1), np.diff(self.indptr))
        return rows, self.indices.astype(np.int64)

    def places(self, rows: Integers, columns: Integers, *, mirrored: bool = False) -> Places:
        """Where the entries (e, a, b) at rows (e, a) and columns (e, b) of its elements are.

        Those below the diagonal are where their mirror images are if `mirrored`; else, as all at -1, they are
        nowhere: behind the last.
        """
        out = np.empty((*rows.shape, columns.shape[1]), np.int32)
        own = np.ascontiguousarray(rows), np.ascontiguousarray(columns)  # each kind of array is compiled anew
        compiled.places(self.indptr, self.indices, *own, mirrored, out)
        return out
