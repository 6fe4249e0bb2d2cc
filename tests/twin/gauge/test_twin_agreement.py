"""Film and log of one test: a motion that the pressure drives, and the ways in which it does not."""

from pathlib import Path

import numpy as np
import pytest

from twin.gauge.agreement import check_agrees
from twin.gauge.pressurelog import Log
from twin.gauge.synchrony import Motion

TIME = np.arange(0.0, 42.0, 0.1)
CORNERS = ((0, 2, 4, 10, 12, 22, 25, 34, 34.2, 38.2, 38.4, 42), (0, 0, 0.6, 0.6, 1, 1, 0, 0, 0.8, 0.8, 0, 0))


def log(shift: float = 35.0, peak: float = 0.03) -> Log:
    t = np.arange(0.0, 100.0, 0.02)
    noise = 3e-5 * np.random.default_rng(0).standard_normal(len(t))
    return Log(Path("pressure.csv"), t, peak * np.interp(t - shift, *CORNERS, left=0, right=0) + noise)


def motion(mm: float = 60.0, lag: float = 0.0, creep: float = 0.0) -> Motion:
    p = np.interp(TIME - lag, *CORNERS)
    late = np.zeros_like(p)
    for k in range(1, len(p)):
        late[k] = late[k - 1] + 0.1 / 5.0 * (p[k] - late[k - 1])
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(p))
    return Motion(TIME, mm * (p + 0.5 * p**2 + creep * late) / 1.5 + noise, 0.01)


@pytest.mark.parametrize("start", [33.0, 35.0, 37.0])
@pytest.mark.parametrize("what", [motion(), motion(creep=0.3), motion(lag=0.8), motion(mm=0.5)])
def test_a_film_of_the_test_passes_and_so_does_a_clock_two_seconds_off(start: float, what: Motion) -> None:
    check_agrees(what, log(), start, stated=True)


@pytest.mark.parametrize("start", [10.0, 30.0, 40.0])
def test_another_clock_is_told_with_the_right_start(start: float) -> None:
    with pytest.raises(ValueError, match=r"moves as pressure.csv does .* at 3[45]\.\d s its pressure explains (100|99) %.*correct film_start_s"):
        check_agrees(motion(), log(), start, stated=True)


def test_a_finger_at_rest_under_pressure_and_a_motion_without_pressure() -> None:
    with pytest.raises(ValueError, match=r"the finger does not move: 0\.0\d+ mm in the film, while pressure.csv rises by 0\.03"):
        check_agrees(motion(mm=0.0), log(), 35.0, stated=True)
    with pytest.raises(ValueError, match=r"explains \d % of the motion, wanted 30 % or more"):
        check_agrees(motion(), log(peak=0.0), 35.0, stated=True)
    check_agrees(motion(mm=0.0), log(peak=0.0), 35.0, stated=True)  # a film of a rest


def test_a_way_that_finds_the_start_itself_is_not_told_to_correct_it() -> None:
    with pytest.raises(ValueError, match=r"wanted 30 % or more"):
        check_agrees(motion(), log(), 80.0 - 42.0 + 17.0, stated=False)
    check_agrees(motion(), log(), 35.0, stated=False)


def test_marks_that_are_not_seen_say_nothing() -> None:
    lost = Motion(TIME, np.full(len(TIME), np.nan), 0.01)
    check_agrees(lost, log(), 10.0, stated=True)
