"""Film and log of one test: a motion that the pressure drives, and the ways in which it does not."""

from pathlib import Path

import numpy as np
import pytest

from tests.messages import saying, says
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
    with pytest.raises(ValueError, match=saying("pressure.csv", r"3[45]\.\d", "(100|99) %", "film_start_s")):
        check_agrees(motion(), log(), start, stated=True)


def test_a_finger_at_rest_under_pressure_and_a_motion_without_pressure() -> None:
    with pytest.raises(ValueError, match=saying(r"0\.0\d+", "pressure.csv", r"0\.03")):
        check_agrees(motion(mm=0.0), log(), 35.0, stated=True)
    with pytest.raises(ValueError, match=r"explains \d % of the motion, wanted 30 % or more"):
        check_agrees(motion(), log(peak=0.0), 35.0, stated=True)
    check_agrees(motion(mm=0.0), log(peak=0.0), 35.0, stated=True)  # a film of a rest


def test_a_way_that_finds_the_start_itself_is_not_told_to_correct_it() -> None:
    with pytest.raises(ValueError, match=r"wanted 30 % or more"):
        check_agrees(motion(), log(), 80.0 - 42.0 + 17.0, stated=False)
    check_agrees(motion(), log(), 35.0, stated=False)


@pytest.mark.parametrize("rate", [0.25, 0.5, 0.9, 1.1, 2.0, 4.0])
@pytest.mark.parametrize("what", [motion(), motion(creep=0.3)])
def test_a_film_in_slow_motion_or_with_lost_frames_is_refused(rate: float, what: Motion) -> None:
    slowed = Motion(rate * what.time, what.mm, what.noise_mm)
    with pytest.raises(ValueError, match=r"the film seems to run (\d\.\d\d) times as long as the test") as told:
        check_agrees(slowed, log(), 35.0, stated=True)
    assert abs(float(str(told.value).split()[5]) / rate - 1) < 0.03


def test_a_film_of_one_ramp_at_another_rate_is_told() -> None:
    short = motion(creep=0.1)
    own = short.time < 6
    (told,) = check_agrees(Motion(2 * short.time[own], short.mm[own], 0.01), log(), 35.0, stated=False)
    assert told.startswith("The film seems to run 2.0")
    with pytest.raises(ValueError, match=saying(r"2\.0", "pressure.csv", "17")):
        check_agrees(Motion(2 * short.time[own], short.mm[own], 0.01), log(), 35.0, stated=True)
    assert check_agrees(Motion(short.time[own], short.mm[own], 0.01), log(), 35.0, stated=True) == ()


@pytest.mark.parametrize("late", [0.1, 0.5, 1.0])
def test_a_lag_or_creep_is_no_other_rate(late: float) -> None:
    p = np.interp(TIME, *CORNERS)
    lagged = np.zeros_like(p)
    for k in range(1, len(p)):
        lagged[k] = lagged[k - 1] + 0.1 / late * (p[k] - lagged[k - 1])
    for until in (6.0, 13.0, 42.0):
        own = until > TIME
        assert check_agrees(Motion(TIME[own], 60 * lagged[own], 0.01), log(), 35.0, stated=True) == ()


def test_a_clock_that_is_off_by_a_second_is_told() -> None:
    assert check_agrees(motion(creep=0.3), log(), 35.0, stated=True) == ()
    (told,) = check_agrees(motion(creep=0.3), log(), 36.0, stated=True)
    says(told, "pressure.csv", "1.0 s")
    assert "time_shift" in told
    assert check_agrees(motion(), log(), 36.0, stated=False) == ()


def test_a_film_whose_times_show_nothing_of_the_log_is_refused_from_two_and_a_half_seconds_on() -> None:
    short = motion()
    own = short.time < 5
    for start in (32.0, 38.0):
        with pytest.raises(ValueError, match=saying(r"35\.0 s", "film_start_s", r"2\.5 s")):
            check_agrees(Motion(short.time[own], short.mm[own], 0.01), log(), start, stated=True)


def test_marks_that_are_not_seen_say_nothing() -> None:
    lost = Motion(TIME, np.full(len(TIME), np.nan), 0.01)
    check_agrees(lost, log(), 10.0, stated=True)
