"""A normal prior enters a fit as one more value; what it did is told from the fit alone."""

import math

import numpy as np
import pytest

from calibrate import Fit, Parameter, least_squares, profile_likelihood
from calibrate.fit import Jacobian, Residual
from calibrate.parameters import Array
from calibrate.priors import Prior, Pull, with_priors
from calibrate.profiles import Held

TWO = (Parameter("C10", 0.01, 1.0, "MPa"), Parameter("C01", -0.2, 1.0, "MPa"))
ROWS = np.array([[30.0, 20.0], [10.0, 40.0], [25.0, 25.0], [5.0, -8.0]])
DATA = np.array([12.0, 9.0, 13.0, 0.5])


def posed() -> tuple[Residual, Jacobian]:
    return lambda theta: ROWS @ theta - DATA, lambda theta: ROWS


def fitted(*priors: Prior) -> Fit:
    return least_squares(*with_priors(*posed(), priors), TWO, start=[0.3, 0.1], tolerance=1e-6)


PRIORS = {
    "C10": Prior(Held.parameter(TWO, "C10"), 0.25, 0.01),
    "sum": Prior(Held.total(TWO, "C10", "C01"), 0.30, 0.02),
    "share": Prior(Held.share(TWO, "C10", "C01", least=-0.5), 0.30, 0.05),
}


@pytest.mark.parametrize("name", ["C10", "sum"])
def test_a_linear_fit_with_a_prior_is_the_posterior_in_closed_form(name: str) -> None:
    prior, fit = PRIORS[name], fitted(PRIORS[name])
    way = np.array([1.0, 0.0]) if name == "C10" else np.ones(2)
    precision = ROWS.T @ ROWS + np.outer(way, way) / prior.sd**2
    mean = np.linalg.solve(precision, ROWS.T @ DATA + way * prior.mean / prior.sd**2)
    assert fit.theta == pytest.approx(mean, rel=1e-7)
    assert fit.covariance == pytest.approx(np.linalg.inv(precision), rel=1e-7)
    assert fit.degrees_of_freedom == len(DATA) + 1 - 2
    assert fit.chi2 == pytest.approx(np.sum((ROWS @ mean - DATA) ** 2) + prior.value(mean) ** 2)


@pytest.mark.parametrize("name", ["C10", "sum"])
def test_what_the_data_say_alone_is_told_from_the_fit_with_the_prior(name: str) -> None:
    prior, free = PRIORS[name], fitted()
    pull = prior.share_in(fitted(prior))
    way = prior.held.slope(free.theta)
    sd = math.sqrt(way @ free.covariance @ way)
    assert pull.without == pytest.approx(prior.held.value(free.theta), rel=1e-6)
    assert pull.sd_without == pytest.approx(sd, rel=1e-6)
    assert pull.moved == pytest.approx((pull.value - pull.without) / sd, rel=1e-6)
    assert pull.apart == pytest.approx(abs(prior.mean - pull.without) / math.hypot(sd, prior.sd), rel=1e-6)


def test_a_profile_knows_the_prior() -> None:
    pair = with_priors(*posed(), [PRIORS["C10"]])
    fit = fitted(PRIORS["C10"])
    ends = profile_likelihood(lambda theta: pair, held=Held.parameter(TWO, "C10"), theta=fit.theta).ends[1]
    half = 1.96 * fit.sd[0]
    assert [end.value for end in ends] == pytest.approx([fit.theta[0] - half, fit.theta[0] + half], abs=0.01 * half)


def test_the_slope_of_what_is_held_is_that_of_its_value() -> None:
    theta, h = np.array([0.31, 0.12]), 1e-7
    for prior in PRIORS.values():
        steps: Array = h * np.eye(2)
        wanted = [(prior.held.value(theta + d) - prior.held.value(theta - d)) / (2 * h) for d in steps]
        assert prior.held.slope(theta) == pytest.approx(wanted, abs=1e-6)
        assert prior.slope(theta) == pytest.approx(np.array(wanted) / prior.sd, rel=1e-6)


def test_where_nothing_else_tells_of_a_value_the_data_say_nothing() -> None:
    assert math.isnan(Pull.of(0.2, 0.05, 0.2, 0.05**2).without)
    assert math.isnan(Pull.of(0.2, 0.05, 0.2, math.nan).without)
    assert math.isnan(Pull.of(0.2, 0.05, 0.2, 0.0).moved)  # at its bound


def test_a_model_without_an_answer_has_none_with_a_prior() -> None:
    residual, _ = with_priors(lambda theta: None, lambda theta: ROWS, [PRIORS["C10"]])
    assert residual(np.array([0.3, 0.1])) is None
