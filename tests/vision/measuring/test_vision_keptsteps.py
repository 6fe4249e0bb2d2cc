"""Which frames become steps: a stated number, or what a room gives once the errors are counted."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vision.measuring.keptsteps import FEW, placed_steps
from vision.placing.views import steps_of

FILM: Any = SimpleNamespace(time=np.arange(1000) / 30, reference=np.arange(20))


class Placing:
    """Stands in for what places marks: frames that it was asked for, and an error for every tenth of them."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def __call__(self, frames: Any) -> Any:
        self.asked.append(len(frames))
        value = np.zeros((len(frames), 3, 3))
        value[..., 1] = np.nan
        value[0, 0] = np.nan  # lost once
        names = [f"codec:{k}" for k in range(len(frames) // 10)]
        return SimpleNamespace(value=value, modes=[{"scale": value}, dict.fromkeys(names, value)])


def test_a_stated_number_is_kept_and_placed_once() -> None:
    place = Placing()
    most, frames, _ = placed_steps(FILM, 300, place)
    assert (most, place.asked) == (300, [len(frames)])
    np.testing.assert_array_equal(frames, steps_of(FILM, 300))


@pytest.mark.parametrize("entries", [10**6, 30_000, 3000])
def test_what_is_kept_has_room_for_the_errors_that_it_shows(entries: int) -> None:
    told: list[tuple[int, int]] = []

    def room(names: Sequence[str], values: int, reference: int) -> int:
        told.append((values, reference))
        return min(entries // (len(names) * values) - reference, 1000)

    place = Placing()
    most, frames, placed = placed_steps(FILM, room, place)
    assert set(told) == {(6, 20)}
    assert place.asked[0] == len(steps_of(FILM, FEW))
    assert place.asked[-1] == len(frames) == len(placed.value)
    np.testing.assert_array_equal(frames, steps_of(FILM, most))
    assert (1 + len(frames) // 10) * 6 * len(frames) <= entries
    assert most > 20
