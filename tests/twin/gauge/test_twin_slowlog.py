"""What a log leaves open between its samples, and the steps that cannot be used for it."""

from collections.abc import Callable

import numpy as np
import pytest

from twin.inputs.filmtargets import said_of_log_rate
from twin.targets import Targets, between_samples

TIME = np.arange(0.0, 4.01, 0.1)


@pytest.mark.parametrize("corner", [1.02, 1.05, 1.09])
def test_sd_between_samples_is_the_error_at_a_corner(corner: float) -> None:
    course = lambda t: 8.0 * np.clip(t - corner, 0.0, None)  # noqa: E731
    at = np.array([0.55, 1.0, corner, 1.06, 1.1, 2.35])
    sd = between_samples(TIME, course(TIME), at)
    error = np.abs(np.interp(at, TIME, course(TIME)) - course(at))
    assert error[2] > 0.05
    np.testing.assert_allclose(sd, error, atol=1e-12)


def test_sd_between_samples_covers_a_smooth_course() -> None:
    at = np.linspace(0.3, 3.6, 500)
    sd, error = between_samples(TIME, np.sin(4 * TIME), at), np.interp(at, TIME, np.sin(4 * TIME)) - np.sin(4 * at)
    assert (np.abs(error) <= sd + 1e-12).mean() > 0.85  # but for the intervals of inflexions
    assert np.abs(error).max() < sd.max()


def test_corners_that_somebody_wrote_down_leave_nothing_open() -> None:
    time, course = np.array([0.0, 2.0, 12.0, 14.0, 20.0]), np.array([0.0, 20.0, 20.0, 0.0, 0.0])
    assert not between_samples(time, course, np.linspace(0.0, 20.0, 201)).any()


def test_steps_at_corners_of_a_slow_log_are_no_data(make_targets: Callable[..., Targets]) -> None:
    right = make_targets()
    assert right.logged is right
    assert said_of_log_rate(right) == ()
    log_time = np.arange(0.0, 9.01, 0.3)
    slow = make_targets(log_time=log_time, log_pressure=np.interp(log_time, right.log_time, right.log_pressure))
    lost = ~slow.logged.valid
    # 0.5, 2 and 7 s are corners between two samples, 6 s is one at a sample; the rest is straight.
    assert np.flatnonzero(lost.any(axis=(1, 2))).tolist() == [1, 3, 6]
    assert not lost[:, right.fixed].any()
    (sentence,) = said_of_log_rate(slow)
    assert "a sample every 0.3 s. At 3 of 8 frames" in sentence


def test_the_gauge_error_grows_where_the_log_bends(make_targets: Callable[..., Targets]) -> None:
    log_time = np.arange(0.0, 9.01, 0.3)
    slow = make_targets(
        log_time=log_time, pressure_sd=np.full(8, 1e-5),
        log_pressure=0.02 * np.interp(log_time, [0.0, 0.5, 2.0], [0.0, 0.0, 1.0]),
    )  # fmt: skip
    assert slow.pressure_error[1] > 1e-4
    assert slow.pressure_error[[0, 2, 5, 6, 7]] == pytest.approx(1e-5)
