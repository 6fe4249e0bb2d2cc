"""A finer run of a program tells by how much its discretisation errs."""

from functools import partial

import numpy as np
import pytest

import twin
from tests.messages import says
from tests.twin.foreign.arcs import BEND, PLACES, STIFF, TIME, TRUE, course, data_of
from twin.foreign.foreigndiagnosis import with_discretisation
from twin.foreign.foreignmodel import ForeignModel
from twin.foreign.programs import Simulator, Values
from twin.targets import Array


def polygon(values: Values, pressure: Array, *, links: int = 20) -> Array:
    """Displacements (s, 3, 3) mm of an arc that is a chain of so many straight links, by the turn before each."""
    k = (values["curvature"] * pressure + values["bend"] * pressure**2)[:, None]
    h = 100.0 / links
    turn, places = k * h * np.arange(1, links + 1), np.array(list(PLACES.values()))
    along = np.concatenate([[0.0], h * np.arange(1, links + 1)])
    u = np.zeros((len(pressure), 3, 3))
    for i, f in ((0, np.cos), (2, lambda x: -np.sin(x))):
        at = np.concatenate([0 * k, np.cumsum(h * f(turn), axis=1)], axis=1)
        u[..., i] = [np.interp(places[:, 0], along, row) for row in at]
    u[..., 0] -= places[:, 0]
    return u


def program(finer: int | None) -> Simulator:
    other = None if finer is None else partial(polygon, links=finer)
    return twin.simulator(polygon, [STIFF, BEND], finer=other)


def test_the_discretisation_is_not_taken_for_an_effect() -> None:
    data = data_of(polygon(TRUE, course(TIME), links=100))
    assert twin.diagnose(program(None), data).verdict != "none needed"  # links turn too early, by half of one
    found = twin.diagnose(program(40), data)
    assert found.verdict == "none needed"
    says(str(found), "A finer run moves the points by up to")


def test_its_error_is_what_the_finer_run_changes() -> None:
    data, coarse = data_of(polygon(TRUE, course(TIME), links=100)), program(None)
    model = ForeignModel.of(coarse, data)
    theta = model.theta(TRUE)
    more = with_discretisation(data, model, theta, partial(polygon, links=40))
    assert more.mode_names == (*data.mode_names, "discretisation:finer")
    u = [polygon(TRUE, data.pressure, links=n) for n in (20, 40)]
    shift = u[1] - u[0]
    assert more.modes[-1] == pytest.approx(shift - shift[:1], abs=1e-9)  # the reference is step 0
    assert more.value is data.value
