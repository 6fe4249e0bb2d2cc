"""Is the law of a silicone named? Virtual films of fingers of Yeoh's, Ogden's and Gent's rubber.

    python benchmarks/kernel/lawsnamed.py [--quick] [--json]

Each trial draws a law, its scale and its shape, and films a finger of three bellows of it (five markers, one
ramp to 30 kPa, 15 um of noise, gauge, placement and scale as `twin.virtual.draws` has them). The truth is
solved in 20-node elements on a mesh of its own, the fits are those of `twin calibrate --laws` on another,
with the error of its mesh. named: the share of trials in which the true law stands in the first class, that
of the laws which the film cannot tell from the best. alone: the share in which it stands there by itself;
others: how many stand beside it; lost: what was named in its place. Trials go to
`benchmarks/results/lawsnamed.json` as they come, so that the command goes on where it was stopped; one takes
a minute and a half of one core. --quick: 6 trials.
"""

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options, told
from benchmarks.diagnosis.snapshots import SHORT

import numpy as np
from scipy.interpolate import CubicSpline

from fe import Lattice, solve
from twin.commands.calibratelaws import run_laws
from twin.laws.catalogue import LAWS
from twin.laws.law import Constants
from twin.marktables import PointTable
from twin.model.structure import BuiltIn
from twin.project.config import CalibrateTable, Config
from twin.project.folder import Project
from twin.project.targetwriting import write_targets
from twin.project.toml import dump
from twin.targets import PointKind, TargetPoint, Targets
from twin.virtual.draws import Setup, measured
from twin.virtual.protocols import PROTOCOLS, places
from twin.virtual.truthsolves import COUNT, LATTICE, truth_case, truth_test

RESULT = ROOT / "benchmarks" / "results" / "lawsnamed.json"
TRIALS, FEW = 60, 6
TRIED = ("neo-hooke", "mooney-rivlin", "yeoh", "gent", "arruda-boyce", "ogden1")
MODEL = BuiltIn(SHORT, Lattice(per_bellow=4))
PROTOCOL = PROTOCOLS["P2"]
MARKERS = {name: x for name, x in places(SHORT).items() if name in ("p1", "p3", "p4", "p6", "tip")}
AIM = CalibrateTable(objective_points=("tip",))
SCALES = (0.13, 0.25)  # MPa, half of the shear modulus: 0.12 to 0.23 of it is the highest pressure
SETUP = Setup(placement_sd_mm=0.02)


class Quiet:
    """A stage's remarks go nowhere."""

    def __call__(self, text: str) -> None:
        """Nothing."""

    def progress(self, task: str, done: int, total: int) -> None:
        """Nothing."""


def drawn(number: int) -> Constants:
    """The true constants of a trial: Yeoh's, Ogden's and Gent's law in turn."""
    rng = np.random.default_rng([number, 26])
    scale = float(rng.uniform(*SCALES))
    square, cube = (scale * float(rng.uniform(*ends)) for ends in ((0.05, 0.3), (0.0, 0.05)))
    yeoh = {"C10": scale, "C20": square, "C30": cube}
    ogden = {"mu1": 2 * scale, "alpha1": float(rng.choice([rng.uniform(-4, -2), rng.uniform(3, 7)]))}
    gent = {"mu": 2 * scale, "Jm": float(rng.uniform(1.5, 8.0))}
    name, values = (("yeoh", yeoh), ("ogden1", ogden), ("gent", gent))[number % 3]
    return LAWS[name].of(values)


def filmed(truth: Constants, seed: int) -> Targets:
    """What would be measured of a finger of that rubber. RuntimeError where it has no equilibrium."""
    case = truth_case(SHORT, LATTICE, material=truth.material)
    test = truth_test(case, PROTOCOL.course, np.array(list(MARKERS.values())))
    found = solve(test.case, test.path, count=COUNT)
    if not found.converged:
        raise RuntimeError(f"the truth {found.reason}")
    u, (pressure, first) = found.at(test.points), np.unique(test.path.at_output(), return_index=True)
    slope = CubicSpline(pressure, u[first])(test.path.at_output(), 1)
    points = [TargetPoint(name, PointKind.PLACE, None, x) for name, x in MARKERS.items()]
    return measured(PROTOCOL, u, slope, points=points, setup=SETUP, seed=seed)


def trial(number: int, folder: Path) -> dict[str, Any]:
    """The true law of a trial, and the laws of the first class, in a project of a folder."""
    truth = drawn(number)
    for name in ("targets", "runs"):
        shutil.rmtree(folder / name, ignore_errors=True)
    table = tuple(PointTable(name=name, position_mm=x) for name, x in MARKERS.items())
    (folder / "twin.toml").write_text(dump(Config(points=table, calibrate=AIM)), encoding="utf-8")
    write_targets(folder / "targets", filmed(truth, number))
    found = run_laws(Project.open(folder, builtin=MODEL), Quiet(), laws=",".join(TRIED))
    first = [row["name"] for row in found["laws"] if row["group"] == 1]
    return {"number": number, "truth": truth.law.name, "constants": truth.named, "first": first}


def figures(trials: int, folder: Path, kept: Path | None) -> dict[str, Any]:
    """The share of trials whose law is named, and what was named else; one line a trial goes to stderr."""
    known = json.loads(kept.read_text(encoding="utf-8")) if kept is not None and kept.exists() else []
    rows = {row["number"]: row for row in known}
    for number in range(trials):
        if number in rows:
            continue
        rows[number] = trial(number, folder)
        if kept is not None:
            lines = ",\n".join(json.dumps(rows[k]) for k in sorted(rows))
            kept.write_text(f"[\n{lines}\n]\n", encoding="utf-8")
        print(json.dumps(rows[number]), file=sys.stderr, flush=True)
    return summary([rows[k] for k in range(trials)])


def summary(rows: list[Mapping[str, Any]]) -> dict[str, Any]:
    """The figures of trials."""
    right = [row for row in rows if row["truth"] in row["first"]]
    return {"law_named": {
        "n": len(rows), "named": round(len(right) / len(rows), 3),
        "alone": round(sum(len(row["first"]) == 1 for row in right) / len(rows), 3),
        "others": round(float(np.mean([len(row["first"]) - 1 for row in right or rows])), 2),
        "of": {law: f"{sum(r['truth'] == law for r in right)}/{sum(r['truth'] == law for r in rows)}"
               for law in dict.fromkeys(row["truth"] for row in rows)},
        "lost": [f"{row['truth']}: {', '.join(row['first'])}" for row in rows if row not in right],
    }}  # fmt: skip


def law_named(quick: bool) -> dict[str, Any]:
    """The figures of a few trials or of all."""
    with tempfile.TemporaryDirectory() as folder:
        return figures(FEW if quick else TRIALS, Path(folder), None if quick else RESULT)


if __name__ == "__main__":
    typed = options(__doc__, quick="6 trials, none of which is kept", json="one JSON line")
    told(law_named(typed.quick), typed.json)
