"""A hidden truth and seeds -> what `twin diagnose` says to each draw of the noise; shared by the benchmarks.

The truth is solved once and kept under the system's temporary folder; all draws of one truth share one base
model, so that a draw costs the fits only.
"""

import tempfile
from pathlib import Path

import numpy as np

from fe.case import digest
from twin import virtual
from twin.targets import Array

# The finger's markers sit on nodes of the flat lower edge of the side face y = 11.5 mm, as far as the tip.
MIDDLE, TIP = 42, 110.0
STATIONS = (12, 22, 32, MIDDLE, 52, 64)  # in 1/72 of the bellows' 100 mm
NAMES = ("p1", "p2", "p3", "middle", "p5", "p6", "tip")


def marked_points() -> Array:
    """Undeformed places (7, 3) mm of the finger's markers, those of NAMES."""
    x = np.append(4.0 + np.array(STATIONS) * 100.0 / 72.0, TIP)
    return np.stack([x, np.full_like(x, 11.5), np.zeros_like(x)], axis=1)


def solved(truth: virtual.Truth, bench: virtual.Bench, points: Array) -> tuple[Array, Array]:
    """True displacements (s, p, 3) mm of points (p, 3) mm, and dU/dp (s, p, 3) mm per MPa."""
    course = virtual.path(bench)
    key = digest("truth", truth, course.time, course.pressure, course.output, points)
    kept = Path(tempfile.gettempdir()) / f"softtwin-truth-{key}.npz"
    if not kept.exists():
        print(f"solving the truth, a few minutes; kept as {kept}", flush=True)
        u, slope = virtual.displacements(truth, course, points)
        scratch = kept.with_suffix(".part.npz")
        np.savez(scratch, u=u, slope=slope)
        scratch.replace(kept)
    with np.load(kept) as data:
        return data["u"], data["slope"]
def report(*a,**k): raise NotImplementedError
