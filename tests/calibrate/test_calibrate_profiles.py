"""Profiles of the likelihood against those that are known in closed form, and against MINOS."""

from collections.abc import Callable

import numpy as np
import pytest
from iminuit import Minuit

from calibrate import Parameter, least_squares, profile_likelihood
from calibrate.parameters import Array
from calibrate.profiles import IDENTIFIED, LEVELS, MISSED, NOT_IDENTIFIED, ONE_SIDED, Held, Profile, nearest

ROOTS = np.sqrt(LEVELS)
P, Q = Parameter("p", -10, 10), Parameter("q", -10, 10)


def ends(profile: Profile) -> Array:
    """The ends (2, 2): a level, lower and upper."""
    return np.array([[end.value for end in pair] for pair in profile.ends])


def ratio(p: float, q: float, sd: float, sd_q: float, level: float) -> Array:
    """Both ends of p / q of two measured values with sds: (p - x q)^2 = level (sd^2 + x^2 sd_q^2), E. C. Fieller 1954."""
    return np.sort(np.roots([q**2 - level * sd_q**2, -2 * p * q, p**2 - level * sd**2]).real)


def test_the_profile_of_a_linear_model_is_its_parabola() -> None:
    x = np.linspace(0, 1, 20)
    design = np.column_stack([np.ones(20), x])
    y = design @ [1.0, 2.0] + np.random.default_rng(5).normal(size=20)
    model = (lambda t: y - design @ t), (lambda t: -design)
    fit = least_squares(*model, [P, Q], start=(0, 0), tolerance=1e-6)
    sum_sd = np.sqrt(fit.covariance.sum())
    for held, best, sd in (
        (Held.parameter([P, Q], "q"), fit.theta[1], fit.sd[1]), (Held.total([P, Q], "p", "q"), fit.theta.sum(), sum_sd)
    ):  # fmt: skip
        found = profile_likelihood(lambda _: model, held=held, theta=fit.theta)
        assert found.known == IDENTIFIED
        assert found.best == pytest.approx(best)
        np.testing.assert_allclose(ends(found), best + np.outer(ROOTS, [-sd, sd]), atol=1e-5 * sd)  # the fit it starts from is as near
        assert found.evaluations == 1 + 4
        assert all(p.deviance == pytest.approx(((p.value - best) / sd) ** 2, abs=1e-6) for p in found.points)
        assert found.least == pytest.approx(0.0, abs=1e-9)


def test_the_profile_of_an_exponential_has_its_own_two_sides() -> None:
    a = [Parameter("a", -5, 5)]
    found = profile_likelihood(
        lambda _: ((lambda t: (np.exp(t) - 2) / 0.7), (lambda t: np.exp(t)[None] / 0.7)),
        held=Held.parameter(a, "a"), theta=[np.log(2)],
    )
    wanted = np.log(2 + 0.7 * np.outer(ROOTS, [-1, 1]))
    slope = 2 * ROOTS[:, None] * np.exp(wanted) / 0.7  # of the deviance
    assert np.all(np.abs(ends(found) - wanted) < MISSED / slope)
    assert found.known == IDENTIFIED


def test_the_profile_of_a_factor_is_that_of_a_ratio() -> None:
    both = [Parameter("a", -2, 4), Parameter("b", 0.1, 10)]  # measured: a b = 1 +- 0.3, b = 2 +- 0.5

    def residual(t: Array) -> Array:
        return np.array([(t[0] * t[1] - 1) / 0.3, (t[1] - 2) / 0.5])

    def jacobian(t: Array) -> Array:
        return np.array([[t[1] / 0.3, t[0] / 0.3], [0, 1 / 0.5]])

    found = profile_likelihood(lambda _: (residual, jacobian), held=Held.parameter(both, "a"), theta=[0.5, 2.0])
    wanted = np.array([ratio(1, 2, 0.3, 0.5, level) for level in LEVELS])
    np.testing.assert_allclose(ends(found), wanted, rtol=5e-3)  # 0.01 sd
    calls = []

    def refit(*args: object, **settings: object) -> object:
        calls.append(settings)
        return least_squares(*args, **settings)  # type: ignore[arg-type]

    held = Held.parameter(both, "a")
    other = profile_likelihood(lambda _: (residual, jacobian), held=held, theta=[0.5, 2.0], guess=nearest, refit=refit)
    np.testing.assert_allclose(ends(other), wanted, rtol=5e-3)
    assert len(calls) == len(other.points) - 1
    plain = 0.5 + np.outer(ROOTS, [-1, 1]) * np.hypot(0.3 / 2, 0.5 * 0.5 / 2)
    assert np.abs(plain - wanted).max() > 0.1  # which the covariance does not tell


def test_the_share_of_two_measured_values() -> None:
    both = [Parameter("p", 0.01, 5, "MPa"), Parameter("q", 0, 5, "MPa")]
    sd = np.array([0.2, 0.3])

    def model(t: Array) -> Array:
        return (t - np.array([3.0, 1.0])) / sd

    held = Held.share(both, "p", "q", least=-2)
    found = profile_likelihood(lambda _: (model, lambda t: np.diag(1 / sd)), held=held, theta=[3.0, 1.0])
    x = np.array([ratio(1, 3, 0.3, 0.2, level) for level in LEVELS])  # q / p
    np.testing.assert_allclose(ends(found), x / (1 + x), rtol=5e-3)
    assert found.best == 0.25
    assert (held.low, held.high) == pytest.approx((0.0, 5 / 5.01))
    assert Held.share([Parameter("p", 0.01, 5), Parameter("q", -1, 5)], "p", "q", least=-2).low == -2


def test_a_parameter_at_its_bound_is_known_on_one_side() -> None:
    a = [Parameter("a", 0, 9)]
    found = profile_likelihood(lambda _: ((lambda t: t + 0.5), (lambda t: np.eye(1))), held=Held.parameter(a, "a"), theta=[0.0])
    assert found.known == ONE_SIDED
    assert [end.limit for end in found.ends[1]] == ["bound", ""]
    np.testing.assert_allclose(ends(found)[:, 1], np.sqrt(np.array(LEVELS) + 0.25) - 0.5, atol=MISSED / 2)
    assert np.all(ends(found)[:, 0] == 0)


def test_of_two_that_act_as_their_sum_the_sum_alone_is_known() -> None:
    both = [Parameter("p", 1, 2), Parameter("q", 1, 2)]  # with one at a bound the other can still make up for it
    model = (lambda t: np.array([t.sum() - 3.0]) / 0.1), (lambda t: np.full((1, 2), 10.0))
    for held in (Held.parameter(both, "p"), Held.parameter(both, "q"), Held.share(both, "p", "q", least=-2)):
        assert profile_likelihood(lambda _: model, held=held, theta=[1.4, 1.6]).known == NOT_IDENTIFIED
    found = profile_likelihood(lambda _: model, held=Held.total(both, "p", "q"), theta=[1.4, 1.6])
    assert found.known == IDENTIFIED
    np.testing.assert_allclose(ends(found), 3 + 0.1 * np.outer(ROOTS, [-1, 1]), atol=1e-6)


def test_what_cannot_be_solved_limits_a_profile() -> None:
    one = [Parameter("p", -10, 10)]

    def residual(theta: Array) -> Array | None:
        return None if theta[0] > 1.5 else theta

    found = profile_likelihood(lambda _: (residual, lambda t: np.eye(1)), held=Held.parameter(one, "p"), theta=[0.0])
    low, high = found.ends[1]
    assert (low.limit, high.limit) == ("", "unsolvable")
    assert 1.4 < high.value <= 1.5
    assert found.known == ONE_SIDED
    with pytest.raises(ValueError, match="cannot be solved at the best fit"):
        profile_likelihood(lambda _: ((lambda t: None), (lambda t: np.eye(1))), held=Held.parameter(one, "p"), theta=[0.0])
    with pytest.raises(ValueError, match="profile of 'q': not a parameter, wanted one of p"):
        Held.parameter(one, "q")


def test_a_better_fit_than_the_best_is_seen() -> None:
    a = [Parameter("a", -3, 3)]
    model = (lambda t: np.array([(t[0] ** 2 - 1) * 3, (t[0] - 1) * 0.5])), (lambda t: np.array([[6 * t[0]], [0.5]]))
    start = least_squares(*model, a, start=[-1.0], tolerance=1e-4).theta
    found = profile_likelihood(lambda _: model, held=Held.parameter(a, "a"), theta=start)
    assert found.least < -0.9 or found.ends[1][1].value < 0.0  # it goes over the hill, or sees none beyond


def test_ends_are_those_of_minos() -> None:
    x = np.linspace(0, 4, 30)
    y = 2 * np.exp(-0.7 * x) + 0.3 + np.random.default_rng(3).normal(size=30) * 0.15
    three = [Parameter("a", 0, 10), Parameter("k", 0.01, 5), Parameter("c", -5, 5)]

    def residual(t: Array) -> Array:
        return (t[0] * np.exp(-t[1] * x) + t[2] - y) / 0.15

    def jacobian(t: Array) -> Array:
        e = np.exp(-t[1] * x)
        return np.column_stack([e, -t[0] * x * e, np.ones_like(x)]) / 0.15

    fit = least_squares(residual, jacobian, three, start=[1, 1, 0], tolerance=1e-4)
    minuit = Minuit(lambda t: float(residual(t) @ residual(t)), fit.theta, name=[p.name for p in three])
    minuit.tol = 1e-6
    minuit.migrad()
    for p, best in zip(three, fit.theta, strict=True):
        found = profile_likelihood(lambda _: (residual, jacobian), held=Held.parameter(three, p.name), theta=fit.theta)
        for level, own in zip(LEVELS, ends(found), strict=True):
            minuit.errordef = level
            minuit.minos(p.name)
            error = minuit.merrors[p.name]
            np.testing.assert_allclose(own - best, [error.lower, error.upper], rtol=0.01)
        assert found.known == IDENTIFIED
        assert found.evaluations < 25


def test_a_value_is_tested_under_the_errors_that_it_would_have_itself() -> None:
    # x measured as 2 with an sd of x / 4: the ends are where |2 - v| = root v / 4
    one = [Parameter("x", 0.01, 50)]

    def around(theta: Array) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
        sd = theta[0] / 4
        return (lambda t: (2 - t) / sd), (lambda t: np.full((1, 1), -1 / sd))

    found = profile_likelihood(around, held=Held.parameter(one, "x"), theta=[2.0])
    wanted = 2 / (1 + np.outer(ROOTS, [1, -1]) / 4)
    np.testing.assert_allclose(ends(found), wanted, rtol=5e-3)
    plain = 2 + np.outer(ROOTS, [-1, 1]) * 2 / 4
    assert np.abs(plain - wanted).max() > 0.5  # which errors held as at the best fit would say


def test_the_best_fit_is_asked_for_under_the_errors_of_each_value() -> None:
    # x measured as 2 with an sd of x / 4, and as 2.6 with one of 0.4: under other errors another x fits best
    one, y = [Parameter("x", 0.01, 50)], np.array([2.0, 2.6])

    def around(theta: Array) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
        sd = np.array([theta[0] / 4, 0.4])
        return (lambda t: (y - t) / sd), (lambda t: -1 / sd[:, None])

    found = profile_likelihood(around, held=Held.parameter(one, "x"), theta=[2.3])
    for pair, level in zip(found.ends, LEVELS, strict=True):
        for end in pair:
            weight = 1 / np.array([end.value / 4, 0.4]) ** 2
            deviance = (weight @ y / weight.sum() - end.value) ** 2 * weight.sum()
            assert deviance == pytest.approx(level, abs=MISSED)
