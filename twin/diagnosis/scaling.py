"""Correlation of a misfit with the test: with the present pressure, with the history, or with time.

Each way is a few courses in time, free for every marker and axis. What a course takes of the whitened
residual beyond its number of functions is misfit of that kind; ways overlap, so shares need not add up.
"""

import numpy as np

from calibrate import excess
from twin.judging.comparison import smooth_functions
from twin.judging.judged import Judged
from twin.judging.lawerrors import memory
from twin.targets import Array, Targets

LEAST = 0.5  # of the misfit that a way must take to be told


def ways(targets: Targets) -> dict[str, Array]:
    """Courses (k, s) by what they follow, in words."""
    x = targets.pressure / max(float(np.abs(targets.pressure).max()), 1e-12)
    t = (targets.time - targets.time[0]) / max(float(np.ptp(targets.time)), 1e-12)
    since = np.interp(targets.time, targets.log_time, memory(targets.log_time, targets.log_pressure))
    return {
        "the pressure itself": x[None],
        "the pressure, not in proportion": np.array([x, x**2, x**3]),
        "the pressure of before": (since / max(float(np.abs(since).max()), 1e-12))[None],
        "time, whatever the pressure": np.array([t, t**2]),
        "time and pressure together": np.array([t * x]),
    }


def scaling_of(judged: Judged, targets: Targets) -> dict[str, float]:
    """The share (0 to 1) of a misfit that follows each of `ways`, the largest first; {} without a misfit."""
    every = ways(targets)
    total = _taken(judged, targets, np.concatenate(list(every.values())))
    if total <= 0:
        return {}
    shares = {name: max(_taken(judged, targets, shapes), 0.0) / total for name, shapes in every.items()}
    return dict(sorted(shares.items(), key=lambda kv: -kv[1]))


def scaling_in_words(shares: dict[str, float]) -> str:
    """A sentence on the courses that the misfit follows; "" where none takes half.

    >>> scaling_in_words({"the pressure of before": 0.8, "the pressure itself": 0.1})
    'It goes with the pressure of before (80%).'
    """
    names = [f"{name} ({share:.0%})" for name, share in shares.items() if share >= LEAST][:2]
    return f"It goes with {' and with '.join(names)}." if names else ""


def _taken(judged: Judged, targets: Targets, shapes: Array) -> float:
    functions = smooth_functions(targets, judged.whitener, shapes)
    return excess(judged.z, functions, fitted=judged.fitted)
