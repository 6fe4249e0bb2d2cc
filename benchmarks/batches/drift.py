"""Rates of `twin batches` on simulated series, and whether a killed `twin recalibrate` ends the same.

    python benchmarks/batches/drift.py [--quick] [drift] [kills]

`drift_false`: share of series of 8 batches without a change in which the newest is called different; 200
series for each ratio of the sd between batches to that of measurement, and the mean of all. `drift_found`:
share of those with a drift of 4 sds (of a batch: between batches and measurement together) that is found,
and in the right quantity alone. Seven former batches tell the sd so poorly that the exact t test, with
Holm's factor of 3, finds 67 % of such drifts where batches differ by nature; hence the rates for larger
drifts. `kills_same`: of `kills` (20) kills -9 at random moments of `twin recalibrate`, from the films to the
report, those of projects that end with the same bits in targets.csv, fit.json and diagnosis.json.
"""

import argparse
import hashlib
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
import benchmarks  # noqa: F401
from benchmarks.batches import make_batch

import numpy as np

from calibrate import Fit, Parameter
from fe import Lattice
from twin.batches.values import SHARE, SUM, values_of
from twin.commands.batches import Batch, drifts
from twin.commands.recalibrate import run_recalibrate
from twin.console import Console
from twin.judging.record import FitRecord
from twin.model.structure import BuiltIn
from twin.project.folder import Project
from twin.project.toml import dump

BATCHES, SERIES = 8, 200
RATIOS = (0.0, 0.5, 1.0, 3.0)  # sd between batches over that of measurement, in turn
MEASURED = {SUM: 0.003, SHARE: 0.03, "creep.g1": 0.002}  # sd of one batch: MPa, 1, 1
TRUE = {SUM: 0.297, SHARE: 0.28, "creep.g1": 0.033}


# -- rates of the test ---------------------------------------------------------------------------------------


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


# -- kill -9 -------------------------------------------------------------------------------------------------

CELLS = 4  # of the mesh on each pleat; of a quick run 2
START_S = 2.0  # in which the program loads
KILLS, LATEST = 20, 0.6  # kills in all; the latest of each, as a share of the time of a run without one


def kills(quick: bool) -> dict[str, Any]:
    """How often `twin recalibrate` was killed, and how many of these kills were of projects that end the
    same; `kills_stages` says in which stage each fell."""
    count, cells = (3, 2) if quick else (KILLS, CELLS)
    rng = np.random.default_rng(4)
    with tempfile.TemporaryDirectory() as scratch:
        first = Path(scratch) / "first"
        _make(first)
        shutil.copytree(first, first.with_name("whole"))
        start = time.monotonic()
        _finished(_child(first.with_name("whole"), cells))
        took, wanted = time.monotonic() - start, _results(first.with_name("whole"))
        assert any(name.endswith("fit.json") for name in wanted), "the run without a kill left no fit"
        same, where = 0, []
        while len(where) < count:
            folder = Path(shutil.copytree(first, first.with_name(f"killed{len(where)}")))
            own: list[str] = []
            while len(where) + len(own) < count:
                if not _killed(_child(folder, cells), START_S + float(rng.uniform(0.0, LATEST)) * took):
                    break
                own.append(_under_way(folder))
            _finished(_child(folder, cells))
            same += len(own) * (_results(folder) == wanted)
            where += own
            print(f"killed in {', '.join(own)}; {same} of {len(where)} the same", file=sys.stderr, flush=True)
    return {"kills_same": same, "kills": len(where), "kills_stages": ", ".join(sorted(set(where)))}


def _under_way(folder: Path) -> str:
    """The stage that a kill has left."""
    runs = sorted((folder / "runs").glob("*-*"), key=lambda run: int(run.name.partition("-")[0]))
    told = [run for run in runs if (run / "run.json").exists()]
    if told and json.loads((told[-1] / "run.json").read_text())["status"] == "running":
        return told[-1].name.partition("-")[2]
    return "between stages"


def _make(folder: Path) -> None:
    """A project of a small finger with its films."""
    make_batch.write_raw(folder / "raw", make_batch.FIRST)
    make_batch.write_boards(folder / "raw" / "boards")
    text = dump(make_batch.config("killed", make_batch.FIRST))
    (folder / "twin.toml").write_text(text, encoding="utf-8")


def _child(folder: Path, cells: int) -> subprocess.Popen[str]:
    """`twin recalibrate` of a project of the small finger, in a process group of its own."""
    command = [sys.executable, __file__, "--child", str(folder), str(cells)]
    return subprocess.Popen(
        command, start_new_session=True, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )


def _recalibrated(folder: Path, cells: int) -> None:
    """What `twin recalibrate` does, on a coarse mesh."""
    lattice = Lattice(per_bellow=cells, wall=1, up=1, ring=cells > 1, centred=False)
    project = Project.open(folder, builtin=BuiltIn(make_batch.FIRST.finger, lattice))
    with project.lock("recalibrate"):
        run_recalibrate(project, Console(as_json=False))


def _finished(child: subprocess.Popen[str]) -> None:
    _, said = child.communicate()
    if child.returncode:
        raise RuntimeError(f"recalibrate ended with {child.returncode}: {said}")


def _killed(child: subprocess.Popen[str], after_s: float) -> bool:
    """Kill -9 the child and all it started after a time; whether it was still at work."""
    try:
        child.communicate(timeout=after_s)
        return False
    except subprocess.TimeoutExpired:
        os.killpg(child.pid, signal.SIGKILL)
        child.communicate()
        return True


def _results(folder: Path) -> dict[str, str]:
    """Digests of what the newest done run of every stage has found, and of twin.toml and the targets."""
    found = {}
    for run in sorted((folder / "runs").iterdir()):
        told = run / "run.json"
        done = told.exists() and json.loads(told.read_text())["status"] == "done"
        for name in ("fit.json", "diagnosis.json"):
            if done and (run / name).exists():
                found[f"{run.name.partition('-')[2]}/{name}"] = _digest(run / name)
    return found | {p.name: _digest(p) for p in (folder / "twin.toml", folder / "targets" / "targets.csv")}


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        _recalibrated(Path(sys.argv[2]), int(sys.argv[3]))
        sys.exit()
    ask = argparse.ArgumentParser(description=__doc__)
    ask.add_argument("--quick", action="store_true", help="fewer series and kills")
    ask.add_argument("what", nargs="*", default=["drift", "kills"], help="drift, kills")
    told = ask.parse_args()
    parts = {"drift": drift, "kills": kills}
    print(json.dumps({k: v for name in told.what for k, v in parts[name](told.quick).items()}, indent=1))
