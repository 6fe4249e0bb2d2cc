"""What a model keeps of its solves makes it quicker, and changes no prediction."""

import pickle
from collections.abc import Callable
from itertools import permutations

import numpy as np
import pytest

from fe import Case
from twin.effects.library import effect
from twin.effects.protocol import Order, Unsolvable
from twin.effects.standins import stand_ins
from twin.model import prediction
from twin.model.keptmodel import KEPT, SAME, KeptModel, base_model
from twin.model.prediction import Model
from twin.targets import Array, Targets

BASE = {"C10": 0.214, "C01": 0.083}
CREEP = {"creep.g1": 0.05, "creep.tau1": 3.0}
# Neighbours by 0.002 and 0.03 mm of about 1 mm of motion, and one farther off
FACTORS = (1.0, 1.002, 1.03, 1.3)


@pytest.fixture(scope="module")
def pure(coarsest_case: Case, make_targets: Callable[..., Targets]) -> Model:
    kept = base_model(make_targets(), coarsest_case)
    return Model(kept.test, kept.effects, kept.reference)


def remembering(pure: Model) -> KeptModel:
    """A model that has solved nothing yet."""
    return KeptModel(pure.test, pure.effects, pure.reference)


def constants(model: Model, factor: float) -> Array:
    return model.theta({name: factor * value for name, value in BASE.items()})


def creeping(model: Model, factor: float) -> Array:
    return model.theta({**BASE, "creep.g1": 0.05 * factor, "creep.tau1": 3.0 * factor})


@pytest.mark.slow
def test_predictions_do_not_depend_on_the_order_of_asking(pure: Model) -> None:
    asked = [constants(pure, f) for f in FACTORS]
    alone = [pure.predict(theta) for theta in asked]
    assert np.abs(alone[1] - alone[0]).max() > 1e3 * SAME  # a neighbour's prediction is another one
    for order in list(permutations(range(len(asked))))[::5]:
        model = remembering(pure)
        for k in order:
            np.testing.assert_allclose(model.predict(asked[k]), alone[k], rtol=0, atol=SAME)


@pytest.mark.slow
def test_what_was_asked_before_changes_no_prediction_of_a_creeping_finger(pure: Model) -> None:
    """Also not what was asked of the base model, whose solves a model with an effect starts from."""
    creep = effect("creep")
    wanted = {f: (m := pure.with_effect(creep)).predict(creeping(m, f)) for f in (1.0, 1.03)}
    base = remembering(pure)
    base.predict(constants(base, 1.01))
    model = base.with_effect(creep)
    for f in (1.03, 1.0):
        np.testing.assert_allclose(model.predict(creeping(model, f)), wanted[f], rtol=0, atol=SAME)


def test_derivatives_do_not_depend_on_what_was_solved_before(pure: Model) -> None:
    theta, model = constants(pure, 1.0), remembering(pure)
    model.predict(constants(pure, 1.002))
    wanted = pure.jacobian(theta)
    # of Newton's last correction, `fe.solver.newton.TOLERANCE`, derivatives are 1e-6 wrong
    np.testing.assert_allclose(model.jacobian(theta), wanted, rtol=0, atol=2e-6 * np.abs(wanted).max())


def test_a_repeated_question_is_not_solved_again(pure: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    solves: list[int] = []

    def counted(*args: object, **named: object) -> object:
        solves.append(1)
        return respond(*args, **named)  # type: ignore[arg-type]

    respond = prediction.respond
    monkeypatch.setattr(prediction, "respond", counted)
    model = remembering(pure)
    theta = constants(pure, 1.0)
    u = model.predict(theta)
    model.jacobian(theta), model.solution(theta), model.per_pressure(theta)
    assert np.array_equal(model.predict(theta), u)
    assert len(solves) == 1
    for k in range(KEPT):  # so many others push it out
        model.predict(constants(pure, 1.0 + 0.001 * (k + 1)))
    assert len(solves) == 1 + KEPT
    np.testing.assert_allclose(model.predict(theta), u, rtol=0, atol=SAME)
    assert len(solves) == 2 + KEPT


def test_what_has_no_equilibrium_is_not_tried_again(pure: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    solves: list[int] = []
    respond = prediction.respond

    def counted(*args: object, **named: object) -> object:
        solves.append(1)
        return respond(*args, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(prediction, "respond", counted)
    model = remembering(pure)
    soft = constants(pure, 0.05)
    with pytest.raises(Unsolvable, match="finite-element model") as first:
        model.values(soft)
    with pytest.raises(Unsolvable) as again:
        model.predict(soft)
    assert (str(again.value), again.value.reached) == (str(first.value), first.value.reached)
    assert len(solves) == 1
    model.predict(constants(pure, 1.0))


def test_a_worker_has_the_solves_of_the_model_that_it_is_sent(
    pure: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    base, theta = remembering(pure), constants(pure, 1.0)
    model = base.with_effect(effect("creep"))
    there = model.theta({**BASE, **CREEP})
    u, creeping = base.predict(theta), model.predict(there)
    sent: KeptModel = pickle.loads(pickle.dumps(model))
    monkeypatch.setattr(prediction, "respond", None)
    assert isinstance(sent.parent, KeptModel)
    assert np.array_equal(sent.parent.predict(theta), u)
    assert np.array_equal(sent.predict(there), creeping)


def test_a_model_with_an_effect_is_one_object_with_its_solves(pure: Model) -> None:
    base = remembering(pure)
    model = base.with_effect(effect("creep"))
    assert base.with_effect(effect("creep")) is model
    assert model.base is base
    again = base.with_effect(effect("creep:2")).with_effect(effect("creep"))
    assert [e.label for e in again.effects] == [e.label for e in model.effects]
    moved = base.over(model)
    assert moved is base  # both solve the half


def test_what_is_only_drawn_has_no_derivatives_and_is_not_kept(pure: Model) -> None:
    model = remembering(pure)
    theta = constants(model, 1.0)
    found = model.drawn(theta)
    assert found.jacobian is None
    assert model.kept == ()
    np.testing.assert_allclose(found.u, model.predict(theta), rtol=0, atol=SAME)


def test_what_comes_by_a_course_of_its_own_is_solved_after_a_solve_without_derivatives(pure: Model) -> None:
    """A solve of values alone is no start ahead, and no error: that of a force that comes late."""
    (late, *_) = (e for e in stand_ins(pure.test) if e.order == Order.COURSE)
    model = remembering(pure).with_effect(late)
    assert isinstance(model, KeptModel)
    softer = {name: 0.98 * value for name, value in BASE.items()}
    here, there = (
        model.theta({**constants, **{p.name: x for p in late.parameters}})
        for constants, x in ((BASE, 0.01), (softer, 0.02))
    )
    model.values(here)
    after = model.solved(there, derivatives=True)
    np.testing.assert_allclose(after.u, model.drawn(there).u, rtol=0, atol=SAME)
    assert np.abs(after.u - model.values(here).u).max() > 10 * SAME
