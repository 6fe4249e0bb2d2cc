"""Errors of laws: what they let pass, what not, and that averaging over them is the exact algebra."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from tests.pulls import band
from tests.twin.diagnosis.toy import POINTS, STEPS, Toy, smooth_field, targets, toy_effect
from twin.judging.comparison import lack_of_fit, smooth_functions
from twin.judging.judged import Judged, judge
from twin.judging.lawerrorlevels import Level, _bounded_step, asked_for, inexact, levels, with_laws
from twin.judging.lawerrors import LEVELS, WEIGHTS, averaged, law_errors
from twin.targets import Array, KnownValue, Targets

BASE, SIGNATURE = smooth_field(1), smooth_field(10)
EFFECT = toy_effect("alpha")
MODEL = Toy({"base": BASE, "alpha": SIGNATURE}).with_effect(EFFECT)


def judged(truth: Array, *, seed: int, law: float = 0.0) -> tuple[Judged, Targets]:
    t = targets(1.3 * BASE[0] + truth, seed=seed)
    return judge(MODEL, t, starts=np.array([1.0, 0.1]), law=law), t  # type: ignore[arg-type]


def off(t: Targets, *, share: float, seed: int) -> Array:
    """Half of the signature under a law that is off by a draw of its errors, `share` each."""
    size = share * np.random.default_rng(seed).standard_normal(27)
    found = law_errors(MODEL, np.array([1.3, 0.5]), t)[0].modes  # type: ignore[arg-type]
    return 0.5 * SIGNATURE[0] + np.tensordot(size, found, 1)


def test_a_model_without_effects_has_no_law_errors() -> None:
    t = targets(1.3 * BASE[0], seed=0)
    base = judge(Toy({"base": BASE}), t, starts=np.array([1.0]))  # type: ignore[arg-type]
    assert len(levels(base, t)) == 1
    assert with_laws(base, t) is base


def test_modes_are_shares_of_what_the_effect_adds_relative_to_the_reference() -> None:
    _, t = judged(0.5 * SIGNATURE[0], seed=0)
    (once,), (twice,) = (law_errors(MODEL, np.array([1.3, a]), t) for a in (0.5, 1.0))  # type: ignore[arg-type]
    assert once.modes.shape == (27, STEPS, POINTS + 1, 3)
    np.testing.assert_allclose(twice.modes, 2 * once.modes, atol=1e-12)
    np.testing.assert_allclose(once.modes[:, t.reference].mean(axis=1), 0.0, atol=1e-12)
    along, up = np.abs(once.modes[..., 0]).max(axis=(1, 2)) > 0, np.abs(once.modes[..., 2]).max(axis=(1, 2)) > 0
    assert not (along & up).any()  # U1 and U3 may err apart
    constant = once.modes[-1][..., 0] / np.where(SIGNATURE[0][..., 0], SIGNATURE[0][..., 0], np.inf)
    np.testing.assert_allclose(constant[5:, :POINTS], 0.5, rtol=1e-9)  # the amplitude: all of U1


def test_modes_do_not_depend_on_where_the_clock_begins() -> None:
    t, theta = targets(BASE[0], seed=0), np.array([1.3, 0.5])
    late = replace(t, time=t.time + 1000.0, log_time=t.log_time + 1000.0)
    (now,), (then,) = (law_errors(MODEL, theta, one) for one in (t, late))  # type: ignore[arg-type]
    np.testing.assert_allclose(then.modes, now.modes, atol=1e-9)  # 1000 s is rounded at 1e-13 of a second


@pytest.mark.parametrize("law", LEVELS[1:])
def test_levels_are_what_the_whole_covariance_gives(law: float) -> None:
    t = targets(BASE[0], seed=0)
    found, t = judged(off(t, share=0.1, seed=3), seed=1)
    level = next(one for one in levels(found, t) if one.law == law)
    laws = law_errors(found.model, found.theta, t)
    w = replace(found.errors, laws=laws, law=law).whitener(t)  # the modes beside all others, at once
    z, fitted = w.whiten(found.comparison.residual), w.whiten(found.jacobian).T
    step = np.linalg.lstsq(fitted, z, rcond=None)[0]
    left = z - fitted @ step
    np.testing.assert_allclose(level.step, step, rtol=1e-6, atol=1e-12)
    assert level.deviance == pytest.approx(float(left @ left) + w.log_det, rel=1e-9)
    # the gauge's errors alone are seen along other directions; here there are none
    assert level.p_value == pytest.approx(lack_of_fit(t, w, left, fitted, smooth_functions(t, w)), rel=0.05)


def test_a_law_that_is_a_tenth_off_fits_under_law_errors_alone() -> None:
    t, passed, before = targets(BASE[0], seed=0), [], []
    for seed in range(6):
        found, own = judged(off(t, share=0.1, seed=seed), seed=seed)
        before.append(found.comparison.adequate)
        passed.append(with_laws(found, own).comparison.adequate)
    assert not any(before)
    assert all(passed)


def test_another_physics_does_not_pass_as_an_error_of_the_law() -> None:
    for seed in range(5):
        found, t = judged(0.5 * SIGNATURE[0] + 0.2 * smooth_field(77)[0], seed=seed)
        assert not with_laws(found, t).comparison.adequate


def test_an_exact_law_is_left_as_it_is() -> None:
    found = [judged(0.5 * SIGNATURE[0], seed=seed) for seed in range(6)]
    assert all(with_laws(one, t).errors.law == 0.0 for one, t in found)


def test_intervals_know_the_law_errors() -> None:
    t, pulls, plain = targets(BASE[0], seed=0), [], []
    for seed in range(12):
        found, _ = judged(off(t, share=0.1, seed=seed), seed=seed, law=0.1)
        pulls.append((found.theta[0] - 1.3) / found.fit.sd[0])
        bare, _ = judged(off(t, share=0.1, seed=seed), seed=seed)
        plain.append((bare.theta[0] - 1.3) / bare.fit.sd[0])
    low, high = band(12)
    assert low <= float(np.sqrt(np.mean(np.square(pulls)))) <= high
    assert float(np.sqrt(np.mean(np.square(plain)))) > 2 * high


def test_intervals_hold_though_the_data_ask_for_no_error_of_the_law() -> None:
    found = [judged(0.5 * SIGNATURE[0], seed=seed) for seed in range(6)]
    for bare, t in found:
        fit = with_laws(bare, t).fit
        assert np.array_equal(fit.theta, bare.theta)
        least = 0.03 * 0.5  # the least that a law is taken to be off
        assert 5 * bare.fit.sd[1] < least < fit.sd[1] < 2 * least
        assert abs(fit.theta[1] - 0.5) < 2 * fit.sd[1]
        kept = replace(t, known=(KnownValue(name="alpha", mean=0.5, sd=0.1),))
        assert np.array_equal(inexact(bare, kept).fit.covariance, bare.fit.covariance)


def test_the_average_over_levels() -> None:
    assert averaged([3.0]) == 3.0
    assert averaged([10.0, 10.0, 10.0, 10.0]) == pytest.approx(10.0)
    assert averaged([400.0, 0.0, 0.0, 0.0]) == pytest.approx(400 + 2 * np.log(WEIGHTS[0]))
    assert sum(WEIGHTS) == pytest.approx(1.0)


def test_a_level_is_asked_for_by_half_of_2_ln_B_and_its_weight() -> None:
    none = np.zeros(0)
    rows = [Level(law=eps, deviance=0.0, fitted=none, step=none, p_value=0.5) for eps in LEVELS]
    even = -2 * np.log(WEIGHTS)  # 2 ln B with which all levels are as probable
    for k in range(len(LEVELS)):
        more = np.where(np.arange(len(LEVELS)) == k, 0.2, 0.0)
        assert asked_for(rows, list(even + more)).law == LEVELS[k]


def test_a_step_within_bounds_is_the_best_whatever_the_units() -> None:
    rng = np.random.default_rng(5)
    columns = rng.normal(size=(40, 3)) * [1e-3, 1.0, 50.0]  # as of a modulus in MPa beside a time in s
    z = columns @ [300.0, 2.0, -0.02] + 0.1 * rng.normal(size=40)
    bounds = np.array([-100.0, -1.0, -0.01]), np.array([100.0, 1.0, 0.01])
    size = np.array([1e3, 1.0, 0.02])  # the same in units in which all columns are alike
    best = lsq_linear(columns * size, z, bounds=tuple(x / size for x in bounds), method="bvls").x * size
    step = _bounded_step(columns, z, bounds)
    np.testing.assert_allclose(step, best, rtol=1e-9)
    assert step[0] == pytest.approx(100.0)
