"""Least squares from many starts: the best first, and every optimum named."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate import Fit, Parameter, least_squares
from calibrate.parameters import Array
from calibrate.starts import Ended, latin, optima, waterfall

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


def ended(theta: Array, chi2: float, *, at_bound: tuple[str, ...] = ()) -> Fit:
    """An end in a valley along a = b: known to 0.1 across it, to 10 along it."""
    axes = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2)
    covariance = axes.T @ np.diag([100.0, 0.01]) @ axes
    inside = np.array([name not in at_bound for name in "ab"])
    own = np.where(np.outer(inside, inside), np.diag([1.0, 1.0]) if at_bound else covariance, 0.0)
    two = (Parameter("a", -50.0, 50.0, typical=0.5), Parameter("b", -50.0, 50.0, typical=0.5))
    return Fit(two, theta, own, chi2, 8, 0, 1, True, "converged", at_bound)


@pytest.mark.parametrize(
    ("apart", "chi2", "at_bound", "count"),
    [
        ((5.0, 5.0), 0.24, (), 1),  # far apart, but along the valley: not descended to its bottom
        ((5.0, 5.0), 2.0, (), 2),  # 1.4 sd worse
        ((0.2, -0.2), 0.0, (), 2),  # as good, but 2.8 sd apart: another valley
        ((0.4, 0.4), 0.1, ("a",), 1),
        ((0.6, 0.4), 0.1, ("a",), 2),  # one at the bound, the other more than a step within
    ],
)
def test_one_optimum_is_what_one_sd_of_the_better_end_holds(
    apart: tuple[float, float], chi2: float, at_bound: tuple[str, ...], count: int
) -> None:
    best, other = ended(np.zeros(2), 7.0, at_bound=at_bound), ended(np.array(apart), 7.0 + chi2)
    found = optima([Ended(np.zeros(2), best), Ended(np.zeros(2), other), Ended(np.zeros(2), None)])
    assert len(found) == count
    assert found[0].fit is best


@pytest.mark.parametrize(("far", "count"), [(0.4, 1), (40.0, 2)])
def test_a_parameter_that_the_data_leave_open_has_its_typical_step(far: float, count: int) -> None:
    left_open = np.array([[np.inf, np.nan], [np.nan, 0.01]])
    best, other = (replace(ended(np.array(x), 7.0), covariance=left_open) for x in ((0.0, 0.0), (far, 0.05)))
    assert len(optima([Ended(np.zeros(2), best), Ended(np.zeros(2), other)])) == count
