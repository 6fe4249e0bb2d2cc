"""Derivatives of the whole model against central differences of whole predictions."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibrate import Parameter
from fe import Case
from tests.messages import saying
from twin.effects.library import all_effects, effect
from twin.effects.protocol import Effect, Test, Theta, Unsolvable
from twin.model.keptmodel import KeptModel, base_model
from twin.model.prediction import respond
from twin.targets import Array, Targets

THETA = {
    "C10": 0.214, "C01": 0.083, "creep.g1": 0.05, "creep.tau1": 3.0, "stiffening.C20": 0.01,
    "clamp.compliance": 1e-4, "pressure_gain.gain": 0.03, "pressure_lag.tau": 0.2, "pressure_offset.offset": 3e-4, "gravity.density": 1e-9, "camera_scale.scale": 0.02,
}  # fmt: skip
# Half the width of the central differences. Whole solves are exact to about 1e-6 mm, so that a change of
# 4e-3 mm leaves 5e-4 of noise; the second-order error of these steps is below 1e-4 of the derivative.
STEPS = {
    "C10": 5e-4, "C01": 5e-4, "creep.g1": 1e-3, "creep.tau1": 2e-2, "stiffening.C20": 1e-3,
    "clamp.compliance": 2e-5, "pressure_gain.gain": 1e-3, "pressure_lag.tau": 2e-3, "pressure_offset.offset": 2e-5,
    "gravity.density": 2e-11, "camera_scale.scale":
    1e-3,
}  # fmt: skip


@pytest.fixture(scope="module")
def base(coarsest_case: Case, make_targets: Callable[..., Targets]) -> KeptModel:
    case = replace(coarsest_case, forces={"tip_face": np.array([0.0, 0.0, 0.1])})
    return base_model(make_targets(gravity=np.array([[0.6, 0.0, -0.8]])), case)


def whole(model: KeptModel, values: dict[str, float], start: Array) -> Array:
    """The prediction by a solve without derivatives."""
    test = model.put(values)
    u, _, _ = respond(test, (), start=model.solution(start) if len(start) == len(model.parameters) else None)
    return model.seen(u, test, values)


def differences(model: KeptModel, values: dict[str, float], name: str, *, step: float) -> Array:
    start = model.theta(values)
    plus, minus = ({**values, name: values[name] + sign * step} for sign in (1, -1))
    return (whole(model, plus, start) - whole(model, minus, start)) / (2 * step)


@pytest.mark.slow
def test_all_derivatives_are_those_of_whole_predictions(base: KeptModel) -> None:
    model = base  # with an outer force: the history begins from a loaded state
    for e in all_effects():  # those of shape and material have tests of their own
        model = model.with_effect(e) if {p.name for p in e.parameters} <= set(THETA) else model
    theta = model.theta(THETA)
    rows = model.jacobian(theta)
    for p, row in zip(model.parameters, rows, strict=True):
        wanted = differences(model, model.named(theta), p.name, step=STEPS[p.name])
        size = np.abs(wanted).max()
        assert size * STEPS[p.name] > 1e-5, p.name  # mm: the difference is more than the solver's noise
        # two thousandths of the largest: history is interpolated in time, by curves that bend with their values
        np.testing.assert_allclose(row, wanted, rtol=0, atol=2e-3 * size, err_msg=p.name)


@pytest.mark.parametrize(
    ("name", "step"),
    [
        ("creep.g1", 1e-3),
        ("pressure_lag.tau", 1e-3),
        ("stiffening.C20", 1e-3),
        ("clamp.compliance", 1e-6),
        ("pressure_offset.offset", 1e-5),
        ("gravity.density", 2e-11),
    ],
)
def test_derivatives_at_null_are_those_of_whole_predictions(base: KeptModel, name: str, step: float) -> None:
    model = base.with_effect(effect(name.partition(".")[0]))
    values = {k: v for k, v in {**THETA, name: 0.0}.items() if k in {p.name for p in model.parameters}}
    row = model.jacobian(model.theta(values))[[p.name for p in model.parameters].index(name)]
    wanted = differences(model, values, name, step=step)
    np.testing.assert_allclose(row, wanted, rtol=0, atol=2e-3 * np.abs(wanted).max())


def test_signatures_are_secants_of_whole_predictions(base: KeptModel) -> None:
    case = replace(base.test.case, forces={})
    base = replace(base, test=replace(base.test, case=case))
    theta = base.theta({k: THETA[k] for k in ("C10", "C01")})
    base.predict(theta)
    chosen = [effect("camera_scale"), effect("stiffening"), effect("creep")]
    found = base.tangents(theta, chosen)
    signatures = [[changes[0] for changes in found[e.label]] for e in chosen]
    assert [len(rows) for rows in signatures] == [1, 1, len(effect("creep").grid)]
    for e, rows in zip(chosen, signatures, strict=True):
        p, entry = e.parameters[0], (e.grid or ({},))[0]
        model = base.with_effect(e)
        ends = [whole(model, {**base.named(theta), **entry, p.name: value}, theta) for value in (0.0, p.step)]
        secant = (ends[1] - ends[0]) / p.step
        # the secant is made of the derivatives at the base, so it is good to the step's square: 2 %
        np.testing.assert_allclose(rows[0], secant, rtol=0, atol=0.02 * np.abs(secant).max(), err_msg=e.name)


class Closing(Effect):
    """The walls close before a typical step, or at any."""

    name, sentence = "closing", "the walls close"
    parameters = (Parameter("closing.mm", -1.0, 1.0, "mm", null=0.0, typical=0.1),)

    def __init__(self, room: float) -> None:
        self.room = room

    def before(self, test: Test, theta: Theta) -> Test:
        if theta["closing.mm"] > self.room:
            raise Unsolvable("the walls are closed")
        return replace(test, case=test.case.with_material(C20=theta["closing.mm"]))


def test_tangents_have_a_row_for_each_amplitude_at_each_entry_of_the_tries(base: KeptModel) -> None:
    theta = base.theta({k: THETA[k] for k in ("C10", "C01")})
    chosen = [effect("camera_scale"), effect("stiffening:2"), effect("creep")]
    found = base.tangents(theta, chosen)
    assert [len(found[e.label]) for e in chosen] == [1, 1, len(effect("creep").grid)]
    assert [len(found[e.label][0]) for e in chosen] == [1, 2, 1]
    h = 1e-3
    for k, name in enumerate(("stiffening.C20", "stiffening.C30")):
        model = base.with_effect(effect("stiffening:2"))
        values = {**base.named(theta), "stiffening.C20": 0.0, "stiffening.C30": 0.0}
        wanted = differences(model, values, name, step=h)
        # a secant over a typical step, from derivatives at null: good to the step's square
        np.testing.assert_allclose(found["stiffening:2"][0][k], wanted, rtol=0, atol=0.02 * np.abs(wanted).max())
    seen = base.test.points + np.where(base.test.moving[:, None], base.predict(theta), 0.0)
    seen = seen - seen[base.reference].mean(axis=0)  # mm per unit of scale: the positions, but for the reference
    # of displacements at the levels of a secant, which are fewer
    np.testing.assert_allclose(found["camera_scale"][0][0], seen, rtol=0, atol=1e-4 * np.abs(seen).max())
    # what only the picture shows is asked of no solve
    assert len(found.notes) == 0


def test_tangents_without_room_for_a_step_are_nothing_and_say_why(base: KeptModel) -> None:
    theta = base.theta({k: THETA[k] for k in ("C10", "C01")})
    (wanted,) = base.tangents(theta, [Closing(1.0)])["closing"]
    for room, share in ((0.02, 1.0), (0.0, 0.0)):
        found = replace(base).tangents(theta, [Closing(room)])  # one that knows no other of that label
        assert found.notes == {"closing": "the walls are closed"}
        size = np.abs(wanted).max()
        np.testing.assert_allclose(found["closing"][0], share * wanted, rtol=0, atol=1e-6 * size)


def test_pressure_slope_and_reference(base: KeptModel) -> None:
    theta = base.theta({k: THETA[k] for k in ("C10", "C01")})
    u = base.predict(theta)
    np.testing.assert_allclose(u[base.reference].mean(axis=0), 0.0, atol=1e-15)
    h = 1e-5  # MPa
    paths = [replace(base.test.path, pressure=base.test.path.pressure + s * h) for s in (1, -1)]
    ends = [respond(replace(base.put(base.named(theta)), path=path), (), start=None)[0] for path in paths]
    wanted = (ends[0] - ends[1])[2:] / (2 * h)  # a pressure below 0 at the start is outside the curve
    # the curve over pressure is a cubic of its own in either solve: 1e-3 of the slope
    np.testing.assert_allclose(base.per_pressure(theta)[2:], wanted, rtol=0, atol=2e-3 * np.abs(wanted).max())


def test_a_model_that_cannot_carry_the_load_says_how_far_it_came(base: KeptModel) -> None:
    with pytest.raises(Unsolvable, match=saying(r"0\.\d+", "MPa", r"0\.02")):
        base.predict(base.theta({"C10": 0.03, "C01": 0.0}))
