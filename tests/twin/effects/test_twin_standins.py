"""Stand-ins: how many there are, what they say, and that they are effects as any other."""

from dataclasses import replace

import numpy as np
import pytest

from tests.few import few
from twin.contract.promises import check_effect
from twin.contract.specimen import small_test, whole
from twin.effects.labels import KINDS
from twin.effects.library import all_effects
from twin.effects.markerslip import MarkerSlip
from twin.effects.material import Creep, Elasticity
from twin.effects.phrases import direction
from twin.effects.protocol import Test
from twin.effects.standin import Span, StandIn
from twin.effects.standinforces import Friction, OutsideForce, SoftSpot, Twist
from twin.effects.standinmotions import ClampPlay
from twin.effects.standinpressure import PressureWay, stop
from twin.effects.standins import stand_ins
from twin.model.keptmodel import KeptModel
from twin.model.prediction import Model, respond

ALL = stand_ins(small_test())
TRIED = [s for s in ALL if s.name in ("force_at_60", "soft_at_50", "friction_at_60", "fold_at_50", "twist")]


def test_stand_ins_are_of_all_kinds_with_names_of_their_own_and_not_too_many() -> None:
    assert {s.kind for s in ALL} == set(KINDS)
    assert len({s.name for s in ALL}) == len(ALL)
    assert not {s.name for s in ALL} & {e.name for e in all_effects()}
    for markers, low, high in ((5, 90, 105), (40, 100, 125)):
        found = stand_ins(with_markers(markers))
        assert low <= sum(len(s.amplitudes) for s in found) <= high
        assert all(s.parameters == s.amplitudes and p.plausible for s in found for p in s.parameters)


def with_markers(count: int) -> Test:
    test = small_test()
    points = np.tile(test.points[0], (count, 1))
    return replace(test, points=points, moving=np.ones(count, bool))


def test_a_force_across_the_finger_is_always_tried_and_alone_needs_all_of_it() -> None:
    aside = [s for s in ALL if any(p.name.endswith(".aside") for p in s.parameters)]
    assert [s.name for s in aside] == ["force_aside_at_60", "force_aside_at_100"]
    assert all(len(s.parameters) == 1 for s in aside)
    assert [s.name for s in ALL if s.breaks_symmetry(small_test())] == [*(s.name for s in aside), "twist", "growing_twist"]


def said(name: str, **values: float) -> str:
    stand_in = next(s for s in ALL if s.name == name)
    return stand_in.resembles({f"{name}.{k}": v for k, v in values.items()})


def test_stand_ins_say_size_place_and_direction() -> None:
    assert said("force_at_100", up=0.18) == "0.18 N near the tip, pointing up"
    assert said("force_at_60", up=-0.1, along=-0.08) == (
        "0.13 N at 0.6 of the length from the clamp, pointing down and towards the clamp"
    )
    assert said("growing_force_at_100", along=2.0) == "0.02 N per 10 kPa near the tip, pointing towards the tip"
    assert said("soft_at_10", lower=0.2, upper=0.01) == "silicone 20 % softer in the lower half near the clamp"
    assert said("soft_at_50", lower=-0.1, upper=-0.1) == "silicone 10 % stiffer at 0.5 of the length from the clamp"
    assert said("pressure_by_pressure", c0=-0.05) == "a pressure 2 kPa lower than recorded at 0 kPa"
    assert said("pressure_by_time", c1=-0.02) == "a pressure falling by 4 % against the recorded one, from 0 s to 4 s"
    assert said("drift", up1=-0.1) == "the whole finger moving by 0.2 mm down until 4 s"
    assert said("drift", turn1=-0.01) == "the whole finger turning by 0.02 rad upwards until 4 s"
    assert said("drift", along1=0.1, turn1=0.01) == (
        "the whole finger moving by 0.2 mm towards the tip until 4 s and turning by 0.02 rad downwards until 4 s"
    )
    assert said("picture", xx=0.012, zz=0.002) == "a picture stretched along the finger by 1.2 %"
    assert said("slip_of_p1", up1=0.05) == "marker p1 slipping by 0.05 mm at 2.25 s"
    assert said("force_aside_at_100", aside=-0.3) == "0.3 N near the tip, pointing to -y"
    assert said("twist", moment=-2.0) == "a moment of 2 N mm that twists the tip, its side at +y down"
    assert said("friction_at_60", up=0.1) == (
        "a friction of 0.1 N at 0.6 of the length from the clamp, pointing up while the pressure rises, and back while it falls"
    )
    assert said("fading_friction_at_60", up=0.1).endswith("while the pressure rises, and back while it falls, fading at rest")
    assert said("late_force_at_100", up=0.1) == "0.1 N near the tip, pointing up, growing from 20 kPa to 40 kPa"
    assert said("fold_at_20", lower=0.3) == (
        "a fold: silicone 30 % softer in the lower half at 0.2 of the length from the clamp, growing from 20 kPa to 40 kPa"
    )
    assert said("pressure_by_way", c2=0.02) == "a pressure 1.6 kPa higher while it rises than while it falls, at 6 kPa"
    assert said("clamp_play", w5=-0.01) == "the whole finger turned about its clamp by 0.02 rad upwards while the pressure rises against while it falls"
    assert said("peel_of_p2", along=0.3, up=-0.4) == "marker p2 peeling by 0.5 mm down and towards the tip from 0 s to 4 s"
    assert direction(np.array([0.0, -1.0, 0.1])) == "to -y"


def test_soft_spots_everywhere_are_a_softer_finger() -> None:
    test, soft = small_test(), 0.2
    spots = test
    for s in ALL:
        if isinstance(s, SoftSpot):
            spots = s.before(spots, {p.name: soft for p in s.parameters})
    sets = [spots.case.element_sets[name] for name in spots.case.materials]
    np.testing.assert_array_equal(np.sort(np.concatenate(sets)), np.arange(len(test.case.connectivity)))
    (own,) = test.case.materials.values()
    softer = test.case.with_material(C10=0.8 * own.C10, C01=0.8 * own.C01)
    found, wanted = (respond(t, (), start=None)[0] for t in (spots, replace(test, case=softer)))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)


@pytest.mark.parametrize("stand_in", ALL, ids=lambda s: s.label)
def test_stand_ins_state_what_they_should(stand_in: StandIn) -> None:
    assert check_effect(stand_in, solves=False) == ()


@pytest.mark.parametrize("stand_in", few(ALL, TRIED), ids=lambda s: s.label)
def test_stand_ins_keep_the_promises_of_an_effect(stand_in: StandIn) -> None:
    assert check_effect(stand_in) == ()


def test_a_stop_follows_until_it_is_held_and_turns_back_at_once() -> None:
    there = np.array([0.0, 0.05, 0.1, 0.5, 1.0, 0.95, 0.8, 0.0, 0.1])
    np.testing.assert_allclose(stop(there, 0.1), [0.0, 0.5, 1.0, 1.0, 1.0, 0.5, -1.0, -1.0, 0.0], atol=1e-12)
    denser = np.interp(np.arange(0, 8.01, 0.25), np.arange(9), there)
    np.testing.assert_allclose(stop(denser, 0.1)[::4], stop(there, 0.1), atol=1e-12)


def test_friction_that_fades_is_gone_soon_after_the_finger_rests() -> None:
    time = np.linspace(0.0, 12.0, 1201)
    share = np.interp(time, [0.0, 4.0, 8.0, 12.0], [0.0, 1.0, 1.0, 0.0])
    stays, fades = (Friction(0.6, Span(0.0, 12.0, 0.04), fading=f).course(share, time) for f in (False, True))
    np.testing.assert_array_equal(stays[[400, 800, 1200]], [1.0, 1.0, -1.0])
    np.testing.assert_allclose(fades[[400, 500, 600, 1200]], [1.0, np.exp(-1), np.exp(-2), -1.0], atol=0.01)


def test_a_late_force_is_absent_below_half_of_the_top_pressure() -> None:
    test = small_test()
    (force,) = (s for s in ALL if s.name == "late_force_at_60")
    (there,) = force.before(test, {"late_force_at_60.along": 0.0, "late_force_at_60.up": 0.1}).perturbations
    wanted = np.clip(np.interp(test.path.output, test.path.time, test.path.pressure) / 0.04 - 0.5, 0.0, None) / 0.5
    np.testing.assert_allclose(there.course, wanted, atol=1e-12)
    assert wanted.max() > 0.9
    assert wanted.min() == 0.0


def test_a_mounting_that_yields_turns_the_finger_as_a_whole_with_time() -> None:
    test = small_test()
    (drift,) = (s for s in ALL if s.name == "drift")
    u = np.zeros((len(test.path.output), len(test.points), 3))
    moved = drift.after(u, test, dict.fromkeys([p.name for p in drift.parameters], 0.0) | {"drift.turn1": 0.1})
    at = test.points[test.moving] + moved[:, test.moving]
    between = np.linalg.norm(at[:, :, None] - at[:, None], axis=-1)
    np.testing.assert_allclose(between, between[:1].repeat(len(at), 0), atol=1e-12)  # as a rigid body
    angle = np.arctan2(*(at[:, 1] - at[:, 0])[:, [2, 0]].T)
    np.testing.assert_allclose(angle[0] - angle, 0.1 * (Span.of(test).across(test.path.output) + 1), atol=1e-12)
    assert not moved[:, ~test.moving].any()


def test_a_pressure_by_its_way_changes_the_path_alone() -> None:
    test = small_test()
    changed = PressureWay(Span.of(test)).before(test, {"pressure_by_way.c1": 0.1, "pressure_by_way.c3": -0.05})
    assert changed.case is test.case
    own = test.path.pressure + 0.04 * (0.1 * stop(test.path.pressure / 0.04, 0.05) - 0.05 * stop(test.path.pressure / 0.04, 0.4))
    np.testing.assert_allclose(changed.path.pressure, own, rtol=1e-14)


def test_play_turns_the_finger_as_a_whole_about_its_clamp() -> None:
    test = small_test()
    assert test.case.clamp is not None
    centre = np.array([test.case.clamp.centre[0], 0.0, test.case.clamp.centre[1]])
    u = np.zeros((len(test.path.output), len(test.points), 3))
    moved = ClampPlay(Span.of(test)).after(u, test, {"clamp_play.w5": 0.1, "clamp_play.w40": 0.0})
    at = test.points - centre
    np.testing.assert_allclose(np.linalg.norm((at + moved)[:, :2], axis=-1), np.linalg.norm(at[:2], axis=-1)[None].repeat(5, 0))
    assert moved[2, 0, 2] < -0.5  # under the held pressure it is turned down
    assert not moved[:, 2].any()  # that marker is fixed


def test_what_breaks_the_symmetry_of_half_a_finger_has_its_columns_from_all_of_it() -> None:
    test = small_test()
    model, tried = Model(test, (Elasticity(),), np.array([0])), [s for s in ALL if s.breaks_symmetry(test)]
    theta = model.theta({"C10": 0.2, "C01": 0.1})
    found = model.tangents(theta, tried)
    assert all(np.abs(found[s.label][0][0]).max() > 1e-6 for s in tried)
    for s in tried[::3]:  # each takes two solves of the whole finger
        (column,) = found[s.label][0]
        h = 0.1 * s.parameters[0].step
        changed = Model(whole(test), (Elasticity(), s), np.array([0]))
        a, b = (changed.predict(np.array([0.2, 0.1, way * h])) for way in (1, -1))
        np.testing.assert_allclose(column, (a - b) / (2 * h), rtol=0, atol=1e-3 * np.abs(column).max() + 2e-7 / h)


@pytest.mark.parametrize("growing", [False, True])
def test_a_twist_is_a_moment_without_a_force(growing: bool) -> None:
    test, twist = whole(small_test()), Twist(growing=growing)
    case = twist.before(test, {f"{twist.name}.moment": 3.0}).case
    given = case.growing if growing else {k: v for k, v in case.forces.items() if k not in test.case.forces}
    total = np.array(list(given.values()))
    at = [case.nodes[case.node_sets[name]].mean(axis=0) for name in given]
    np.testing.assert_allclose(total.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(at, total).sum(axis=0), [3.0, 0.0, 0.0], atol=1e-9)


def test_friction_is_a_force_that_turns_round_with_the_pressure() -> None:
    test = small_test()
    rubs, force, size = Friction(1.0, Span.of(test)), OutsideForce(1.0, ("along",)), 1e-3
    bare, pulled_in = (respond(t, (), start=None)[0] for t in (test, force.before(test, {"force_at_100.along": size})))
    rubbed = respond(rubs.before(test, {"friction_at_100.along": size}), (), start=None)[0]
    course = np.array([0.0, 1.0, 1.0, 1.0, -1.0])[:, None, None]
    assert np.abs(rubbed - bare).max() > 1e-4
    np.testing.assert_allclose(rubbed - bare, course * (pulled_in - bare), rtol=0, atol=2e-3 * np.abs(pulled_in - bare).max())


@pytest.mark.parametrize("memory", [False, True])
def test_what_comes_and_goes_is_refitted_as_any_other_effect(memory: bool) -> None:
    test, rubs = small_test(), Friction(0.6, Span.of(small_test()))
    spot = MarkerSlip("p1", 2.0)
    effects = (Elasticity(), Creep(), rubs, spot) if memory else (Elasticity(), rubs)
    model = KeptModel(test, effects, np.array([0]))
    values = {"C10": 0.2, "C01": 0.1, "creep.g1": 0.05, "creep.tau1": 1.0, "friction_at_60.along": 0.02, "friction_at_60.up": -0.03}
    values |= {"marker_slip.along": 0.1, "marker_slip.across": 0.0}
    theta = np.array([values[p.name] for p in model.parameters])
    u, rows = model.predict(theta), model.jacobian(theta)
    k = [p.name for p in model.parameters].index("friction_at_60.up")
    ahead = theta + 0.01 * np.eye(len(theta))[k]
    np.testing.assert_allclose(model.predict(ahead) - u, 0.01 * rows[k], rtol=0, atol=1e-5)  # from a neighbour
    fresh = Model(test, effects, np.array([0]))
    np.testing.assert_allclose(model.predict(ahead), fresh.predict(ahead), rtol=0, atol=1e-6)
