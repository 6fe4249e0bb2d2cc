"""Profiles of several names: each as if it were asked for alone, whoever makes it and whichever ends first."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from calibrate import Fit, Parameter
from twin.calibrated import profiles
from twin.calibrated.profiles import ENDS, Profiler
from twin.executors.local import Serial, using

TWO = (Parameter("C10", 0.0, 1.0, "MPa", start=0.2), Parameter("C01", 0.0, 1.0, "MPa", start=0.1))
THETA = np.array([0.2, 0.1])


class Backwards:
    """As a cluster whose last task ends first."""

    workers = 2

    def ended(self, tasks: Sequence[Callable[[], Any]]) -> Iterator[tuple[int, Any]]:
        yield from ((k, tasks[k]()) for k in reversed(range(len(tasks))))


def found(around: Any, *, held: Any, theta: np.ndarray, step: Callable[[], None]) -> tuple[float, int]:
    """Stands for a profile: the value that is held, and how many solves its model has kept by then."""
    solves = around.__self__.model
    solves.append(1)
    for _ in range(ENDS):
        step()
    return round(held.value(theta), 6), len(solves)


@pytest.mark.parametrize(("executor", "order"), [(Serial(), 1), (Backwards(), -1)])
def test_a_profile_knows_nothing_of_the_others(
    executor: Any, order: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(profiles, "profile_likelihood", found)
    fit = Fit(TWO, THETA, 1e-6 * np.eye(2), 1.0, 9, 0, 1, True, "converged", ())
    profiler = Profiler(fit, [], None, None, THETA)  # type: ignore[arg-type]
    steps: list[None] = []
    with using(executor):
        made = list(profiler.profiles(["C10", "C01", "share"], lambda: steps.append(None)))
    assert made == [(0.2, 1), (0.1, 1), (pytest.approx(1 / 3, abs=1e-6), 1)][::order]
    assert len(steps) == 3 * ENDS
