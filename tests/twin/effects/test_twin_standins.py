"""Stand-ins: how many there are, what they say, and that they are effects as any other."""

from dataclasses import replace

import numpy as np
import pytest

from tests.few import few
from twin.contract.promises import check_effect
from twin.contract.specimen import small_test, whole
from twin.effects.library import all_effects
from twin.effects.protocol import Test
from twin.effects.standins import SoftSpot, StandIn, direction, stand_ins
from twin.model.prediction import respond

KINDS = {"outside force", "soft spot", "pressure course", "drift", "camera", "slip"}
ALL = stand_ins(small_test())
TRIED = [s for s in ALL if s.name in ("force_at_60", "soft_at_50")]


def test_stand_ins_are_of_all_kinds_with_names_of_their_own_and_not_too_many() -> None:
    assert {s.kind for s in ALL} == KINDS
    assert len({s.name for s in ALL}) == len(ALL)
    assert not {s.name for s in ALL} & {e.name for e in all_effects()}
    for markers, low, high in ((5, 60, 80), (40, 70, 100)):
        found = stand_ins(with_markers(markers))
        assert low <= sum(len(s.amplitudes) for s in found) <= high
        assert all(s.parameters == s.amplitudes and p.plausible for s in found for p in s.parameters)


def with_markers(count: int) -> Test:
    test = small_test()
    points = np.tile(test.points[0], (count, 1))
    return replace(test, points=points, moving=np.ones(count, bool))


def test_a_force_across_the_finger_is_tried_where_all_of_it_is_modelled() -> None:
    names = [p.name for s in stand_ins(whole(small_test())) for p in s.parameters]
    assert "force_at_100.aside" in names
    assert not any(p.name.endswith(".aside") for s in ALL for p in s.parameters)


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
    assert said("picture", xx=0.012, zz=0.002) == "a picture stretched along the finger by 1.2 %"
    assert said("slip_of_p1", up1=0.05) == "marker p1 slipping by 0.05 mm at 2.25 s"
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
