"""A response answers within its range as whole solves do, and refuses outside it."""

from collections.abc import Callable

import numpy as np
import pytest

from fe import Case
from tests.messages import saying
from twin.effects.library import effect
from twin.effects.protocol import Unsolvable
from twin.model.keptmodel import KeptModel, base_model
from twin.model.rangedresponse import LEAST, SPREAD, RangedResponse, spread
from twin.targets import Array, Targets

FITTED = {"C10": 0.214, "C01": 0.083, "stiffening.C20": 0.01}  # MPa


@pytest.fixture(scope="module")
def model(coarsest_case: Case, make_targets: Callable[..., Targets]) -> KeptModel:
    base = base_model(make_targets(), coarsest_case)
    assert isinstance(base, KeptModel)
    return base.with_effect(effect("stiffening"))


@pytest.fixture(scope="module")
def response(model: KeptModel) -> RangedResponse:
    return RangedResponse.of(model, model.theta(FITTED))


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


@pytest.mark.slow
def test_its_error_is_what_it_states(model: KeptModel, response: RangedResponse) -> None:
    """At random points of the range, by whole solves that it has not seen. Of one solve it is off by ten times
    as much at least."""
    rng = np.random.default_rng(11)
    asked = response.low + (response.high - response.low) * rng.random((8, 3))
    first = RangedResponse.of(model, model.theta(FITTED), solves=1)
    off, stated, rough = [], [], []
    for theta in asked:
        u, found = KeptModel(model.test, model.effects, model.reference).predict(theta), response.answer(theta)
        off.append(rms(found.u - u))
        stated.append(rms(found.error))
        rough.append(rms(first.answer(theta).u - u))
    assert rms(np.array(off)) < 1.25 * rms(np.array(stated))
    assert rms(np.array(stated)) < 0.01  # mm: less than a film's noise, so that the statement says something
    assert rms(np.array(off)) < 0.1 * rms(np.array(rough))


def test_what_is_not_asked_for_stays_as_it_was_fitted(model: KeptModel, response: RangedResponse) -> None:
    found = response.at({"C10": 0.24})
    np.testing.assert_array_equal(found.u, response.answer(model.theta({**FITTED, "C10": 0.24})).u)
    assert np.abs(response.at().u - model.predict(model.theta(FITTED))).max() < 1e-4
    assert response.at().error.min() >= LEAST


def test_the_range_is_around_the_fit_unless_it_is_stated(model: KeptModel, response: RangedResponse) -> None:
    low, high = response.ranges["C10"]
    assert (low, high) == pytest.approx((0.214 * (1 - SPREAD), 0.214 * (1 + SPREAD)))
    step = model.parameters[2].step  # more than 20 % of so small a value
    assert response.ranges["stiffening.C20"] == pytest.approx((0.01 - step, 0.01 + step))
    stated = RangedResponse.of(model, model.theta(FITTED), within={"C10": (0.22, 0.25)}, solves=1)
    assert stated.ranges["C10"] == (0.22, 0.25)
    assert stated.middle[0] == 0.22  # the nearest to what was fitted


@pytest.mark.parametrize("C10", [0.3, 0.1, np.nan])
def test_outside_its_range_it_does_not_answer(response: RangedResponse, C10: float) -> None:
    with pytest.raises(ValueError, match=saying(r"C10 = \S+", r"0\.1712", r"0\.2568 MPa", r"within=\{'C10'")):
        response.at({"C10": C10})


def test_what_is_wrong_is_said(model: KeptModel, response: RangedResponse) -> None:
    theta = model.theta(FITTED)
    with pytest.raises(ValueError, match=r"C20 = 0\.1: the model has no such parameter; wanted one of C10, "):
        response.at({"C20": 0.1})
    with pytest.raises(ValueError, match=r"within: C20 is no parameter"):
        RangedResponse.of(model, theta, within={"C20": (0.0, 1.0)})
    with pytest.raises(ValueError, match=saying("C10", r"0\.3", r"0\.2 MPa")):
        RangedResponse.of(model, theta, within={"C10": (0.3, 0.2)})
    with pytest.raises(ValueError, match=saying("solves = 0", "1")):
        RangedResponse.of(model, theta, solves=0)
    with pytest.raises(ValueError, match=r"cannot be made: .* give a narrower one as within="):
        RangedResponse.of(model, model.theta({**FITTED, "C10": 0.01, "C01": 0.0}), solves=1)


def test_of_constants_alone_nothing_is_solved_twice(model: KeptModel) -> None:
    one = RangedResponse.of(model.base, np.array([0.214, 0.083]), solves=1)  # type: ignore[arg-type]
    assert len(one.surrogate.rows) == 3  # a value, and its derivatives by two constants
    assert one.surrogate.misses == ()  # nothing has checked it yet


def test_more_points_add_to_fewer() -> None:
    low, high = np.array([0.0, 10.0]), np.array([1.0, 12.0])
    more = spread(low, high, 16)
    np.testing.assert_array_equal(spread(low, high, 5), more[:5])
    assert spread(low, high, 0).shape == (0, 2)
    assert ((low <= more) & (more <= high)).all()
    np.testing.assert_allclose(more.mean(axis=0), [0.5, 11.0], atol=0.1)  # random ones: 0.07 and 0.14, 1 sd


def test_no_range_goes_where_there_is_no_such_finger(model: KeptModel) -> None:
    base, theta = model.base, np.array([0.214, -0.075])  # MPa: rubber that is just stable
    assert isinstance(base, KeptModel)
    low, high = RangedResponse.of(base, theta, within={"C10": (0.214, 0.22)}, solves=1).ranges["C01"]
    step = base.parameters[1].step
    assert -0.075 - step < low < -0.075 < high < -0.075 + step
    base.put({"C10": 0.214, "C01": low})
    with pytest.raises(Unsolvable, match="no stable rubber"):
        base.put({"C10": 0.214, "C01": -0.075 - step})
