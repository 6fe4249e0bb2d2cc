"""What does a cluster cost, and how much of it works? Bytes and seconds of a task, and the efficiency.

    python benchmarks/clusters.py [--quick] [--json]

The tasks are the load paths of the reference study's finger, as `twin calibrate` solves them for a finger of
other dimensions, and its finer meshes. They run on real workers on loopback, one and then two: the efficiency
is the seconds in tasks over workers times seconds until the last result. For 100 and 10 000 workers the same
is simulated: tasks of the measured seconds, ten and a hundred for each worker, handed out one after the other
at the pace that tiny tasks were handed out here; and whole batches, by the seconds of costs.json. Results go
to `benchmarks/results/clusters.json`. About three minutes; --quick: the load paths alone, four of them, not
written.
"""

import heapq
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.reduction import ForkingPickler
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
from benchmarks import ROOT
from benchmarks.commandline import options, told

import numpy as np

from fe import Finger, Path
from twin.executors.chosen import current
from twin.executors.clusters import on_cluster
from twin.executors.protocol import Executor, Task, gathered
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, NOMINAL
from twin.model.discretisation import SAMPLES, _response
from twin.model.loadpaths import NOTHING, REDUCED, SCALE, along_path
from twin.model.structure import BuiltIn, Structure, of_finger
from twin.targets import Array

RESULT = ROOT / "benchmarks" / "results" / "clusters.json"
COSTS = ROOT / "benchmarks" / "results" / "costs.json"  # the demo's calibrate, diagnose and add
STATIONS = (12, 22, 32, 42, 52, 64, 72)  # in 1/72 of the bellows' 100 mm: markers along the finger
TOP = 0.024  # MPa
TINY = 1000
COUNT = MOONEY_RIVLIN.shapes[0].count
SIZES, PER_WORKER = (100, 10_000), (10, 100)


def load_paths(structure: Structure, points: Array, count: int) -> list[Task]:
    """The tasks of load paths, so many of different shares of C10."""
    reduced = np.linspace(0, 1, 61) ** 1.3 * REDUCED
    shares = 0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count)
    every = [MOONEY_RIVLIN.at(SCALE, (float(s),)) for s in shares]
    return [partial(along_path, structure.case, c, SCALE, reduced, points, NOTHING) for c in every]


def finer_meshes(structure: Structure, points: Array) -> list[Task]:
    """The tasks of the error of the mesh, the largest first."""
    grid = np.linspace(0.0, TOP, SAMPLES)
    meshes = [*reversed(structure.finer.values()), structure.base]
    return [partial(_response, mesh, NOMINAL, {}, Path(grid, grid, grid), points) for mesh in meshes]


def timed(task: Task) -> tuple[float, float, Any]:
    """Seconds of the clock and of the processor that a task takes, and its result."""
    began, spent = time.perf_counter(), time.process_time()
    result = task()
    return time.perf_counter() - began, time.process_time() - spent, result


def ran(executor: Executor, tasks: Sequence[Task]) -> tuple[float, list[tuple[float, float, Any]]]:
    """Seconds until the last result, and what each task took and gave."""
    began = time.perf_counter()
    found = list(gathered(executor, [partial(timed, task) for task in tasks]))
    return time.perf_counter() - began, found


def simulated(seconds: Sequence[float], *, workers: int, tasks: int, pace: float, seed: int = 0) -> float:
    """The efficiency of so many workers on so many tasks of the measured seconds, drawn at random, where a
    scheduler hands out one after the other, each in `pace` seconds."""
    took = np.random.default_rng(seed).choice(np.asarray(seconds), size=tasks)
    free, now = [0.0] * workers, 0.0
    for one in took:
        now = max(now + pace, free[0])
        heapq.heapreplace(free, now + float(one))
    return float(took.sum() / (workers * max(free)))


def size_of(what: Any) -> int:
    """Bytes of a task or result as it is sent."""
    return len(ForkingPickler.dumps(what))


def measured(tasks: Sequence[Task]) -> dict[str, Any]:
    """Figures of tasks on one and two workers of dask on this machine."""
    from distributed import LocalCluster

    out: dict[str, Any] = {}
    for workers in (1, 2):
        with (
            LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
            on_cluster(cluster.scheduler_address, _said),
        ):
            list(gathered(current(), list(tasks[-1:]) * workers))  # what is loaded once
            whole, found = ran(current(), tasks)
            tiny, _ = ran(current(), [partial(pow, k, 2) for k in range(TINY)])
        inside = [seconds for seconds, _, _ in found]
        out |= {
            f"efficiency_{workers}": sum(inside) / (workers * whole),
            f"wall_s_{workers}": whole,
            f"tiny_ms_{workers}": 1e3 * tiny / TINY,
        }
    cpu = [spent for _, spent, _ in found]
    bytes_of = [size_of(task) for task in tasks], [size_of(result) for _, _, result in found]
    out |= {"tasks": len(tasks), "task_cpu_s": float(np.mean(cpu)), "longest_cpu_s": max(cpu)}
    out |= {"task_kB": max(bytes_of[0]) / 1e3, "result_kB": max(bytes_of[1]) / 1e3}
    return out | many(cpu, out["tiny_ms_2"] / 1e3)


def many(seconds: Sequence[float], pace: float) -> dict[str, float]:
    """The simulated efficiency of many workers, by their number and that of tasks for each."""
    return {
        f"simulated_{n}_workers_{each}_tasks_each": simulated(seconds, workers=n, tasks=n * each, pace=pace)
        for n in SIZES
        for each in PER_WORKER
    }


def _said(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def main() -> int:
    """Print the figures; without --quick write them."""
    typed = options(__doc__, quick="four load paths; nothing is written", json="one JSON line")
    own = BuiltIn.of(Finger())
    structure = of_finger(own.finger, own.lattice)
    x = 4.0 + np.array(STATIONS) * 100.0 / 72.0
    points = np.stack([x, np.full_like(x, 11.5), np.zeros_like(x)], axis=1)
    kinds: dict[str, Callable[[], list[Task]]] = {
        "load paths": lambda: load_paths(structure, points, 4 if typed.quick else COUNT)
    }
    if not typed.quick:
        kinds["finer meshes"] = lambda: finer_meshes(structure, points)
    found: dict[str, Any] = {"load_before": os.getloadavg()[0], "cores": os.cpu_count()}
    found |= {kind: measured(tasks()) for kind, tasks in kinds.items()}
    batch = sum(json.loads(COSTS.read_text(encoding="utf-8"))["cpu_s"].values())
    pace = found["load paths"]["tiny_ms_2"] / 1e3
    found["batches"] = {"task_cpu_s": batch} | many([batch], pace)
    if not typed.quick:
        RESULT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if typed.json:
        print(json.dumps(found))
        return 0
    for kind in (*kinds, "batches"):
        print(f"\n{kind}")
        told(found[kind], False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
