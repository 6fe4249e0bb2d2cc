"""Rest that is none: a film that starts in motion, a static film that drifts, and noise that is neither."""

import numpy as np
import pytest

from tests.messages import saying
from vision.errors.restdrift import check_rest, unrest

NAMES = ("a", "b", "tip")
TIME = np.arange(18) / 10.0


def places(count: int, noise: float, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, noise, (count, 3, 2))


def said(place: np.ndarray, *, static: bool = False) -> tuple[str, ...]:
    time = np.arange(len(place)) / 10.0
    return check_rest(place, time, NAMES, film="film.mp4", static=static)


@pytest.mark.parametrize("noise", [0.001, 0.02])
def test_a_film_that_starts_in_motion_is_refused(noise: float) -> None:
    place = places(18, noise, 0)
    place[12:, 2, 1] -= 2.0 * (TIME[12:] - TIME[12])  # mm: it moves in the last third, by 1 mm
    with pytest.raises(ValueError, match=saying("film.mp4", "0.00", "1.70 s", "'tip'", r"0\.[6-9]")):
        said(place)


def test_a_jump_and_a_drift_of_a_static_film_are_refused() -> None:
    place = places(300, 0.01, 1)
    place[200:, 0, 0] += 0.4
    with pytest.raises(ValueError, match=r"which tells the noise.*'a' moves by 0\.4"):
        said(place, static=True)
    place = places(300, 0.01, 2)
    place[:, 1, 1] += np.linspace(0, 0.5, 300)
    with pytest.raises(ValueError, match=r"'b' moves by 0\.4"):
        said(place, static=True)


def test_a_small_drift_is_told_and_accepted() -> None:
    place = places(300, 0.005, 3)
    place[:, 1, 1] += np.linspace(0, 0.15, 300)
    (sentence,) = said(place, static=True)
    assert "marker 'b' drifts by 0.13 mm" in sentence  # five sixths: the means of the outer parts


@pytest.mark.parametrize("noise", [0.001, 0.02, 0.3])
def test_noise_is_rest(noise: float) -> None:
    for seed in range(40):
        assert said(places(18, noise, seed)) == ()
        assert said(places(120, noise, seed), static=True) == ()


def test_noise_that_lasts_is_rest() -> None:
    """Noise of lag-1 correlation 0.8, as lossy coding leaves it."""
    for seed in range(40):
        new, place = places(300, 0.01, seed), np.zeros((300, 3, 2))
        for k in range(1, 300):
            place[k] = 0.8 * place[k - 1] + 0.6 * new[k]
        assert unrest(place, NAMES) is None


def test_marks_that_are_not_seen_say_nothing() -> None:
    place = places(18, 0.01, 4)
    place[:, 2] = np.nan
    place[::2, 1] = np.nan
    assert said(place) == ()
    assert said(place[:3]) == ()


def test_a_corner_that_is_found_at_one_of_two_pixels_is_rest() -> None:
    """In a film of 4 px/mm the outline of a marker lies at one of two places by turns, in runs of a few frames."""
    for seed in range(20):
        place, rng = places(44, 0.002, seed), np.random.default_rng([seed, 1])
        place[:, 0] += 0.1 * (np.cumsum(rng.random(44) < 0.3) % 2)[:, None]
        assert said(place, static=True) == ()
        spike = places(11, 0.002, seed)
        spike[8, 1] += 0.08
        assert said(spike) == ()


def test_a_knock_in_a_time_of_rest_is_told() -> None:
    place = places(120, 0.005, 5)
    place[40:70, 1, 0] += 0.15  # it moves once, and back
    assert "marker 'b' drifts by 0.1" in said(place, static=True)[0]
    place = places(120, 0.005, 6)
    place[:, 1, 0] += 0.1 * np.sin(np.arange(120) / 8)  # a finger that swings is between its ends, too
    assert "marker 'b' drifts by 0.1" in said(place, static=True)[0]
