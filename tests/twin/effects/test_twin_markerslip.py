"""A tag that slips on the finger: what is seen of it, and how it is looked for and named."""

from dataclasses import replace

import numpy as np
import pytest

from tests.messages import saying
from twin.contract.specimen import small_test
from twin.effects.library import effect
from twin.effects.markerslip import MarkerSlip
from twin.effects.material import Elasticity
from twin.model.prediction import Model, respond

VALUES = {"C10": 0.2, "C01": 0.1}


def test_a_tag_that_slipped_is_seen_where_it_sits_now() -> None:
    small = small_test()
    place = np.array([[14.0, 11.5, 2.0], [20.0, 11.5, 30.0]])  # on the side face, and on the rig
    test = replace(small, points=place, moving=np.array([True, False]), names=("side", "rig"))
    model = Model(test, (Elasticity(), MarkerSlip("side", 1.2)), np.array([0]))
    along, across = 0.2, -0.15  # mm
    values = {**VALUES, "marker_slip.along": along, "marker_slip.across": across}
    seen = respond(model.put(values), (), start=None)[0]
    base = model.put({**values, "marker_slip.along": 0.0, "marker_slip.across": 0.0})
    moved = np.array([along, 0.0, across])
    there = replace(base, points=test.points + moved * test.moving[:, None], slips=())
    before, after = respond(base, (), start=None)[0], respond(there, (), start=None)[0] + moved
    later = test.path.output >= 1.2
    np.testing.assert_array_equal(seen[:, 1], 0.0)
    np.testing.assert_array_equal(seen[~later], before[~later])
    # the slip is carried by the slope at the marker: what the slope changes by over 0.2 mm is left
    np.testing.assert_allclose(seen[later, 0], after[later, 0], rtol=0, atol=0.02 * 0.2)
    assert np.abs(seen[later, 0] - before[later, 0] - moved).max() > 0.005  # it turns with the finger


def test_a_slip_is_looked_for_at_every_marker_of_the_finger_and_then_closer() -> None:
    test, slip = small_test(), effect("marker_slip")
    output = np.linspace(0.0, 4.0, 81)
    test = replace(test, path=replace(test.path, output=output), names=("p 1", "p@2", "rig"))
    tries = slip.tries(test)
    assert {e["marker_slip.marker"] for e in tries} == {0.0, 1.0}
    times = sorted({e["marker_slip.time"] for e in tries})
    assert len(times) == 20
    assert not np.isin(times, output).any()
    closer = slip.closer(tries[21], test)
    assert closer is not None
    near = [e["marker_slip.time"] for e in closer.tries(test)]
    assert {e["marker_slip.marker"] for e in closer.tries(test)} == {tries[21]["marker_slip.marker"]}
    assert min(near) < tries[21]["marker_slip.time"] < max(near)
    assert max(np.diff(near)) < 0.06
    held = slip.at(closer.tries(test)[0], test)
    again = effect(held.label)
    assert isinstance(held, MarkerSlip)
    assert isinstance(again, MarkerSlip)
    assert (again.marker, again.time) == (held.marker, held.time) == ("p@2", near[0])
    assert held.tries(test) == ({},)
    assert held.at({}, test) is held


def test_markers_on_pins_turn_with_the_structure_from_the_first_picture_on() -> None:
    small, h = small_test(), 0.2
    place = np.array([[14.0, 11.5, 2.0], [20.0, 11.5, 2.0], [20.0, 11.5, 30.0]])  # two on the side face, one on the rig
    test = replace(small, points=place, moving=np.array([True, True, False]), names=("side", "tip", "rig"))
    values = {**VALUES, "marker_standoff.mm": h}
    seen = {}
    for label in ("marker_standoff", "marker_standoff:tip"):
        model = Model(test, (Elasticity(), effect(label)), np.array([0]))
        seen[label] = respond(model.put(values), (), start=None)[0]
    base = respond(test, (), start=None)[0]
    up = replace(test, points=place + h * np.array([0.0, 0.0, 1.0]) * test.moving[:, None])
    above = respond(up, (), start=None)[0] + h * np.array([0.0, 0.0, 1.0])
    for label, rows in (("marker_standoff", [0, 1]), ("marker_standoff:tip", [1])):
        still = [k for k in range(3) if k not in rows]
        np.testing.assert_array_equal(seen[label][:, still], base[:, still])
        np.testing.assert_allclose(seen[label][:, rows], above[:, rows], rtol=0, atol=0.02 * h)
        assert np.abs(np.ptp(seen[label][:, rows] - base[:, rows], axis=0)).max() > 0.02 * h  # it turns


def test_one_marker_that_stands_off_is_looked_for_among_all_and_held_by_its_name() -> None:
    test, every = replace(small_test(), names=("p1", "tip", "rig")), effect("marker_standoff")
    assert every.tries(test) == ({},)
    assert every.at({}, test) is every
    (law,) = every.laws()[1:]
    assert every.wider().label == law.label == "marker_standoff:one"  # type: ignore[union-attr]
    assert law.wider() is None
    assert law.tries(test) == ({"marker_standoff.marker": 0.0}, {"marker_standoff.marker": 1.0})
    held = law.at(law.tries(test)[1], test)
    assert held.label == effect(held.label).label == "marker_standoff:tip"
    assert [p.name for p in held.parameters] == ["marker_standoff.mm"]
    with pytest.raises(ValueError, match=saying("'marker_standoff:p9'", "'p9'", "p1", "tip")):
        effect("marker_standoff:p9").before(test, {"marker_standoff.mm": 1.0})


def test_an_unknown_marker_or_a_slip_without_one_is_refused() -> None:
    with pytest.raises(ValueError, match=saying("'marker_slip:tip@3s'", "'tip'", "p1", "p2")):
        effect("marker_slip:tip@3s").before(small_test(), {"marker_slip.along": 0.1, "marker_slip.across": 0.0})
    with pytest.raises(ValueError, match="no such law of marker_slip"):
        effect("marker_slip:tip@3")
