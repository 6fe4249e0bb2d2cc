"""Sparsity pattern of a system assembled from elements, and its solutions, by PARDISO, or by SuperLU where
MKL is absent."""

import ctypes
import os
import sys
import weakref
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from fe.element import Array, Integers
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


# pypardiso looks for MKL with a compiler and in all folders, 0.3 s a process: it is told where pip puts it.
PLACE = "PYPARDISO_MKL_RT"
for _file in Path(sys.prefix, "lib").glob("libmkl_rt.*"):
    os.environ.setdefault(PLACE, str(_file))
try:
    from pypardiso import PyPardisoSolver, ps

    os.environ.setdefault(PLACE, ps.libmkl._name)  # found elsewhere: once for all meshes and processes
except ImportError:  # MKL is not available on this platform
    PyPardisoSolver = None


# iparm of PARDISO, by number: own settings (1); refinement (8) only where pivots were perturbed, as otherwise
# its two steps treble the time of a solve and leave the residual as it is; 10 and 21 as by default. Below
# SMALL unknowns minimum degree (2: 0) factorises in 0.8 of the time of nested dissection.
SETTINGS = {1: 1, 2: 2, 8: 0, 10: 8, 21: 1}
SMALL = 20_000
CHOLESKY, BUNCH_KAUFMAN = 2, -2  # kinds of matrix: positive definite, and symmetric indefinite
NO_PIVOT = -4  # PARDISO's error where a matrix is not positive definite
# Of a column's largest entry, the least that SuperLU keeps on the diagonal: with 1, the default, factors fill
# and take twenty times as long.
PIVOT = 0.01


class _NotPositive(Exception):
    """A matrix is not positive definite."""


class Symmetric:
    """One sparsity pattern, factorised many times; the symbolic analysis is done once.

    indptr, indices: the CSR pattern of the upper triangle including the diagonal, numbers of 32 bits. count:
    how often its factors were replaced; it solves with the newest alone. Cholesky's factors, and solves with
    them, take some 0.85 of the time of L D L'; from the first matrix that is not positive definite on, L D L'
    serves, until `begin`. definite: False where no matrix of the pattern can be.
    """

    def __init__(self, indptr: Places, indices: Places, *, definite: bool = True) -> None:
        self._indptr, self._indices, self._definite = indptr, indices, definite
        self._n, self.count = len(indptr) - 1, 0
        self._analysed = False
        self._solver = self._begun(CHOLESKY if definite else BUNCH_KAUFMAN) if PyPardisoSolver else None
        # PARDISO counts from 1; made once, as at every call they would cost a third of a solve
        self._places = (indptr + 1).astype(np.int32), (indices + 1).astype(np.int32)

    def begin(self) -> None:
        """Take the next matrix for positive definite again: what follows does not depend on what came before,
        to the bit."""
        if self._definite and self._solver is not None and self._solver.mtype != CHOLESKY:
            _free(self._solver)
            self._solver, self._analysed = self._begun(CHOLESKY), False
            self.count += 1

    def _begun(self, kind: int) -> Any:
        """PARDISO's solver of matrices of a kind, whose factors live outside Python's memory."""
        solver = PyPardisoSolver(mtype=kind)
        for number, value in (SETTINGS | ({2: 0} if self._n < SMALL else {})).items():
            solver.set_iparm(number, value)
        weakref.finalize(self, _free, solver).atexit = False
        return solver

    def factorise(self, data: Array) -> None:
        """Factorise the matrix whose upper triangle has the values `data` (nnz,)."""
        self.count += 1
        if self._solver is None:
            matrix = sp.csr_matrix((data, self._indices, self._indptr), shape=(self._n, self._n))
            full = matrix + sp.triu(matrix, 1).T
            self._lu = sp.linalg.splu(
                full.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=PIVOT,
                options={"SymmetricMode": True},
            )
            return
        self._data = np.ascontiguousarray(data, float)
        try:
            self._call(22 if self._analysed else 12, np.zeros((self._n, 1)))
        except _NotPositive:
            _free(self._solver)
            self._solver = self._begun(BUNCH_KAUFMAN)
            self._call(12, np.zeros((self._n, 1)))
        self._analysed = True

    @property
    def negative(self) -> int | None:
        """Number of negative eigenvalues of the newest factorised matrix; None from SuperLU, which does not
        report it."""
        if self._solver is None:
            return None
        return 0 if self._solver.mtype == CHOLESKY else int(self._solver.get_iparm(23))

    def solve(self, b: Array) -> Array:
        """Solution (n,) or (n, k) for right-hand sides `b` (n,) or (n, k), with the newest factors."""
        if self._solver is None:
            return np.asarray(self._lu.solve(b))
        return self._call(33, b.reshape(self._n, -1)).reshape(b.shape)

    def _call(self, phase: int, b: Array) -> Array:
        """PARDISO's solution (n, k) for right-hand sides (n, k), after a phase of its work."""
        solver: Any = self._solver
        indptr, indices = self._places
        b = np.asfortranarray(b, float)
        x, error = np.zeros_like(b), ctypes.c_int32(0)

        def number(value: int) -> object:
            return ctypes.byref(ctypes.c_int32(value))

        def address(values: Array | Places) -> ctypes.c_void_p:
            return ctypes.c_void_p(values.ctypes.data)

        def integers(values: Places) -> object:
            return values.ctypes.data_as(ctypes.POINTER(ctypes.c_int32))

        solver._mkl_pardiso(
            solver.pt.ctypes.data_as(ctypes.POINTER(solver._pt_type[0])), number(1), number(1),
            number(solver.mtype), number(phase), number(self._n), address(self._data), integers(indptr),
            integers(indices), integers(solver.perm), number(b.shape[1]), integers(solver.iparm), number(0),
            address(b), address(x), ctypes.byref(error),
        )  # fmt: skip
        if error.value == NO_PIVOT and solver.mtype == CHOLESKY:
            raise _NotPositive
        if error.value:
            raise RuntimeError(f"PARDISO ended with its error {error.value} in phase {phase}")
        return x


def _free(solver: object) -> None:
    solver.free_memory(everything=True)  # type: ignore[attr-defined]
