"""Fronts of several objectives against those that are known in closed form."""

import numpy as np
import pytest

from calibrate import Parameter
from calibrate.genetic import Front, pareto_front
from calibrate.parameters import Array

BOTH = [Parameter("p", -2, 3), Parameter("q", -2, 3)]
A, B = np.array([0.0, 0.0]), np.array([1.0, 1.0])


def distances(theta: Array) -> Array:
    """The squared distances of two points: the front is the segment between them, f = s^2 and (1 - s)^2 of 2."""
    return np.array([((theta - A) ** 2).sum(), ((theta - B) ** 2).sum()])


def test_the_front_of_two_quadratics_is_the_segment_between_their_minima() -> None:
    found = pareto_front(distances, BOTH, starts=np.array([A, B]), seed=3)
    off = np.abs(found.theta[:, 0] - found.theta[:, 1]) / np.sqrt(2)
    assert off.max() < 0.1  # of a segment of 1.41, after 2400 points
    assert np.sqrt((off**2).mean()) < 0.05  # its square adds to both objectives, which go to 2
    along = found.theta.mean(axis=1)
    assert (along.min(), along.max()) == (0.0, 1.0)  # both starts
    assert np.diff(np.sort(along)).max() < 0.1
    np.testing.assert_array_equal(found.values, [distances(theta) for theta in found.theta])
    assert np.all(np.diff(found.values[:, 0]) > 0)
    assert np.all(np.diff(found.values[:, 1]) < 0)
    np.testing.assert_allclose(found.theta[found.knee], 0.5, atol=0.05)  # farthest from the chord
    kept = found.spread(8)
    assert {0, found.knee, len(along) - 1} <= set(kept)
    assert len(kept) == 8
    assert np.diff(np.sort(found.values[kept, 0])).max() < 0.75  # of 2; evenly in both objectives


def test_a_seed_gives_the_same_front_again_and_another_a_different_one() -> None:
    one, same, other = (pareto_front(distances, BOTH, starts=A[None], seed=s, generations=4) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.theta, same.theta)
    assert not np.array_equal(one.theta, other.theta)


def test_what_has_no_objectives_is_on_no_front() -> None:
    found = pareto_front(
        lambda t: None if t[0] < 0.5 else distances(t), BOTH, starts=np.array([[1.0, 1.0]]), seed=1, generations=15
    )
    assert found.theta[:, 0].min() >= 0.5
    with pytest.raises(ValueError, match="no start has objectives"):
        pareto_front(lambda t: None, BOTH, starts=A[None], seed=1)


def test_objectives_that_agree_have_one_point() -> None:
    def both(theta: Array) -> Array:
        return np.array([((theta - A) ** 2).sum(), 1 + ((theta - A) ** 2).sum()])

    found = pareto_front(both, BOTH, starts=A[None], seed=1, generations=3)
    np.testing.assert_array_equal(found.theta, [A])
    assert (found.knee, found.spread(8)) == (0, [0])


def test_the_knee_of_three_objectives_is_nearest_to_the_best_of_all() -> None:
    values = np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0], [0.2, 0.3, 0.2], [0.5, 0.6, 0.6]])
    assert Front(np.zeros((5, 1)), values).knee == 3
    assert Front(np.zeros((5, 1)), values * [1.0, 1e3, 1e-3]).knee == 3  # whatever their units
