"""Effects of loads and supports: their own rules. What every effect promises stands in test_twin_contract."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import fe.path
from fe import Case
from fe.mesh.mirror import mirrored
from twin.contract.specimen import small_test
from twin.effects.library import all_effects, effect
from twin.effects.loads import first_order_lag
from twin.effects.material import Creep
from twin.effects.protocol import Effect
from twin.effects.requirements import lacking
from twin.effects.supports import TableContact
from twin.model.keptmodel import base_model
from twin.model.prediction import Model, respond
from twin.targets import Array, Targets

BASE = {"C10": 0.214, "C01": 0.083}
FELT = {
    "stiffening": {"stiffening.C20": 0.1},
    "clamp": {"clamp.compliance": 1e-3},
    "pressure_gain": {"pressure_gain.gain": 0.05},
    "contact": {"contact.stiffness": 0.5, "contact.distance": 0.2},
    "contact:2": {"contact.stiffness": 0.5, "contact.distance": 0.2, "contact.friction": 0.4},
    "pressure_lag": {"pressure_lag.tau": 0.4},
    "inertia": {"inertia.share": 1.0, "inertia.hz": 3.0, "inertia.damping": 0.1},
    "camera_scale": {"camera_scale.scale": 0.02},
}


def effects() -> list[Effect]:
    return [law for e in all_effects() for law in e.laws()]


@pytest.fixture(scope="module")
def small_case() -> Case:
    """A finger of one bellow: its tip goes down by 0.5 mm."""
    return replace(small_test().case, forces={})


@pytest.fixture(scope="module")
def base(small_case: Case, make_targets: Callable[..., Targets]) -> Model:
    """The base model with a dead force on the tip, without which the clamp carries no moment."""
    case = replace(small_case, forces={"tip_face": np.array([0.0, 0.0, 0.1])})
    return base_model(make_targets(gravity=np.array([[0.6, 0.0, -0.8]])), case)


def predicted(model: Model, values: dict[str, float]) -> Array:
    """The prediction by a solve from rest: one from a neighbour's solution differs by 1e-7 mm."""
    model = Model(model.test, model.effects, model.reference)
    return model.predict(model.theta({**BASE, **values}))


def test_without_an_outer_force_the_clamp_carries_no_moment(
    small_case: Case, make_targets: Callable[..., Targets]
) -> None:
    bare = base_model(make_targets(), small_case)
    soft = predicted(bare.with_effect(effect("clamp")), {"clamp.compliance": 1e-2})
    # mm: the moment of a closed chamber's pressure is 0 but for Newton's last correction
    np.testing.assert_allclose(soft, bare.predict(bare.theta(BASE)), rtol=0, atol=1e-6)


def test_the_order_of_adding_does_not_matter(base: Model) -> None:
    chosen = [effect(n) for n in ("camera_scale", "pressure_lag", "pressure_gain", "stiffening")]
    values = {k: v for e in chosen for k, v in FELT[e.label].items()}
    forth, back = base, base
    for e in chosen:
        forth = forth.with_effect(e)
    for e in reversed(chosen):
        back = back.with_effect(e)
    assert [e.order for e in forth.effects] == sorted(e.order for e in forth.effects)
    np.testing.assert_array_equal(predicted(forth, values), predicted(back, values))


def test_a_wider_law_takes_the_place_of_the_narrow_one(base: Model) -> None:
    model = base.with_effect(Creep()).with_effect(Creep(2))
    assert [e.label for e in model.effects] == ["elasticity", "creep:2"]
    start = Creep(2).start({**BASE, "creep.g1": 0.05, "creep.tau1": 190.0})
    assert set(start) == {p.name for p in model.parameters}
    assert all(p.low <= start[p.name] <= p.high for p in Creep(2).parameters)
    for e in all_effects():
        wider = e.wider()
        if wider is not None:
            assert wider.label in (f"{e.name}:2", f"{e.name}:one")  # of one marker, in place of all
            assert wider.wider() is None or wider.name == "camera_breathing"  # about a place that is free
            narrow = {p.name: 0.5 * (p.low + p.high) for p in e.parameters}
            tried = {"marker_standoff.marker"}  # at every marker
            assert set(wider.start(narrow)) == {p.name for p in wider.parameters} - tried


def test_labels_name_effects_and_an_unknown_one_lists_them() -> None:
    assert [effect(e.label).label for e in effects()] == [e.label for e in effects()]
    assert [p.name for p in effect("creep:2").parameters][-1] == "creep.tau2"
    with pytest.raises(
        ValueError, match="'gravitation' is not in the library, wanted one of creep, pressure_lag"
    ):
        effect("gravitation")
    with pytest.raises(ValueError, match="no such law of creep, wanted one of creep, creep:2"):
        effect("creep:3")


def ramp_response(time: Array, *, tau: float) -> Array:
    """Closed form of tau dy/dt + y = p for p = max(t - 1, 0), settled before: (t - 1) - tau (1 - exp(-(t -
    1)/tau))."""
    since = np.maximum(time - 1.0, 0.0)
    return since - tau * -np.expm1(-np.minimum(since / tau, 700.0))


@pytest.mark.parametrize("tau", [0.05, 0.7, 20.0])
def test_the_lag_of_a_ramp_is_the_closed_form(tau: float) -> None:
    rng = np.random.default_rng(1)
    time = np.sort(np.append(rng.uniform(0.0, 6.0, 40), [0.0, 1.0, 6.0]))  # uneven, with the corner
    # the recursion is exact for a polygon: only rounding is left
    lagged = first_order_lag(time, np.maximum(time - 1.0, 0.0), tau)
    np.testing.assert_allclose(lagged, ramp_response(time, tau=tau), rtol=0, atol=1e-12)


def test_the_lag_goes_smoothly_through_zero() -> None:
    time = np.linspace(0.0, 5.0, 251)
    pressure = 0.03 * np.sin(time) ** 2
    np.testing.assert_array_equal(first_order_lag(time, pressure, 0.0), pressure)
    h = 1e-7
    ahead, behind = (first_order_lag(time, pressure, tau) - pressure for tau in (h, -h))
    # d/dtau at 0 is minus the slope from either side; 1e-6 of the largest change (3e-9 MPa): rounding
    np.testing.assert_allclose(ahead, -behind, rtol=0, atol=1e-6 * np.abs(ahead).max())
    np.testing.assert_allclose(ahead[1:], -h * np.diff(pressure) / np.diff(time), rtol=0, atol=1e-15)


def test_gravity_turns_with_the_blocks_and_asks_for_the_whole_finger_where_it_pulls_across(
    small_case: Case, make_targets: Callable[..., Targets]
) -> None:
    block = np.array([0, 0, 0, 0, 1, 1, 1, 1])  # the second begins at 3.5 s, the first ends at 2 s
    down, across = np.array([[0.6, 0.0, -0.8]] * 2), np.array([[0.6, 0.0, -0.8], [0.0, 1.0, 0.0]])
    models = [base_model(make_targets(gravity=g, block=block), small_case) for g in (down, across)]
    heavy = [m.with_effect(effect("gravity")) for m in models]
    assert [len(m.put({**BASE, "gravity.density": 1e-9}).case.nodes) for m in heavy] == [
        len(small_case.nodes), 2 * len(small_case.nodes) - len(small_case.node_sets["symmetry"])
    ]  # fmt: skip
    assert heavy[0].extent == models[1].extent == "Half model: load and shape are symmetric."
    assert heavy[1].extent == "Whole model: gravity breaks the symmetry."
    bare = models[1].predict(models[1].theta(BASE))
    null, felt = (predicted(heavy[1], {"gravity.density": x}) for x in (0.0, 1.1e-9))
    np.testing.assert_allclose(null, bare, rtol=0, atol=1e-6)  # mm: another mesh, so not to the last bit
    change = (felt - null)[:, 0]
    # relative to a reference in the first block: the second shows its gravity less that of the first
    assert np.abs(change[block == 0]).max() < 0.01
    assert (change[block == 1, 1] > 0.01).all()


def test_signatures_of_effects_that_break_the_symmetry_are_those_of_the_whole_finger(
    small_case: Case, make_targets: Callable[..., Targets]
) -> None:
    block = np.array([0, 0, 0, 0, 1, 1, 1, 1])
    gravity = np.array([[0.6, 0.0, -0.8], [0.0, 1.0, 0.0]])
    model = base_model(make_targets(gravity=gravity, block=block), small_case)
    theta = model.theta(BASE)
    both = model.tangents(theta, [effect("pressure_gain"), effect("gravity")])
    (weight,) = both["gravity"]
    alone = model.tangents(theta, [effect("pressure_gain")])
    np.testing.assert_array_equal(both["pressure_gain"], alone["pressure_gain"])
    felt = predicted(model.with_effect(effect("gravity")), {"gravity.density": 1e-10}) - model.predict(theta)
    # linear to the density's square: a tenth of 5 % of the whole sag
    np.testing.assert_allclose(weight[0] * 1e-10, felt, rtol=0, atol=0.02 * np.abs(felt).max())


def test_an_effect_is_not_testable_without_what_it_requires(make_targets: Callable[..., Targets]) -> None:
    t = make_targets()
    assert lacking(effect("gravity").requires, t) == "not testable: needs the direction of gravity (twin.toml [model], or targets.toml by block)"
    assert lacking(effect("gravity").requires, make_targets(gravity=np.array([[0.0, 0.0, -1.0]]))) == ""
    assert lacking(effect("creep").requires, t) == ""
    bare = make_targets(log_time=t.time, log_pressure=t.pressure)
    assert lacking(effect("creep").requires, bare) == "not testable: needs the pressure between the steps (targets/pressure.csv)"


def test_the_clamps_compliance_is_to_the_moment_of_the_whole_finger(base: Model) -> None:
    whole = replace(base.test, case=mirrored(base.test.case))
    models = [Model(t, base.effects, base.reference) for t in (base.test, whole)]
    felt = [predicted(m.with_effect(effect("clamp")), FELT["clamp"]) for m in models]
    np.testing.assert_allclose(felt[0], felt[1], rtol=0, atol=1e-6)


def test_the_signature_of_a_touch_is_the_difference_of_whole_solves(
    small_case: Case, make_targets: Callable[..., Targets]
) -> None:
    model, table = base_model(make_targets(), small_case), TableContact()
    table.grid = ({"contact.distance": 0.1}, {"contact.distance": 50.0})
    theta = model.theta(BASE)
    near, far = (changes[0] for changes in model.tangents(theta, [table])[table.label])
    step = table.parameters[0].step
    touched = predicted(model.with_effect(table), {"contact.stiffness": step, "contact.distance": 0.1})
    np.testing.assert_allclose(step * near, touched - model.predict(theta), rtol=0, atol=1e-6)
    assert np.abs(step * near).max() > 0.1
    np.testing.assert_allclose(far, 0.0, rtol=0, atol=1e-5)


def test_a_table_needs_to_know_what_may_touch_it(base: Model) -> None:
    case = replace(base.test.case, surfaces={"chamber": base.test.case.surfaces["chamber"]})
    with pytest.raises(ValueError, match=r"contact: no surface 'outside' in the model.*there are chamber"):
        effect("contact").before(replace(base.test, case=case), FELT["contact"])


def test_friction_on_the_table_is_followed_up_and_down(
    small_case: Case, make_targets: Callable[..., Targets], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fe.path, "SOFT_RAMP", 4)
    base = base_model(make_targets(), small_case)
    rubbing, felt = base.with_effect(effect("contact:2")), {**BASE, **FELT["contact:2"]}
    plain = predicted(base.with_effect(effect("contact")), FELT["contact"])
    np.testing.assert_array_equal(predicted(rubbing, {**felt, "contact.friction": 0.0}), plain)
    theta, k = rubbing.theta(felt), [p.name for p in rubbing.parameters].index("contact.friction")
    row, solution = rubbing.jacobian(theta)[k], rubbing.solution(theta)
    assert solution.history is not None  # the pressure is held, and falls to a fifth
    held = np.abs(rubbing.predict(theta) - plain).max(axis=(1, 2))
    assert held[3] > 0.01  # mm at the top, where the tip is down by 0.5 mm
    np.testing.assert_allclose(held[4:6], held[3], atol=1e-6)  # nothing creeps
    assert held[7] < 0.01 * held[3]  # it has left the table again
    around = [rubbing.put({**felt, "contact.friction": 0.4 + h}) for h in (1e-2, -1e-2)]
    plus, minus = (respond(test, (), start=None)[0] for test in around)
    wanted = (plus - minus) / 2e-2
    wanted -= wanted[rubbing.reference].mean(axis=0)
    # from 2 s on they are solved times, whose derivatives are exact; a difference of 0.02 leaves 1e-4
    np.testing.assert_allclose(row[3:], wanted[3:], rtol=0, atol=1e-3 * np.abs(wanted).max())
