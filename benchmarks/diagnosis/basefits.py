"""How good is the first fit? Films on the short finger, with an effect hidden and without.

    python benchmarks/diagnosis/basefits.py [--quick] [--json]

Markers are placed to 0.02 mm, as in all trials. Of every film with an effect of 10, 30 or 100 sd
hidden the base model is fitted (`judge_base`): base_within_10pct is the share whose C10 + C01 is within 10 %
of the truth, base_error the rms of that error, plain_error the same of least squares weighted by the errors.
Of every film without one: expected_inside, the share whose error lies in the 95 % band that is told for a
right model; chi2_per_dof of its tests. noise_told: of tables whose noise is stated and not measured, as half
or double of what it is, or as white where it is correlated by 0.6 from step to step: the share in which the
sd and rho that the film itself tells are within 20 % of the truth, and in which diagnose names no effect.
--quick: 12 films of each, else 200.
"""

import json
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.identify import of_law
from benchmarks.diagnosis.trialbench import (
    EVERY,
    MAIN,
    SD_MM,
    START,
    Scene,
    Sight,
    Spec,
    candidates,
    sized,
)

import numpy as np

from twin.diagnosis.procedure import diagnose
from twin.effects.protocol import Unsolvable
from twin.judging.judged import Judged, judge, judge_base
from twin.judging.scatter import with_own_noise
from twin.judging.stillnoise import stated_noise
from twin.targets import Targets

PROTOCOL, FILMS, QUICK = "P3", 200, 12
SIZES = (10.0, 30.0, 100.0)  # sd
TABLE = "P5"
MISSTATED = {"half": (0.5, 0.0), "double": (2.0, 0.0), "ar1": (1.0, 0.6)}  # stated sd over the true; true rho


def film(number: int) -> dict[str, Any]:
    """The row of a film: the relative errors of C10 + C01 with an effect hidden, and a right model's fit."""
    kinds = [*of_law("same"), *of_law("other")]
    kind, size = kinds[7 * number % len(kinds)], SIZES[number % len(SIZES)]
    spec = Spec("base", PROTOCOL, (kind,), size, "white", 700 + number)
    scene = Scene.of(spec)
    hidden, change = sized(Sight.of(scene), EVERY[kind], size, np.random.default_rng([spec.seed, 11]))
    row: dict[str, Any] = {"kind": kind, "sigmas": float(np.linalg.norm(change))}
    lacking = scene.targets(((EVERY[kind], hidden),))
    for name, fit in (("base", judge_base), ("plain", judge)):
        try:
            row[name] = _error(fit(scene.model(lacking), lacking, starts=START))  # type: ignore[operator]
        except Unsolvable:
            row[name] = float("inf")
    whole = scene.targets(())
    found = judge_base(scene.model(whole), whole, starts=START).comparison
    row["inside"] = bool(found.expected_low_mm <= found.raw_rms_mm <= found.expected_high_mm)
    row["tests"] = {t.name: (t.chi2, t.degrees_of_freedom) for t in found.tests}
    return row


def _error(judged: Judged) -> float:
    """The relative error of C10 + C01."""
    return float(judged.theta.sum() / MAIN.scale - 1)


def table(targets: Targets, sd_mm: float) -> Targets:
    """Targets as a table states them: an sd of each value by itself, and no static film."""
    stated = sd_mm**2 * np.eye(3) * np.isfinite(targets.value)[..., None]
    reference = np.array([name.startswith("reference:") for name in targets.mode_names])
    of_mean = sd_mm / np.sqrt(len(targets.reference)) * (targets.modes != 0)
    return replace(
        targets, noise=stated_noise(targets.value, sd_mm),
        covariance=np.where(np.isfinite(targets.covariance), stated, np.nan),
        modes=np.where(reference[:, None, None, None], of_mean, targets.modes),
    )  # fmt: skip


def told(number: int, how: str) -> dict[str, Any]:
    """The row of a table whose noise is misstated: what the film tells of it, and what a diagnosis says."""
    factor, rho = MISSTATED[how]
    noise = "ar1" if rho else "white"
    scene = Scene.of(Spec("told", TABLE, (), 0.0, noise, 4000 + number))
    targets = with_own_noise(table(scene.targets(()), factor * SD_MM))
    found = targets.noise
    assert found is not None
    sd, lag = float(np.nanmean(found.sd)) / SD_MM, float(np.nanmean(found.rho))
    said = diagnose(
        scene.model(targets), candidates(), targets, seed=number, start=START, beside=(), plan=False
    )
    return {"how": how, "sd": sd, "rho": lag, "verdict": said.verdict, "named": list(said.named),
            "right": bool(abs(sd - 1) < 0.2 and abs(lag - rho) < 0.2 * (rho or 1))}  # fmt: skip


def noise_told(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The rates of the misstated tables, by what is wrong with their noise."""
    out = {}
    for how in MISSTATED:
        those = [row for row in rows if row["how"] == how]
        out[how] = {
            "within_20pct": float(np.mean([row["right"] for row in those])),
            "no_effect_named": float(np.mean([not row["named"] for row in those])),
        }
    return out


def summary(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """The rates of all films; of what is hidden, of those in which it shows by half of the least size."""
    rows = list(rows)
    plain_to_see = [row for row in rows if row["sigmas"] > SIZES[0] / 2]
    base, plain = (np.array([row[name] for row in plain_to_see]) for name in ("base", "plain"))
    totals = {
        name: np.sum([row["tests"][name] for row in rows if name in row["tests"]], axis=0)
        for name in ("pressure", "picture", "smooth")
    }
    return {
        "films": len(rows),
        "base_within_10pct": float((np.abs(base) < 0.1).mean()),
        "plain_within_10pct": float((np.abs(plain) < 0.1).mean()),
        "base_error": float(np.sqrt((base**2).mean())),
        "plain_error": float(np.sqrt((plain**2).mean())),
        "expected_inside": float(np.mean([row["inside"] for row in rows])),
        "chi2_per_dof": {name: float(t[0] / t[1]) for name, t in totals.items() if np.ndim(t)},
    }


def main() -> None:
    chosen = options(__doc__ or "", quick=f"{QUICK} films", json="no row of every film")
    rows = []
    for number in range(QUICK if chosen.quick else FILMS):
        rows.append(film(number))
        print(number if chosen.json else rows[-1], file=sys.stderr, flush=True)
    tables = []
    for number, how in product(range(QUICK if chosen.quick else FILMS), MISSTATED):
        tables.append(told(number, how))
        print(how if chosen.json else tables[-1], file=sys.stderr, flush=True)
    print(json.dumps(summary(rows) | {"noise_told": noise_told(tables)}, indent=1))


if __name__ == "__main__":
    main()
