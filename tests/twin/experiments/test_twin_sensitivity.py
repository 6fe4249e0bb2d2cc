"""Sobol indices by the estimator are those of closed forms."""

import sys

import numpy as np
import pytest

from twin.experiments.sensitivity import sobol_indices
from twin.targets import Array

A, B = 7.0, 0.1  # of Ishigami's function


def ishigami(x: Array) -> Array:
    """Ishigami & Homma 1990 (doi:10.1109/ISUMA.1990.151285), a sum, and what nothing changes; nothing depends on
    the fourth."""
    return np.array([np.sin(x[0]) + A * np.sin(x[1]) ** 2 + B * x[2] ** 4 * np.sin(x[0]), x[0] + 2 * x[2], 3.0])


def test_they_are_those_of_closed_forms() -> None:
    ends = np.pi * np.ones(4)
    found = sobol_indices(ishigami, -ends, ends, draws=2048, seed=1)
    own, second = 0.5 * (1 + B * np.pi**4 / 5) ** 2, A**2 / 8
    both = B**2 * np.pi**8 * 8 / 225  # of the first and the third together
    whole = own + second + both
    first = np.array([[own / whole, second / whole, 0, 0], [0.2, 0, 0.8, 0]])
    total = np.array([[(own + both) / whole, second / whole, both / whole, 0], [0.2, 0, 0.8, 0]])
    # Half widths are 1.96 sd: beyond twice as much is one of 10,000, for each of 12 that are not 0.
    assert (np.abs(found.first[:2] - first) <= 2 * found.first_half[:2] + 1e-9).all()
    assert (np.abs(found.total[:2] - total) <= 2 * found.total_half[:2] + 1e-9).all()
    assert found.first_half.max() < 0.08  # so that the lines above say something
    assert found.total_half.max() < 0.08


def test_what_does_not_matter_has_none() -> None:
    found = sobol_indices(ishigami, -np.pi * np.ones(4), np.pi * np.ones(4), draws=64)
    assert (np.abs(found.first[:, 3]) <= found.first_half[:, 3] + 1e-12).all()
    assert (found.total[:, 3] <= found.total_half[:, 3] + 1e-12).all()
    np.testing.assert_array_equal(found.total[2], 0.0)  # nothing changes the third target


def test_what_is_wrong_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    low, high = np.zeros(4), np.ones(4)
    with pytest.raises(ValueError, match=r"draws = 100: wanted a power of 2"):
        sobol_indices(ishigami, low, high, draws=100)
    monkeypatch.setitem(sys.modules, "SALib.analyze", None)  # as where it is not installed
    with pytest.raises(ValueError, match="pip install SALib"):
        sobol_indices(ishigami, low, high)
