"""Film and log on one clock or not, from drawn displacements: what a finger and a pressure line do passes, what
clocks and lost frames do is refused with place and size."""

from pathlib import Path

import numpy as np
import pytest

from tests.few import few
from twin.effects.loads import first_order_lag
from twin.gauge.clockfit import _held, check_clock, corners
from twin.gauge.pressurelog import Log
from twin.gauge.synchrony import Join, Motion
from twin.targets import Array

START = 35.0
COURSES = {
    "protocol": ((0, 2, 4, 10, 12, 22, 25, 34, 34.2, 38.2, 38.4, 42), (0, 0, 0.6, 0.6, 1, 1, 0, 0, 0.8, 0.8, 0, 0)),
    "cycles": ((0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 22), (0, 0, 1, 0, 1, 0, 1, 0, 1, 0, 0)),
    "stairs": ((0, 2, 3, 6, 7, 10, 11, 14, 15, 18, 20, 24), (0, 0, 0.25, 0.25, 0.5, 0.5, 0.75, 0.75, 1, 1, 0, 0)),
    "slow": ((0, 3, 23, 28, 48, 52), (0, 0, 1, 1, 0, 0)),
    "one ramp": ((0, 2, 4, 8), (0, 0, 1, 1)),
    "waves": (np.arange(0, 30, 0.02), 0.5 - 0.5 * np.cos(2 * np.pi / 5 * np.clip(np.arange(-2, 28, 0.02), 0, None))),
}


def film_and_log(
    course: str = "protocol",
    *,
    hz: float = 10.0,
    lag: float = 0.0,
    friction: float = 0.0,
    creep: float = 0.0,
    mullins: float = 0.0,
    jump: float = 0.0,
    mm: float = 40.0,
    noise: float = 0.005,
) -> tuple[Motion, Log]:
    """A finger with so much of each under one course of pressure."""
    knots, rng = COURSES[course], np.random.default_rng(3)
    fine = np.arange(-5.0, knots[0][-1] + 5.0, 0.005)
    pressure = np.interp(fine, *knots)
    own = _held(first_order_lag(fine, pressure, lag), friction)
    moved = own + 0.5 * own**2 + jump / (1 + np.exp(-(own - 0.45) / 0.01))
    moved = moved * (1 + mullins * (np.maximum.accumulate(own) - own))
    moved = moved + creep * first_order_lag(fine, moved, 3.0)
    time, log_time = np.arange(0.0, knots[0][-1], 1 / hz), fine[::4]
    seen = mm / 1.5 * np.interp(time, fine, moved) + noise * rng.standard_normal(len(time))
    read = 0.03 * pressure[::4] + 3e-5 * rng.standard_normal(len(log_time))
    return Motion(time, seen, noise), Log(Path("pressure.csv"), log_time + START, read)


def told(motion: Motion, log: Log, *, start: float = START, sd: float = 0.002, by: str = "stamps") -> tuple[str, ...]:
    return check_clock(motion, log, Join(start, sd, ""), by=by)[0]


PHYSICS = {
    "nothing": {}, "30 frames/s": {"hz": 30.0}, "60 frames/s": {"hz": 60.0, "noise": 0.02}, "creep": {"creep": 0.3},
    "softening": {"mullins": 0.3}, "friction": {"friction": 0.05}, "lag": {"lag": 0.1}, "long lag": {"lag": 0.6, "hz": 30.0},
    "snap": {"jump": 0.3}, "little motion": {"mm": 0.5},
    "all": {"lag": 0.1, "creep": 0.2, "friction": 0.03, "mullins": 0.2, "noise": 0.02},
}  # fmt: skip


@pytest.mark.parametrize("course", few(COURSES, ("protocol", "one ramp")))
@pytest.mark.parametrize("name", PHYSICS)
def test_what_a_finger_and_a_pressure_line_do_is_never_refused(course: str, name: str) -> None:
    motion, log = film_and_log(course, **PHYSICS[name])
    for by in ("stamps", "onset", "flash"):
        said = told(motion, log, by=by)
        assert said == () or "lag" in name or "friction" in PHYSICS[name] or course in ("waves", "slow"), said


@pytest.mark.parametrize("lag", [0.3, 0.5])
def test_a_course_without_corners_refuses_nothing(lag: float) -> None:
    for hz in (10.0, 30.0):
        assert len(told(*film_and_log("waves", lag=lag, hz=hz))) < 2


@pytest.mark.parametrize("creep", [0.0, 0.5])
def test_delays_are_measured_with_their_sd(creep: float) -> None:
    motion, log = film_and_log(creep=creep)
    for shift in (-0.3, -0.02, 0.0, 0.2):
        found = corners(motion, log, START + shift)
        assert len(found) >= 8 - bool(creep)  # of the protocol: both ends of three long ramps, and two fast steps
        pulls = np.array([(c.late_s - shift) / np.hypot(c.sd_s, 0.02) for c in found])  # 0.02 s between samples
        assert np.abs(pulls).max() < 3
        assert max(c.sd_s for c in found) < 0.05


def lost(motion: Motion, low: float, high: float) -> Motion:
    """The film without the frames between two times, its stamps closed up."""
    kept = (motion.time < low) | (motion.time > high)
    return Motion(motion.time[: kept.sum()], motion.mm[kept], motion.noise_mm)


def until(motion: Motion, end: float) -> Motion:
    own = motion.time < end
    return Motion(motion.time[own], motion.mm[own], motion.noise_mm)


def stamped(motion: Motion, rate: float) -> Motion:
    """The film with its stamps multiplied."""
    return Motion(rate * motion.time, motion.mm, motion.noise_mm)


def made_constant(motion: Motion) -> Motion:
    """A varying frame rate, made constant by an editor."""
    real: Array = motion.time + 0.4 * np.sin(2 * np.pi * motion.time / 21)
    return Motion(motion.time, np.interp(real, motion.time, motion.mm), motion.noise_mm)


ONE_CLOCK = r"^film and pressure.csv do not run on one clock: the finger moves "


@pytest.mark.parametrize("physics", [{}, {"creep": 0.2, "lag": 0.05, "noise": 0.02, "hz": 30.0}])
def test_another_clock_is_refused_with_place_and_size(physics: dict[str, float]) -> None:
    motion, log = film_and_log(**physics)
    with pytest.raises(ValueError, match=ONE_CLOCK + r"0\.\d\d s before the pressure at .* correct film_start_s \((34\.9\d|35\.0\d) s"):
        told(motion, log, start=START - 0.25)
    with pytest.raises(ValueError, match=ONE_CLOCK + r".*0\.7\d s before it at 3[78].* the film's times run (1\.9|2\.\d) % slow"):
        told(stamped(motion, 0.98), log)
    with pytest.raises(ValueError, match=ONE_CLOCK + r".*the film's times run (1\.9|2\.\d) % fast"):
        told(stamped(motion, 1.02), log, by="onset")
    with pytest.raises(ValueError, match=ONE_CLOCK + r".* frames were lost between (3\.\d|4\.\d) and (9\.\d|10\.\d) s"):
        told(lost(motion, 5.0, 5.8), log)
    with pytest.raises(ValueError, match=ONE_CLOCK + r".* frames were lost between 1\.\d and 3\.\d s"):
        told(until(lost(motion, 2.6, 3.3), 8.0), log)
    with pytest.raises(ValueError, match=ONE_CLOCK + r".* its frame rate was changed or made constant"):
        told(made_constant(motion), log)
    with pytest.raises(ValueError, match=ONE_CLOCK):
        told(stamped(until(motion, 8.0), 25 / 30), log)
    with pytest.raises(ValueError, match=ONE_CLOCK + r"0\.\d\d s after the pressure"):
        told(stamped(until(motion, 8.0), 30 / 25), log)


def test_a_delay_that_a_pressure_line_may_have_is_told() -> None:
    motion, log = film_and_log()
    (said,) = told(motion, log, start=START + 0.15)
    assert said.startswith("The finger moves 0.15 s later than the pressure of pressure.csv")
    assert "(pressure_lag, time_shift)" in said
    assert told(motion, log, start=START + 0.15, by="onset") == ()


def test_what_is_stated_is_allowed() -> None:
    motion, log = film_and_log()
    for by in (0.15, -0.15):
        assert told(motion, log, start=START + by, sd=0.05) == ()


def test_marks_that_are_not_seen_tell_nothing() -> None:
    motion, log = film_and_log()
    assert check_clock(Motion(motion.time, np.full_like(motion.mm, np.nan), 0.01), log, Join(START, 0.0, ""), by="stamps") == (
        (), "No corner of pressure.csv tells how late the finger moves."
    )  # fmt: skip
