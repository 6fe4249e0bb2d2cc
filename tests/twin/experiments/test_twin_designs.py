"""Designs of experiments and main effects against closed forms."""

import numpy as np
import pytest

from twin.experiments.designs import Variable, levels_of, main_effects, sobol_design

C10, WALL, PLEATS = Variable("C10", 0.1, 0.3, "MPa"), Variable("wall_mm", 1.0, 2.0, "mm"), Variable("pleats", 3, 5, whole=True)


def test_a_random_design_is_even_inside_its_ranges_and_follows_its_seed() -> None:
    x = sobol_design([C10, WALL, PLEATS], runs=32, seed=4)
    assert x.shape == (32, 3)
    for k, v in enumerate((C10, WALL)):
        number = np.floor((x[:, k] - v.low) / (v.high - v.low) * 32)
        assert sorted(number) == list(range(32))  # one in each of 32 bins, as the sequence promises
    assert {3, 4, 5} == set(x[:, 2])
    assert np.bincount(x[:, 2].astype(int))[3:].min() >= 9  # of 32 in 3
    np.testing.assert_array_equal(x, sobol_design([C10, WALL, PLEATS], runs=32, seed=4))
    assert not np.array_equal(x, sobol_design([C10, WALL, PLEATS], runs=32, seed=5))


def test_more_runs_only_add_to_a_sobol_design() -> None:
    few, more = (sobol_design([C10, WALL], runs=n, seed=1) for n in (5, 8))
    np.testing.assert_array_equal(few, more[:5])


def test_runs_that_make_no_design_are_refused() -> None:
    with pytest.raises(ValueError, match="--runs 1: wanted 2 to"):
        sobol_design([C10, WALL], runs=1, seed=1)


LOW, HIGH = np.array([0.1, 1.0]), np.array([0.3, 2.0])


def test_the_main_effects_of_a_linear_model_are_its_slopes() -> None:
    x = sobol_design([C10, WALL], runs=16, seed=2)
    y = 5 + 30 * x[:, 0] - 4 * x[:, 1]
    found = main_effects(x, y, LOW, HIGH)
    assert found is not None
    np.testing.assert_allclose(found.change, [6.0, -4.0], rtol=1e-12)  # 30 over 0.2, -4 over 1
    np.testing.assert_allclose(found.sd, 0.0, atol=1e-12)
    assert found.explained == pytest.approx(1.0)
    sizes = np.array([30.0, -4.0]) * x.std(axis=0) / y.std()
    np.testing.assert_allclose(found.standardised, sizes, rtol=1e-12)
    still = main_effects(x, np.full(16, 3.0), LOW, HIGH)
    assert still is not None
    assert (still.change.tolist(), still.sd.tolist()) == ([0.0, 0.0], [0.0, 0.0])


def test_what_is_not_linear_is_in_the_standard_error() -> None:
    x = np.array([[a, b] for a in (0.1, 0.3) for b in (1.0, 2.0)])
    a, b = ((x - LOW) / (HIGH - LOW)).T
    rows = np.tile(x, (2, 1))
    y = np.tile(2 * a + b + 4 * (a - 0.5) * (b - 0.5), 2)  # an interaction of +-1, which no plane has
    found = main_effects(rows, y, LOW, HIGH)
    assert found is not None
    np.testing.assert_allclose(found.change, [2.0, 1.0], rtol=1e-12)
    # textbook: s^2 = 8 / (8 - 3), each column of t has sum of squares 2 about its mean
    np.testing.assert_allclose(found.sd, np.sqrt(8 / 5 / 2), rtol=1e-12)
    assert found.explained == pytest.approx(1 - 1 / (1 + 1 + 0.25))


def test_too_few_runs_have_no_main_effects() -> None:
    x = sobol_design([C10, WALL], runs=3, seed=1)
    assert main_effects(x, x[:, 0], LOW, HIGH) is None
    same = np.column_stack([np.linspace(0.1, 0.3, 9), np.full(9, 1.5)])  # what could be solved does not vary one of them
    assert main_effects(same, same[:, 0], LOW, HIGH) is None


def test_levels_have_the_means_of_their_runs() -> None:
    x, y = np.array([3.0, 3.0, 4.0, 5.0, 5.0]), np.array([1.0, 3.0, 7.0, 2.0, 2.0])
    np.testing.assert_allclose(levels_of(x, y, 3, 5), [[3, 2, 1.0], [4, 7, np.nan], [5, 2, 0]])
    x = np.linspace(0.0, 1.0, 9)
    found = levels_of(x, x, 0.0, 1.0)
    np.testing.assert_allclose(found[:, 0], [0.125, 0.375, 0.625, 0.875])
    np.testing.assert_allclose(found[:, 1], [0.0625, 0.3125, 0.5625, 0.875])  # two, two, two and three runs
