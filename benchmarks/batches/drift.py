"""How often `twin batches` calls a batch different, on simulated series.

    python benchmarks/batches/drift.py [--quick] [--json]

`drift_false`: share of series of 8 batches without a change in which the newest is called different; 200
series for each ratio of the sd between batches to that of measurement, and the mean of all. `drift_found`:
share of those with a drift of 4 sds (of a batch: between batches and measurement together) that is found,
and in the right quantity alone. Seven former batches tell the sd so poorly that the exact t test, with
Holm's factor of 3, finds 67 % of such drifts where batches differ by nature; hence the rates for larger
drifts.
"""

import math
import os
import sys

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import whole

import numpy as np

from calibrate import Fit, Parameter
from twin.batches.values import SHARE, SUM, values_of
from twin.commands.batches import Batch, drifts
from twin.judging.fitrecord import FitRecord

BATCHES, SERIES = 8, 200
RATIOS = (0.0, 0.5, 1.0, 3.0)  # sd between batches over that of measurement, in turn
MEASURED = {SUM: 0.003, SHARE: 0.03, "creep.g1": 0.002}  # sd of one batch: MPa, 1, 1
TRUE = {SUM: 0.297, SHARE: 0.28, "creep.g1": 0.033}


def drift(quick: bool) -> dict[str, float]:
    """The rates over simulated series, by the sd between batches and by the size of the drift."""
    count = SERIES // 5 if quick else SERIES
    false = {r: _rate(count, ratio=r, size=0.0, seed=1) for r in RATIOS}
    found = {r: _rate(count, ratio=r, size=4.0, seed=2) for r in RATIOS}
    larger = {f"drift_found_{size:g}_sd": _mean(count, size) for size in (6.0, 8.0)}
    return {
        "drift_false": float(np.mean(list(false.values()))),
        "drift_found": float(np.mean(list(found.values()))), **larger,
        **{f"drift_false_between_{r:g}": rate for r, rate in false.items()},
        **{f"drift_found_between_{r:g}": rate for r, rate in found.items()},
    }  # fmt: skip


def _mean(count: int, size: float) -> float:
    return float(np.mean([_rate(count, ratio=r, size=size, seed=3) for r in RATIOS]))


def _rate(count: int, *, ratio: float, size: float, seed: int) -> float:
    """Share of series in which the newest batch is called different: in anything, or in just what was
    planted."""
    rng = np.random.default_rng([seed, int(100 * ratio), int(size)])
    names, hits = list(TRUE), 0
    for k in range(count):
        planted = names[k % len(names)] if size else None
        called = [d.name for d in drifts(_series(rng, ratio, planted, size))[0] if d.differs]
        hits += called == [planted] if planted else bool(called)
    return hits / count


def _series(rng: np.random.Generator, ratio: float, planted: str | None, size: float) -> list[Batch]:
    """Batches whose quantities scatter by nature and by measurement; the newest one has the planted drift."""
    batches = []
    for k in range(BATCHES):
        truth = {n: x + ratio * MEASURED[n] * rng.normal() for n, x in TRUE.items()}
        if planted and k == BATCHES - 1:
            truth[planted] += size * math.hypot(1, ratio) * MEASURED[planted] * rng.choice([-1, 1])
        values = values_of(_record(rng, truth))
        batches.append(Batch(name=f"batch-{k + 1:02d}", verdict="creep", effects=("creep",), values=values))
    return batches


def _record(rng: np.random.Generator, truth: dict[str, float]) -> FitRecord:
    """A fit.json of a batch: C10 and C01 with the covariance that a measured sum and share give them."""
    sd = np.array([MEASURED[n] * math.exp(0.2 * rng.normal()) for n in TRUE])  # films differ in noise
    s, h, g = np.array(list(truth.values())) + sd * rng.normal(size=3)
    turn = np.array([[1 - h, -s, 0], [h, s, 0], [0, 0, 1.0]])  # d(C10, C01, g1) / d(sum, share, g1)
    parameters = tuple(
        Parameter(n, low=-10.0, high=10.0, unit=u)
        for n, u in (("C10", "MPa"), ("C01", "MPa"), ("creep.g1", ""))
    )
    fit = Fit(
        parameters, np.array([(1 - h) * s, h * s, g]), turn @ np.diag(sd**2) @ turn.T, 100.0, 100, 0, 1, True,
        "converged", (),
    )  # fmt: skip
    notes = {p.name: {"low": None, "high": None, "note": ""} for p in parameters}
    return FitRecord.of(fit, intervals=notes)


if __name__ == "__main__":
    sys.exit(whole(__doc__, drift, quick="fewer series"))
