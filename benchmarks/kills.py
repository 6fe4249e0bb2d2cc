"""Are results the same to the bit after a worker, the scheduler or the client of a cluster is killed?

    python benchmarks/kills.py [--count 20] [--folder DIR] [--json]

A small finger is calibrated once in one process. Then, --count times, `twin calibrate` does the same on a
real scheduler and two workers on loopback. At a moment drawn at random, while there is work for the cluster,
one of the three is ended by SIGKILL. A killed worker must not show. After a killed scheduler the client must
end with one sentence; then, and after a killed client, the command is typed again: on the cluster, in
processes of this machine, or in one process, in turn. Equal: all candidates of the genetic algorithm with
their errors, and the whole of fit.json, are those of the first run. Rows go to
`benchmarks/results/kills.json` as they come, so that the command goes on where it was stopped. DIR, by
default a temporary folder, keeps the projects.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
from benchmarks import ROOT
from benchmarks.commandline import options, told

import numpy as np

from fe import Finger, Lattice, solve
from twin import files
from twin.bench.fits import fit_file
from twin.commands.calibrate import run_calibrate
from twin.console import Console
from twin.executors.chosen import using
from twin.executors.clusters import on_cluster
from twin.executors.local import Processes, Serial
from twin.judging.record import FitRecord
from twin.marktables import PointTable
from twin.model.basemodel import base_test
from twin.model.structure import BuiltIn, base_case
from twin.project.config import CalibrateTable, Config
from twin.project.folder import Project
from twin.project.targetwriting import write_targets
from twin.project.toml import dump
from twin.targets import PointKind, TargetPoint, Targets

RESULT = ROOT / "benchmarks" / "results" / "kills.json"
KILLED = ("worker", "scheduler", "client")
AGAIN = ("cluster", "processes", "serial")
WITHIN_S = 600.0
TIP = (10 + 100 / 9, 11.5, 0.0)
STUB = BuiltIn(
    Finger(length=10 + 100 / 9, bellows=1, tip_node=TIP, middle_node=(4 + 50 / 9, 11.5, 0.0)),
    Lattice(per_bellow=6, ring=False, centred=False),
)
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


def project_at(folder: Path) -> None:
    """A project of a finger of one bellow, with targets of its tip that another pair of constants gives."""
    case, time_s = base_case(finger=STUB.finger, lattice=STUB.lattice), np.linspace(0.0, 4.0, 9)
    pressure = 0.01 * time_s / time_s[-1]
    label = int(case.labels[np.abs(case.nodes - TIP).sum(axis=1).argmin()])
    shape = (len(time_s), 1, 3)
    targets = Targets(
        time=time_s, pressure=pressure, block=np.zeros(len(time_s), np.int64),
        points=(TargetPoint("tip", PointKind.NODE, label, None),),
        value=np.zeros(shape), covariance=np.tile(4e-8 * np.eye(3), (*shape[:2], 1, 1)),
        valid=np.ones(shape, bool), held_out=np.zeros(len(time_s), bool), modes=np.zeros((0, *shape)),
        mode_names=(), noise=None, log_time=time_s, log_pressure=pressure, reference=np.array([0]),
        gravity=None, pressure_sd=np.zeros(len(time_s)),
    )  # fmt: skip
    test = base_test(targets, case.with_material(C10=0.2, C01=0.05))
    u = solve(test.case, test.path).at(test.points) + 2e-4 * np.random.default_rng(1).normal(size=shape)
    config = Config(
        points=(PointTable(name="tip", node=label),),
        calibrate=CalibrateTable(population=8, generations=4, objective_points=("tip",)),
    )
    folder.mkdir(parents=True)
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", replace(targets, value=u - u[:1]))


def calibrate(folder: Path, where: str) -> None:
    """`twin calibrate` on a cluster (its scheduler.json), in processes of this machine, or in this one."""
    project, say = Project.open(folder, builtin=STUB), Console(as_json=True)
    if where in AGAIN[1:]:
        with using(Processes(2) if where == "processes" else Serial()):
            run_calibrate(project, say)
    else:
        with on_cluster(where, say):
            run_calibrate(project, say)


def digest(folder: Path) -> str:
    """The digest of what a calibration found."""
    project, h = Project.open(folder, builtin=STUB), hashlib.sha256()
    candidates = project.newest("calibrate", "candidates.npz")
    assert candidates is not None
    for values in files.read_npz(candidates, "x", "rms_mm").values():
        h.update(values.tobytes())
    h.update(files.read(FitRecord, fit_file(project)).model_dump_json().encode())
    return h.hexdigest()


@dataclass
class Cluster:
    """A scheduler and two workers on loopback, each a process of its own."""

    folder: Path
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    @property
    def file(self) -> Path:
        return self.folder / "scheduler.json"

    def whole(self) -> "Cluster":
        """The cluster with what was killed started again."""
        words = ("--no-dashboard", "--scheduler-file", str(self.file))
        if "scheduler" not in self.processes:
            self.end()
            self.folder.mkdir(parents=True, exist_ok=True)
            self.file.unlink(missing_ok=True)
            own = (*words, "--host", "127.0.0.1", "--port", "0")
            self._run("scheduler", "distributed.cli.dask_scheduler", *own)
            deadline = time.monotonic() + WITHIN_S
            while not self.file.is_file() and time.monotonic() < deadline:
                time.sleep(0.05)
        for name in ("worker 1", "worker 2"):
            if name not in self.processes:
                self._run(name, "distributed.cli.dask_worker", *words, "--name", name, "--nthreads", "1")
        return self

    def kill(self, name: str) -> None:
        self.processes[name].kill()
        self.processes.pop(name).wait()

    def end(self) -> None:
        for name in list(self.processes):
            self.kill(name)

    def _run(self, name: str, module: str, *words: str) -> None:
        env = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(ROOT)}
        with (self.folder / f"{name}.log").open("wb") as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, "-m", module, *words], cwd=self.folder, env=env, stdout=log, stderr=log
            )


def client(folder: Path, where: str) -> subprocess.Popen[str]:
    """The command, as a process of its own; its errors are in FOLDER.log."""
    words = [sys.executable, "-m", "benchmarks.kills", "--client", str(folder), "--where", where]
    with folder.with_suffix(".log").open("a") as log:
        return subprocess.Popen(words, cwd=ROOT, stdout=log, stderr=log, text=True)


def trial(
    number: int, folder: Path, cluster: Cluster, work_s: tuple[float, float], wanted: str
) -> dict[str, Any]:
    """One kill, and whether the end is the same."""
    killed, again = KILLED[number % 3], AGAIN[number // 3 % 3]
    at = float(np.random.default_rng(number).uniform(*work_s))
    running = client(folder, str(cluster.whole().file))
    try:
        running.wait(at)
    except subprocess.TimeoutExpired:
        if killed == "client":
            running.kill()
        else:
            cluster.kill("scheduler" if killed == "scheduler" else f"worker {1 + number % 2}")
    code = running.wait(WITHIN_S)
    row: dict[str, Any] = {"number": number, "killed": killed, "at_s": round(at, 1), "ended": code == 0}
    if killed == "scheduler" and code:
        said = folder.with_suffix(".log").read_text(encoding="utf-8")
        row["one_sentence"] = "Traceback" not in said and "error: " in said
    row["kept"] = kept(folder)
    if code:
        row["again"] = again
        where = str(cluster.whole().file) if again == "cluster" else again
        code = client(folder, where).wait(WITHIN_S)
    return row | {"equal": code == 0 and digest(folder) == wanted}


def kept(folder: Path) -> int:
    """How many arrays a project has in its cache."""
    return sum(1 for _ in (folder / "cache").glob("*.npz"))


def figures(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """How many were tried and are equal, by what was killed."""
    out: dict[str, Any] = {"tried": len(rows), "equal": sum(row["equal"] for row in rows)}
    for killed in KILLED:
        own = [row for row in rows if row["killed"] == killed]
        out[killed] = {
            "tried": len(own), "equal": sum(row["equal"] for row in own),
            "resumed": sum("again" in row for row in own), "kept": [row["kept"] for row in own],
        }  # fmt: skip
    out["sentences"] = sum(row.get("one_sentence", True) for row in rows if row["killed"] == "scheduler")
    return out


def main() -> int:
    """Print the figures; the exit code is 1 where an end differs."""
    typed = options(__doc__, {
        "--count": (20, "kills"),
        "--folder": (Path(), "keeps the projects"),
        "--client": (Path(), "calibrate the project in this folder, and nothing else"),
        "--where": ("", "of --client: scheduler.json, processes or serial"),
    }, json="one JSON line")  # fmt: skip
    if typed.where:
        try:
            calibrate(typed.client, typed.where)
        except (ValueError, OSError) as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
        return 0
    rows = json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.exists() else []
    with tempfile.TemporaryDirectory() as name:
        folder = typed.folder if typed.folder != Path() else Path(name)
        cluster = Cluster(folder / "cluster")
        try:
            wanted, work_s = first(folder, cluster)
            for number in range(typed.count):
                if number in {row["number"] for row in rows}:
                    continue
                own = folder / f"trial-{number}"
                shutil.rmtree(own, ignore_errors=True)
                own.with_suffix(".log").unlink(missing_ok=True)
                shutil.copytree(folder / "project", own)
                rows.append(trial(number, own, cluster, work_s, wanted))
                RESULT.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
                print(rows[-1], file=sys.stderr, flush=True)
        finally:
            cluster.end()
    found = figures(rows)
    told(found, typed.json)
    return 0 if found["equal"] == found["tried"] else 1


def first(folder: Path, cluster: Cluster) -> tuple[str, tuple[float, float]]:
    """The digest of the calibration in one process, and from when to when, in s after the command, a cluster
    has work for it."""
    for name in ("project", "serial", "whole"):
        shutil.rmtree(folder / name, ignore_errors=True)
    project_at(folder / "project")
    for name in ("serial", "whole"):
        shutil.copytree(folder / "project", folder / name)
    if client(folder / "serial", "serial").wait(WITHIN_S):
        raise SystemExit((folder / "serial.log").read_text(encoding="utf-8"))
    running, began = client(folder / "whole", str(cluster.whole().file)), time.monotonic()
    ends: list[float] = []
    while running.poll() is None:
        new = kept(folder / "whole") - len(ends)
        ends += new * [time.monotonic() - began]
        time.sleep(0.02)
    if running.returncode or len(ends) < 2:
        raise SystemExit((folder / "whole.log").read_text(encoding="utf-8"))
    wanted, work_s = digest(folder / "serial"), ends[-1] - ends[0]
    if digest(folder / "whole") != wanted:
        raise SystemExit("the cluster gives other bits than one process, and nothing was killed")
    return wanted, (ends[0] - work_s / (len(ends) - 1), ends[-1])  # the first was as long as the others


if __name__ == "__main__":
    sys.exit(main())
