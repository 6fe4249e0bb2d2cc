"""The engine Abaqus: runs a deck, extracts displacements by a script for Abaqus Python, reads their CSV.

Abaqus is not needed for anything else, and is not there where this is tested: the deck is solved by CalculiX,
the command line by a stand-in that records it.
"""

import csv
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fe.case import Case
from fe.deck.engine import EngineResult
from fe.deck.writer import deck
from fe.element import Array

# Runs under Abaqus's own Python, of any version: the last frame's displacements of every node as text. The
# deck's step takes 1 s; the time period of a step is not among the documented members of the odb's steps.
EXTRACT = """\
import sys
from odbAccess import openOdb

odb = openOdb(path=sys.argv[-2], readOnly=True)
try:
    step = list(odb.steps.values())[-1]
    frame = step.frames[-1]
    out = open(sys.argv[-1], "w")
    out.write("# %.9g of 1 s\\n" % frame.frameValue)
    out.write("label,u1,u2,u3\\n")
    for v in frame.fieldOutputs["U"].values or []:
        u = v.data if str(v.precision) == "SINGLE_PRECISION" else v.dataDouble
        out.write("%s,%.9g,%.9g,%.9g\\n" % (v.nodeLabel, u[0], u[1], u[2]))
    out.close()
finally:
    odb.close()
"""


@dataclass(frozen=True)
class Abaqus:
    """The engine `abaqus`, by default as in the reference study: 4 CPUs and domains, 60 % of the memory.

    folder: where its files stay, by default nowhere; kind: the hybrid element that takes the place of hex27.
    """

    executable: str = "abaqus"
    folder: Path | None = None
    cpus: int = 4
    memory: str = "60%"
    kind: str = "C3D20RH"
    name: str = "Abaqus"

    def commands(self) -> tuple[list[str], list[str]]:
        """The command lines of the job and of the extraction, in the job's folder."""
        parallel = [f"cpus={self.cpus}", f"domains={self.cpus}", f"memory={self.memory}"]
        job = [self.executable, "job=job", "input=job.inp", *parallel, "interactive", "ask_delete=OFF"]
        return job, [self.executable, "python", "extract.py", "job.odb", "job.csv"]

    def solve(self, case: Case, pressure: float, *, gravity: Array | None = None) -> EngineResult:
        """The response of a case to a follower pressure in MPa and a gravity (3,) mm/s2. FileNotFoundError
        where Abaqus is not installed; never raises for lack of convergence."""
        program = shutil.which(self.executable)
        if program is None:
            raise FileNotFoundError(
                f"{self.executable}: not found, wanted Abaqus; install it, name its command, or take "
                "another engine"
            )
        with tempfile.TemporaryDirectory() as scratch:
            folder = self.folder or Path(scratch)
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "job.inp").write_text(
                deck(case, pressure, kind=self.kind, gravity=gravity), encoding="utf-8"
            )
            (folder / "extract.py").write_text(EXTRACT, encoding="utf-8")
            (folder / "job.csv").unlink(missing_ok=True)  # of an earlier run
            start = time.perf_counter()
            for command in self.commands():
                done = subprocess.run([program, *command[1:]], cwd=folder, capture_output=True, text=True)
                if done.returncode != 0:
                    told = (done.stderr or done.stdout).strip().splitlines() or ["no message"]
                    return EngineResult.failed(
                        f"{' '.join(command)}: {told[-1]}", time.perf_counter() - start
                    )
            return _read(folder / "job.csv", time.perf_counter() - start)


def _read(path: Path, seconds: float) -> EngineResult:
    if not path.exists():
        return EngineResult.failed(f"{path.name} was not written by the extraction script", seconds)
    first, *rest = path.read_text(encoding="utf-8", errors="replace").splitlines()
    reached, _, whole, _ = first.lstrip("# ").split()
    rows = list(csv.DictReader(rest))
    labels = np.array([int(r["label"]) for r in rows], np.int64)
    u = np.array([[float(r[k]) for k in ("u1", "u2", "u3")] for r in rows]).reshape(-1, 3)
    if float(reached) < float(whole) * (1 - 1e-6):
        return EngineResult.failed(f"stopped at {float(reached) / float(whole):.3g} of the step", seconds)
    order = np.argsort(labels)
    return EngineResult(labels[order], u[order], True, "converged", seconds)
