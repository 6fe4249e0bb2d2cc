"""The pattern of a system's matrix, places of entries in it, and its solutions, against dense matrices."""

import numpy as np
import pytest
import scipy.sparse as sp

from fe.kernel import matrix
from fe.kernel.matrix import Pattern, Symmetric


@pytest.mark.parametrize("rows", [7, 4096])
def test_a_pattern_holds_what_elements_share(monkeypatch: pytest.MonkeyPatch, rows: int) -> None:
    monkeypatch.setattr(matrix, "ROWS", rows)  # several parts, the last one smaller
    rng = np.random.default_rng(5)
    size, unknowns = 40, np.array([rng.permutation(40)[:6] for _ in range(25)])
    unknowns[rng.random(unknowns.shape) < 0.2] = -1
    meets = np.zeros((size, size), bool)
    for own in unknowns:
        own = own[own >= 0]
        meets[np.ix_(own, own)] = True
    found = Pattern.of(unknowns, size)
    np.testing.assert_array_equal(np.repeat(np.arange(size), np.diff(found.indptr)), np.nonzero(np.triu(meets))[0])
    np.testing.assert_array_equal(found.indices, np.nonzero(np.triu(meets))[1])
    number = np.full((size, size), len(found.indices))
    number[np.triu(meets)] = np.arange(len(found.indices))
    for mirrored in (False, True):
        wanted = np.minimum(number, number.T) if mirrored else number
        r, c = unknowns[:, :, None], unknowns[:, None]
        expected = np.where((r < 0) | (c < 0), len(found.indices), wanted[r, c])
        np.testing.assert_array_equal(found.places(unknowns, unknowns, mirrored=mirrored), expected)


@pytest.mark.skipif(matrix.PyPardisoSolver is None, reason="MKL is absent: SuperLU takes any matrix")
def test_a_matrix_that_is_not_positive_definite_is_solved_too_and_so_is_the_next() -> None:
    rng = np.random.default_rng(4)
    root = sp.random(40, 40, 0.1, rng=rng) + sp.eye(40)
    definite = (root @ root.T).toarray()
    indefinite = definite - 2 * np.eye(40)
    solver, b, after = None, rng.standard_normal((40, 3)), []
    for a in (definite, indefinite, definite):
        upper = sp.triu(sp.csr_matrix(a), format="csr")
        upper.sort_indices()
        solver = solver or Symmetric(upper.indptr.astype(np.int32), upper.indices.astype(np.int32))
        solver.factorise(upper.data)
        np.testing.assert_allclose(a @ solver.solve(b), b, rtol=0, atol=1e-9)
        assert solver.negative == int((np.linalg.eigvalsh(a) < 0).sum())
        after.append(solver.solve(b))
    count = solver.count
    solver.begin()
    assert solver.count > count  # a step that was factorised before is told that its factors are gone
    solver.factorise(sp.triu(sp.csr_matrix(definite), format="csr").data)
    np.testing.assert_array_equal(solver.solve(b), after[0])  # as if it had been the first
