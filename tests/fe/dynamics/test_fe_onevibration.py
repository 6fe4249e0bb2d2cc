"""One vibration that a pressure drives, against closed forms and small steps."""

import numpy as np
import pytest

from fe.dynamics.onevibration import driven

OMEGA = 40.0


def step(end: float, count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    time = np.concatenate([[0.0, 1e-7], np.linspace(1e-6, end, count)])
    return time, np.where(time > 0, 1.0, 0.0)


@pytest.mark.parametrize("damping", [0.02, 0.1, 0.5])
def test_a_step_is_overshot_by_what_the_damping_leaves(damping: float) -> None:
    y = driven(*step(0.5), omega=OMEGA, damping=damping)
    assert y.max() - 1 == pytest.approx(np.exp(-np.pi * damping / np.sqrt(1 - damping**2)), abs=1e-3)


@pytest.mark.parametrize("damping", [1.0, 1.5, 30.0])
def test_from_a_ratio_of_one_on_nothing_overshoots(damping: float) -> None:
    y = driven(*step(20.0), omega=OMEGA, damping=damping)
    assert (np.diff(y) > -1e-9).all()
    assert y.max() < 1 + 1e-9
    if damping == 30.0:  # a first-order lag of 2 damping / omega
        tau, time = 60 / OMEGA, step(20.0)[0]
        np.testing.assert_allclose(y, 1 - np.exp(-time / tau), atol=1e-3)


def test_any_course_is_followed_as_by_small_steps_whatever_its_times() -> None:
    coarse = np.sort(np.random.default_rng(1).uniform(0.0, 2.0, 25))
    p = np.cumsum(np.random.default_rng(2).standard_normal(25))
    fine = np.union1d(coarse, np.linspace(coarse[0], coarse[-1], 40_000))
    seen = np.searchsorted(fine, coarse)
    load, y, v, out = np.interp(fine, coarse, p), p[0], 0.0, [p[0]]
    for dt, a, b in zip(np.diff(fine), load[:-1], load[1:], strict=True):
        v += dt * (OMEGA**2 * ((a + b) / 2 - y) - 0.2 * OMEGA * v)
        y += dt * v
        out.append(y)
    np.testing.assert_allclose(driven(coarse, p, omega=OMEGA, damping=0.1), np.array(out)[seen], atol=0.01)


def test_a_slow_ramp_is_followed_late() -> None:
    time = np.linspace(0.0, 10.0, 101)
    y = driven(time, time, omega=OMEGA, damping=0.3)
    assert time[-1] - y[-1] == pytest.approx(0.6 / OMEGA, rel=1e-6)
