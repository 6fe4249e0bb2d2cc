"""What readings tell of C10 and C01: against random draws, against finite differences, and in its order."""

import math

import numpy as np
import pytest

from fe import Case
from twin.effects.material import Elasticity
from twin.laws.mooneyrivlin import mooney_rivlin
from twin.model.keptmodel import base_model
from twin.model.prediction import Model
from twin.study.separability import UNKNOWN, Sensitivities, Separation, Spot
from twin.targets import Targets, at_node

THETA = np.array([0.15, 0.1])
HERE = mooney_rivlin(*THETA)
TOP = 0.03


def two_readings(case: Case) -> Targets:
    """U3 of the tip and the middle at one pressure, 1 mm."""
    names, x = ("tip", "middle"), (10 + 100 / 3, 4 + 50 / 3)
    rows = [int(np.linalg.norm(case.nodes - (v, 11.5, 0.0), axis=1).argmin()) for v in x]
    points = tuple(at_node(n, int(case.labels[r])) for n, r in zip(names, rows))
    value, valid = np.full((2, 2, 3), np.nan), np.zeros((2, 2, 3), bool)
    value[:, :, 2], valid[1, :, 2] = [[0.0, 0.0], [-5.0, -2.0]], True
    covariance = np.full((2, 2, 3, 3), np.nan)
    covariance[:, :, 2, 2] = 1.0
    time, pressure = np.array([0.0, 1.0]), np.array([0.0, TOP])
    return Targets(
        time=time, pressure=pressure, block=np.zeros(2, int), points=points, value=value, covariance=covariance,
        valid=valid, held_out=np.zeros(2, bool), modes=np.zeros((0, 2, 2, 3)), mode_names=(), noise=None,
        log_time=time, log_pressure=pressure, reference=np.array([0]), gravity=None, pressure_sd=np.zeros(2),
    )  # fmt: skip


@pytest.fixture(scope="module")
def model(short_case: Case) -> Model:
    return base_model(two_readings(short_case), short_case, elasticity=Elasticity())


@pytest.fixture(scope="module")
def shown(model: Model, short_case: Case) -> Sensitivities:
    points = two_readings(short_case).points
    places = [short_case.position(p.node or 0) for p in points]
    spots = [Spot(name=p.name, node=p.node or 0, place=x) for p, x in zip(points, places)]
    return Sensitivities.of(model, THETA, spots=spots, top=TOP)


def test_knowledge_is_that_of_random_draws() -> None:
    rng, jacobian = np.random.default_rng(3), np.array([[9.0, 4.0], [3.0, 7.0], [5.0, 5.5]])
    known = Separation.of(jacobian.T @ jacobian / 0.02**2, HERE, 0.02)
    noise = 0.02 * rng.standard_normal((20_000, 3))
    drawn = THETA + np.linalg.lstsq(jacobian, noise.T, rcond=None)[0].T
    share = drawn[:, 1] / drawn.sum(axis=1)
    # 20000 draws know an sd to 0.5 %; the share is curved by as much again
    assert known.share_sd == pytest.approx(share.std(), rel=0.02)
    assert known.correlation == pytest.approx(np.corrcoef(drawn.T)[0, 1], abs=0.02)
    wanted = known.wanted_sd_mm
    assert Separation.of(jacobian.T @ jacobian / wanted**2, HERE, wanted).share_sd == pytest.approx(0.1)


def test_one_reading_leaves_the_share_open() -> None:
    known = Separation.of(np.outer([9.0, 4.0], [9.0, 4.0]), HERE, 1.0)
    assert (known.share_sd, known.wanted_sd_mm, known.correlation) == (None, None, -1.0)
    assert known.sd == math.inf


def test_derivatives_are_those_of_the_model(model: Model, shown: Sensitivities) -> None:
    assert shown.pressure[-1] > TOP
    top = int(np.argmin(np.abs(shown.pressure - TOP)))
    for k, h in enumerate(1e-3 * np.eye(2)):
        by_hand = (model.predict(THETA + h) - model.predict(THETA - h))[1] / 2e-3
        # central differences over 1 % of a constant are good to 1e-4
        np.testing.assert_allclose(shown.jacobian[k, top], by_hand, rtol=2e-3, atol=1e-3 * np.abs(by_hand).max())
    np.testing.assert_allclose(shown.u[top], model.predict(THETA)[1], atol=1e-5)


def test_readings_come_best_first_and_none_makes_it_worse(shown: Sensitivities) -> None:
    seen = np.zeros(shown.u.shape, bool)
    seen[int(np.argmin(np.abs(shown.pressure - TOP))), :, 2] = True
    information = shown.information(seen, 1.0)
    now = Separation.of(information, HERE, 1.0)
    assert now.sd > 10 * UNKNOWN
    assert now.correlation < -0.999
    found = shown.readings(information, HERE, 1.0)
    assert len(found) == shown.u.size
    sds = [r.sd for r in found]
    assert sds == sorted(sds)
    assert sds[0] < 0.5 * now.sd
    assert sds[-1] <= now.sd * (1 + 1e-6)
    best = found[0]
    p, i = [s.name for s in shown.spots].index(best.point), int(best.direction[1]) - 1
    row = shown.jacobian[:, int(np.flatnonzero(shown.pressure == best.pressure_MPa)[0]), p, i]
    # every one of them by hand: the information of a row is its outer product
    by_hand = Separation.of(information + np.outer(row, row), HERE, 1.0)
    assert by_hand.model_dump().items() <= best.model_dump().items()


def test_plans_hold_the_readings_that_they_name(shown: Sensitivities) -> None:
    seen = np.zeros(shown.u.shape, bool)
    seen[int(np.argmin(np.abs(shown.pressure - TOP))), :, 2] = True
    information = shown.information(seen, 1.0)
    some = shown.plans(information, HERE, 1.0, names=("tip", "middle"), component=2, top=TOP)
    levels = int((shown.pressure <= TOP * (1 + 1e-9)).sum())
    assert [p.count for p in some] == [2, 2 * (levels - 1), 4 * levels, 4 * levels]
    assert some[0].words == "U1 of tip and middle at the same pressure"
    assert "kPa" in some[2].words
    assert some[2].sd < some[0].sd
