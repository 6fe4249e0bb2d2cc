"""What the next test would bring: the algebra of mimics against plain least squares, films that were not made
against solves along their history, and ties whose way out is known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Case
from twin.diagnosis.diagnosisrecord import NextTest
from twin.effects.library import effect
from twin.effects.material import Elasticity
from twin.experiments.choice import Experiment, Member, in_words, next_experiments, ranked
from twin.experiments.plannederrors import Rows, measured, separation
from twin.experiments.plannedfilms import Film, heavy, in_film, responses
from twin.judging.fitting import whitener_of
from twin.model.discretisation import Discretisation
from twin.model.keptmodel import base_model
from twin.model.prediction import Model
from twin.targets import Targets

FREE = np.full(3, np.inf)
NOMINAL = {"C10": 0.214, "C01": 0.083}


def rows(seed: int, *, shared: int = 2, count: int = 40) -> Rows:
    rng = np.random.default_rng(seed)
    return Rows(rng.standard_normal(count), rng.standard_normal((count, 3)), rng.standard_normal((count, shared)))


def test_a_separation_is_what_least_squares_leave() -> None:
    one, two = rows(1), rows(2)
    columns = np.vstack([np.hstack([r.slopes, r.shared]) for r in (one, two)] + [np.eye(5)[3:]])
    wanted = np.concatenate([one.difference, two.difference, np.zeros(2)])
    left = wanted - columns @ np.linalg.lstsq(columns, wanted)[0]
    assert separation([one, two], low=-FREE, high=FREE) == pytest.approx(np.linalg.norm(left), rel=1e-9)
    # an error that only the second film has costs its own unit of variance
    alone = Rows(one.difference, one.slopes, np.zeros((40, 0)))
    assert separation([alone, two], low=-FREE, high=FREE) > separation([one, two], low=-FREE, high=FREE) - 1e-9


def test_a_mimic_stays_within_its_bounds() -> None:
    one = rows(3)
    free = separation([one], low=-FREE, high=FREE)
    held = separation([one], low=np.full(3, -1e-12), high=np.full(3, 1e-12))
    half = separation([one], low=np.zeros(3), high=FREE)
    assert free < half < held
    assert held == pytest.approx(np.sqrt(one.difference @ np.linalg.solve(np.eye(40) + one.shared @ one.shared.T, one.difference)))
    same = Rows(one.slopes @ [1.0, -2.0, 0.5], one.slopes, one.shared)
    assert separation([same], low=-FREE, high=FREE) < 1e-6  # what the mimic can do is no separation


def test_a_quantity_measured_by_itself_counts_by_its_sd() -> None:
    none = Rows(np.zeros(1), np.zeros((1, 3)), np.zeros((1, 0)))
    told = measured(0.05, 0.0, sd=0.002, column=None, parameters=3)
    assert separation([none, told], low=-FREE, high=FREE) == pytest.approx(25.0)
    # the mimic that has the parameter takes it up, unless the film holds it where it is: 0.004 of sd 0.003
    told = measured(0.05, 0.046, sd=0.002, column=1, parameters=3)
    assert separation([none, told], low=-FREE, high=FREE) < 1e-6
    film = Rows(np.zeros(1), np.array([[0.0, 1 / 0.003, 0.0]]), np.zeros((1, 0)))
    assert separation([film, told], low=-FREE, high=FREE) == pytest.approx(0.004 / np.hypot(0.002, 0.003))


def test_the_quickest_that_is_enough_comes_first() -> None:
    found = [
        Experiment(experiment=name, sigmas=s, minutes=m)
        for name, s, m in (("turn it", 40.0, 10.0), ("hold it", 0.82, 6.0), ("step it", 7.0, 5.0), ("see more", 3.0, 2.0))
    ]
    order = ranked(found)
    assert [e.experiment for e in order] == ["step it", "turn it", "see more", "hold it"]
    assert in_words(order) == "step it (5 minutes): 7.0 sigma apart; to turn it would give 40; to hold it would give 0.8"
    assert in_words(ranked(found[1:2])).startswith("no test of the list tells them apart")
    assert in_words(()) == ""


def model_with(targets: Targets, case: Case, label: str, values: dict[str, float]) -> Member:
    model = base_model(targets, case).with_effect(effect(label))
    return Member(model, model.theta({**NOMINAL, **values}))


@pytest.fixture(scope="module")
def targets(make_targets: Callable[..., Targets]) -> Targets:
    """A short film with noise of 0.2 um: the coarse finger moves by 0.4 mm only."""
    return make_targets(covariance=np.tile(4e-8 * np.eye(3), (8, 3, 1, 1)))


STEP_UP = Film(name="a step", corners=((0.0, 0.0), (1.0, 0.0), (1.2, 1.0), (8.0, 1.0)), hz=2.0)


@pytest.mark.parametrize(
    ("label", "values", "close"),
    [
        # mm of 0.4: eight levels of pressure against twelve
        ("pressure_lag", {"pressure_lag.tau": 0.4}, 1e-4),
        # the equivalent pressure is that of a linear body
        pytest.param("creep", {"creep.g1": 0.1, "creep.tau1": 2.0}, 0.012, marks=pytest.mark.slow),
        ("camera_scale", {"camera_scale.scale": 0.02}, 1e-4),
    ],
)
def test_a_planned_film_shows_what_the_model_does_along_its_history(
    targets: Targets, coarsest_case: Case, label: str, values: dict[str, float], close: float
) -> None:
    member = model_with(targets, coarsest_case, label, values)
    points = np.array([coarsest_case.position(4401)])
    films = [STEP_UP, Film(name="again"), replace(STEP_UP, top=0.5)]
    found = responses(member.model, member.theta, films, points)
    for film, response in zip(films, found, strict=True):
        whole = in_film(member.model, film, points)
        new = slice(len(whole.reference), None)
        exact, slopes = Model.predict(whole, member.theta)[new], Model.jacobian(whole, member.theta)[:, new]
        assert np.abs(exact).max() > 0.15
        assert response.u == pytest.approx(exact, abs=close)
        scale = np.array([p.step for p in whole.parameters])[:, None, None, None]
        assert scale * response.jacobian == pytest.approx(scale * slopes, abs=close)
    assert np.array_equal(found[0].u[:, 0], found[0].u[:, 3])  # the marker and the one added at its place


def test_experiments_are_planned_for_a_model_with_the_error_of_its_mesh(targets: Targets, coarsest_case: Case) -> None:
    member = model_with(targets, coarsest_case, "camera_scale", {"camera_scale.scale": 0.02})
    grid, count = np.linspace(0.0, 0.02, 6), int(member.model.test.moving.sum())
    base = 40.0 * grid[None, :, None, None] * np.ones((1, 1, count, 3))
    mesh = Discretisation(("check",), 0.3, grid, np.zeros((1, 3)), base, 0.01 * base[None])
    points = np.array([coarsest_case.position(4401)])
    plain, corrected = (
        responses(m, member.theta, [STEP_UP], points)[0].u for m in (member.model, member.model.on_mesh(mesh))
    )
    np.testing.assert_array_equal(plain, corrected)


def test_a_finger_turned_over_sags_the_other_way(targets: Targets, coarsest_case: Case) -> None:
    member = model_with(targets, coarsest_case, "camera_scale", {"camera_scale.scale": 0.0})
    weighed = heavy(member.model, np.array([0.0, 0.0, -1.0]))
    films = [Film(name="as it is"), Film(name="turned", gravity=(0.0, 0.0, 1.0))]
    as_is, turned = responses(weighed, member.theta, films, np.zeros((0, 3)))
    assert abs(as_is.u[0, 0, 2]) < 1e-3
    assert turned.u[0, 0, 2] > 0.05  # mm, at rest, relative to the rest before: twice its sag


def test_a_gauge_is_told_from_a_scale_by_what_measures_either(
    make_targets: Callable[..., Targets], coarsest_case: Case
) -> None:
    # of known constants, as pressure scales with them
    targets = make_targets(covariance=np.tile(9e-6 * np.eye(3), (8, 3, 1, 1)))
    known = base_model(targets, coarsest_case, elasticity=Elasticity(fixed=NOMINAL))
    gain, scale = (known.with_effect(effect(name)) for name in ("pressure_gain", "camera_scale"))
    w = whitener_of(gain, np.array([0.03]), targets)
    found = next_experiments([Member(m, np.array([0.03])) for m in (gain, scale)], targets, w)
    sigmas = {e.experiment: e.sigmas for e in found}
    gauge = sigmas["check the pressure gauge against a second one"]
    ruler = sigmas["film a ruler in the finger's plane"]
    again = sigmas["repeat the film as it was"]
    assert again < 5.0
    # 0.03 of the sd of what is measured, 0.002 and 0.001, and of what the film knows of it, about 0.0017
    assert gauge == pytest.approx(0.03 / np.hypot(0.002, 0.0017), rel=0.2)
    assert ruler == pytest.approx(0.03 / np.hypot(0.001, 0.0017), rel=0.2)
    assert not [n for n in sigmas if n == "weigh the finger" or "supply line" in n]  # not what they differ in
    assert NextTest.of(found[0]).words.startswith(f"{found[0].experiment} (")
    assert next_experiments([Member(gain, np.array([0.03]))], targets, w) == ()
