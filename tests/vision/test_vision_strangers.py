"""Right inputs as strangers have them are accepted: the small version of `tests/strangers/right.py`."""

from pathlib import Path

import pytest

from tests.strangers import right

FAST = (right.eighth_of_the_picture, right.third_of_the_picture, right.apriltags, right.one_id_twice)


@pytest.mark.parametrize("put_in", FAST, ids=lambda f: f.__name__)
def test_marks_of_any_size_and_family(put_in, tmp_path: Path) -> None:
    outcome = put_in(tmp_path)
    assert outcome.accepted, outcome.said
    assert outcome.error < 0.02  # px


def test_a_refusal_is_counted_with_its_sentence() -> None:
    def refused(folder: Path) -> None:
        raise ValueError("the board is not there")

    outcome = right.tried(refused)
    assert outcome is not None
    assert not outcome.accepted
    assert outcome.said == "the board is not there"
    assert not right.located(
        "DICT_4X4_50", [3, 7], 8, limit=1e-6
    ).accepted  # an answer that is off is no pass


def test_there_are_enough_kinds() -> None:
    assert len(right.INPUTS) >= 15 + 3  # three need recordings


@pytest.mark.slow
def test_no_right_input_is_refused() -> None:
    told = right.figures(quick=True)
    assert told["refused_right"] == 0
    assert told["right_inputs"] >= 15
    assert told["dots_found"] >= 0.95
    assert all(0.7 < pull < 1.4 for pull in (told["photo_pulls"] or {}).values())
