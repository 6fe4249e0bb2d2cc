"""The pattern of a system's matrix, and the places of entries in it, against dense matrices of numbers."""

import numpy as np
import pytest

from fe.kernel import matrix
from fe.kernel.matrix import Pattern


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
