"""Least squares from many starts: the best first, and every optimum named."""

import numpy as np
import pytest

from calibrate import Fit, Parameter, least_squares
from calibrate.parameters import Array
from calibrate.starts import latin, optima, waterfall

ONE = (Parameter("x", -2.0, 2.0),)


def two_valleys(theta: Array) -> Array | None:
    """Lowest at x = 1, and a second time near x = -1, where chi2 is about 4 more; nothing below -1.7."""
    (x,) = theta
    return None if x < -1.7 else np.array([10 * (x**2 - 1), x - 1])


def slope(theta: Array) -> Array:
    return np.array([[20 * theta[0]], [1.0]])


def fit(start: Array) -> Fit:
    return least_squares(two_valleys, slope, ONE, start=start)


def test_the_waterfall_of_a_model_with_two_valleys() -> None:
    starts = latin(ONE, 12, seed=1)
    ends = waterfall(fit, starts)
    assert [end.chi2 for end in ends] == sorted(end.chi2 for end in ends)
    best, second = optima(ends)
    assert best.fit.theta[0] == pytest.approx(1.0, abs=1e-3)
    assert second.fit.theta[0] == pytest.approx(-0.995, abs=0.01)  # where 400 x (x^2 - 1) + 2 (x - 1) = 0
    assert second.fit.chi2 - best.fit.chi2 == pytest.approx(4.0, abs=0.05)
    lost = [end for end in ends if end.fit is None]
    assert len(lost) == (starts < -1.7).sum() == 1
    assert ends[-1] is lost[0]
    assert best.count + second.count + len(lost) == 12


def test_starts_fill_every_slice_of_the_bounds_and_follow_the_seed() -> None:
    two = (Parameter("a", 0.0, 1.0), Parameter("b", 10.0, 30.0))
    starts = latin(two, 8, seed=3)
    for column, low, width in zip(starts.T, (0.0, 10.0), (1.0, 20.0)):
        assert sorted(np.floor((column - low) / width * 8)) == list(range(8))
    assert np.array_equal(starts, latin(two, 8, seed=3))
    assert not np.array_equal(starts, latin(two, 8, seed=4))
