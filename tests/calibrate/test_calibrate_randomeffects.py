"""Random effects: the t test in the limit, DerSimonian and Laird's closed form, rates of the newcomer's test."""

import numpy as np
import pytest
from scipy.stats import norm, t

from calibrate import randomeffects
from calibrate.randomeffects import between, newcomer

FORMER = np.array([1.0, 2.0, 4.0, 3.0, 5.0, 2.0, 3.0])


@pytest.mark.parametrize("value", [2.0, 6.0, 9.0, -4.0])
def test_with_an_exact_measurement_it_is_the_t_test(value):
    found = newcomer(FORMER, np.full(7, 1e-5), value=value, sd=1e-5)
    sd = FORMER.std(ddof=1) * np.sqrt(1 + 1 / 7)
    exact = 2 * t.sf(abs(value - FORMER.mean()) / sd, 6)
    assert found.p_value == pytest.approx(exact, rel=1e-3)  # the quadrature's
    ends = FORMER.mean() + sd * t.ppf([0.025, 0.975], 6)
    assert (found.low, found.high) == pytest.approx(tuple(ends), rel=1e-3)


def test_with_groups_that_are_known_to_be_alike_it_nears_the_normal_test():
    """A hundred groups without any sd between them tell that there is none."""
    y = np.random.default_rng(1).normal(size=100)
    found = newcomer(y, np.ones(100), value=y.mean() + 3.0, sd=1.0)
    assert found.former.between_sd < 0.2
    assert found.p_value == pytest.approx(2 * norm.sf(3.0 / np.sqrt(1.01)), rel=0.5)  # tau is not quite 0


def test_the_sd_between_groups_is_that_of_dersimonian_and_laird():
    """Of groups measured alike, tau2 = variance - sd2, and the mean is the plain one."""
    found = between(FORMER, np.full(7, 0.8))
    assert found.between_sd == pytest.approx(np.sqrt(FORMER.var(ddof=1) - 0.64))
    assert (found.mean, found.sd_mean) == pytest.approx((FORMER.mean(), np.sqrt(FORMER.var(ddof=1) / 7)))
    assert between(FORMER, np.full(7, 5.0)).between_sd == 0.0


def test_a_poorly_measured_group_counts_little():
    sd = np.array([0.1] * 6 + [50.0])
    y = np.array([1.0, 1.1, 0.9, 1.05, 0.95, 1.0, 30.0])
    assert between(y, sd).mean == pytest.approx(1.0, abs=0.02)
    assert newcomer(y, sd, value=1.02, sd=0.1).p_value > 0.5


def test_the_quadrature_is_fine_enough(monkeypatch):
    coarse = newcomer(FORMER, np.full(7, 0.7), value=9.0, sd=0.5)
    monkeypatch.setattr(randomeffects, "KNOTS", 4 * randomeffects.KNOTS)
    fine = newcomer(FORMER, np.full(7, 0.7), value=9.0, sd=0.5)
    assert coarse.p_value == pytest.approx(fine.p_value, rel=1e-3)


@pytest.mark.parametrize(
    ("values", "sds", "sd", "sentence"),
    [
        ([1.0, 2.0], [1.0, 1.0], 1.0, "wanted as many of both, 3 or more"),
        ([1.0, 2.0, 3.0], [1.0, 0.0, 1.0], 1.0, "sds above 0"),
        ([1.0, 2.0, np.nan], [1.0, 1.0, 1.0], 1.0, "wanted finite values"),
        ([1.0, 2.0, 3.0], [1.0, 1.0, 1.0], 0.0, "sd of the newest group: 0; wanted more than 0"),
    ],
)
def test_bad_input_is_named(values, sds, sd, sentence):
    with pytest.raises(ValueError, match=sentence):
        newcomer(values, sds, value=1.0, sd=sd)


def rate(ratio, drift, *, series, seed):
    """Share of series of 8 groups in which the newest is called different at 5 %."""
    rng, calls = np.random.default_rng(seed), 0
    for _ in range(series):
        sd = np.exp(0.2 * rng.normal(size=8))
        y = rng.normal(size=8) * np.hypot(ratio, sd)
        newest = y[-1] + drift * np.hypot(ratio, sd[-1])
        calls += newcomer(y[:-1], sd[:-1], value=newest, sd=sd[-1]).p_value < 0.05
    return calls / series


def test_it_seldom_calls_what_is_not_there_and_finds_what_is():
    # 60 series: 5 % +- 2.8 %, three of these sds; the power of the exact t test is 0.87, less three sds
    assert rate(2.0, 0.0, series=60, seed=1) <= 0.05 + 3 * 0.028
    assert rate(0.3, 4.0, series=60, seed=2) > 0.87 - 3 * 0.043


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.0, 0.5, 1.0, 2.0, 5.0])
def test_false_alarms_stay_below_five_in_a_hundred_whatever_the_groups(ratio):
    assert rate(ratio, 0.0, series=1000, seed=3) <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 1000)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.0, 1.0, 5.0])
def test_large_drifts_are_found(ratio):
    assert rate(ratio, 5.0, series=300, seed=4) > 0.9
