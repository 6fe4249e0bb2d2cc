"""What is tied can be told apart at the bench: a test for every pair, and what is seen in it."""

from itertools import combinations

import pytest

from twin.effects.labels import KINDS
from twin.effects.library import all_effects
from twin.effects.protocol import Effect
from twin.experiments.benchchecks import CHECKS, Witness, in_words, witnesses

NAMES = [e.name for e in all_effects()]


@pytest.mark.parametrize("pair", list(combinations([*NAMES, *KINDS.values()], 2)), ids="/".join)
def test_every_pair_is_told_apart(pair: tuple[str, str]) -> None:
    (found,) = witnesses(pair)
    assert found.shows
    assert {label for label, _ in found.shows} <= set(pair)
    both = dict(found.shows)
    assert both.get(pair[0]) != both.get(pair[1])


def test_every_row_of_the_table_is_of_an_effect_or_a_kind() -> None:
    between_castings = {"constants", "modulus", "wall_thickness"}
    known = {*NAMES, *KINDS, "play", "twist", "fold", "friction"} | between_castings
    assert {name for _, shows in CHECKS for name in shows} <= known
    assert {*NAMES, *KINDS} - {name for _, shows in CHECKS for name in shows} == set()
    assert len({test for test, _ in CHECKS}) == len(CHECKS)


@pytest.mark.parametrize(
    ("labels", "wanted"),
    [
        (("camera_scale", "an error of the camera"), "a ruler"),
        (("creep:2", "an error of the camera"), "pictures of the board"),
        (("pressure_gain:wide", "clamp"), "second one or a water column"),
        (("gravity", "precurvature"), "weigh the finger"),
        (("tube", "eccentric_core"), "disconnect the supply line"),
        (("marker_slip:p3@10.1s", "ballooning"), "look at marker p3 in the film at 10.1 s"),
        (("clamp", "stiffening"), "two markers on the clamp"),
        (("creep", "a drift of the rig"), "unloaded finger"),
    ],
)
def test_the_test_is_that_of_the_tie(labels: tuple[str, ...], wanted: str) -> None:
    assert any(wanted in w.test for w in witnesses(labels))


def test_a_tie_of_many_is_split_with_few_tests() -> None:
    tied = ("pressure_gain", "pressure_offset", "clamp", "another course of the pressure")
    found = witnesses(tied)
    assert found[0].test.startswith("check the gauge against a second one")
    assert dict(found[0].shows)["pressure_gain"] == "they differ by the same factor"
    assert "clamp" not in dict(found[0].shows)
    assert len(found) == 1
    assert in_words(found).startswith("To tell them apart without the model, check the gauge")
    assert "pressure_offset, where they differ by the same amount;" in in_words(found)


def test_effects_together_show_what_any_of_them_shows() -> None:
    (found,) = witnesses(("creep + gravity", "creep"))
    assert found.test.startswith("weigh the finger")
    assert [label for label, _ in found.shows] == ["creep + gravity"]


def test_nothing_to_tell_apart_gives_no_test() -> None:
    assert witnesses(()) == witnesses(("creep",)) == witnesses(("creep", "creep:2")) == ()
    assert in_words(()) == ""
    assert Witness("weigh it", (("gravity", "it is heavy"),)).words == "weigh it (gravity, where it is heavy)"


def test_an_effect_of_the_users_own_shows_as_its_kind() -> None:
    class Cable(Effect):
        name, generic = "cable", "outside force"

    (found,) = witnesses(("cable", "strain_limiting_layer"), users=(Cable(),))
    assert found.test.startswith("disconnect the supply line")
    (unknown,) = witnesses(("cable", "strain_limiting_layer"))
    assert "cut the finger" in unknown.test
