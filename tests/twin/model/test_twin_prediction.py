"""Derivatives of the whole model against central differences of whole predictions."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Case
from twin.effects.library import all_effects, effect
from twin.model.building import base_model
from twin.model.memo import KeptModel
from twin.model.prediction import Unsolvable, respond
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
    signatures = base.signatures(theta, chosen)
    assert [len(rows) for rows in signatures] == [1, 1, len(effect("creep").grid)]
    for e, rows in zip(chosen, signatures, strict=True):
        p, entry = e.parameters[0], (e.grid or ({},))[0]
        model = base.with_effect(e)
        ends = [whole(model, {**base.named(theta), **entry, p.name: value}, theta) for value in (0.0, p.step)]
        secant = (ends[1] - ends[0]) / p.step
        # the secant is made of the derivatives at the base, so it is good to the step's square: 2 %
        np.testing.assert_allclose(rows[0], secant, rtol=0, atol=0.02 * np.abs(secant).max(), err_msg=e.name)


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
    with pytest.raises(Unsolvable, match=r"finite-element model stopped at 0\.\d+ MPa of 0\.02"):
        base.predict(base.theta({"C10": 0.03, "C01": 0.0}))
