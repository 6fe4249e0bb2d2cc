"""Whether lens and camera stay as they were: shifts, turns and scales of the frame marks' picture."""

import numpy as np
import pytest

from vision.placing.views import unsteady

REST = np.arange(10)
TIME = np.arange(40) / 10
PLACES = np.array([[100.0, 80], [900, 90], [120, 600], [880, 640]])


def film(shift: float = 0.0, degrees: float = 0.0, scale: float = 1.0, noise: float = 0.05) -> np.ndarray:
    """Places (40, 4, 2) px of four marks, moved from the twentieth frame on."""
    centre, turn = PLACES.mean(axis=0), np.radians(degrees)
    turning = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    out = np.tile(PLACES, (40, 1, 1)) + noise * np.random.default_rng(1).standard_normal((40, 4, 2))
    out[20:] = (out[20:] - centre) @ turning.T + centre + shift / np.sqrt(2)
    return out


def test_a_steady_picture_is_not_told() -> None:
    assert unsteady(film(shift=0.3, degrees=0.01, scale=1.0003), REST, TIME, film="a.mp4") == ()


@pytest.mark.parametrize(
    ("moved", "words"),
    [
        ({"shift": 1.0}, ("by up to 1 px at", "a stabiliser")),
        ({"degrees": 0.2}, ("turned by up to 0.2 degrees", "a stabiliser")),
        ({"scale": 0.99}, ("scaled by up to 1 %", "focus, zoom")),
    ],
)
def test_each_motion_of_the_picture_is_told_with_its_size(moved: dict[str, float], words: tuple[str, ...]) -> None:
    (sentence,) = unsteady(film(noise=0.01, **moved), REST, TIME, film="a.mp4")
    assert all(word in sentence for word in (*words, "a.mp4"))


def test_marks_that_are_not_seen_and_single_misreadings_say_nothing() -> None:
    places = film()
    places[25] += 3.0
    places[5:20, 1], places[30], places[33, 1:] = np.nan, np.nan, np.nan
    assert unsteady(places, REST, TIME, film="a.mp4") == ()
    assert unsteady(np.full_like(places[:, :1], np.nan), REST, TIME, film="a.mp4") == ()
