"""The engine Abaqus: runs a deck, extracts displacements by a script for Abaqus Python, reads their CSV.

Abaqus is not needed for anything else, and is not there where this is tested: the deck is solved by CalculiX,
the command line by a stand-in that records it.
"""

import re
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fe.case import Case
from fe.element import Array
from fe.engines import process
from fe.engines.engine import EngineResult, Program, program
from fe.engines.writer import deck, steps_of

# Runs under Abaqus's own Python, of any version: the displacements of every node as text, at every increment
# of the deck's last step. That takes 1 s; the time period of a step is not among the documented members of
# the odb's steps. Of a job that stopped in an earlier step nothing is written.
EXTRACT = """\
import sys
from odbAccess import openOdb

odb = openOdb(path=sys.argv[-3], readOnly=True)
try:
    steps = list(odb.steps.values())
    out = open(sys.argv[-1], "w")
    out.write("share,label,u1,u2,u3\\n")
    for frame in steps[-1].frames if len(steps) == int(sys.argv[-2]) else []:
        for v in frame.fieldOutputs["U"].values or []:
            u = v.data if str(v.precision) == "SINGLE_PRECISION" else v.dataDouble
            out.write("%.9g,%s,%.9g,%.9g,%.9g\\n" % (frame.frameValue, v.nodeLabel, u[0], u[1], u[2]))
    out.close()
finally:
    odb.close()
"""
COLUMNS = "share,label,u1,u2,u3"


@dataclass(frozen=True)
class Abaqus(Program):
    """The engine `abaqus`, by default as in the reference study: 4 CPUs and domains, 60 % of the memory.

    folder: where its files stay, by default nowhere; kind: the hybrid element that takes the place of hex27.
    """

    executable: str = "abaqus"
    folder: Path | None = None
    cpus: int = 4
    memory: str = "60%"
    kind: str = "C3D20RH"
    name: str = "Abaqus"
    timeout_s: float = process.TIMEOUT_S

    def commands(self, steps: int = 1) -> tuple[list[str], list[str]]:
        """The command lines of the job and of the extraction, in the job's folder."""
        parallel = [f"cpus={self.cpus}", f"domains={self.cpus}", f"memory={self.memory}"]
        job = [self.executable, "job=job", "input=job.inp", *parallel, "interactive", "ask_delete=OFF"]
        return job, [self.executable, "python", "extract.py", "job.odb", str(steps), "job.csv"]

    def release(self) -> str:
        """Abaqus's version line. FileNotFoundError where Abaqus is not installed."""
        lines = (" ".join(words) for words in process.release_words([self._program(), "information=release"]))
        return next((line for line in lines if re.search(r"Abaqus\b.*(\d{4}|\d\.\d)", line)), "Abaqus")

    def _program(self) -> str:
        return program(self.executable, "Abaqus", "install it, name its command, or take another engine")

    def deck(self, case: Case, pressure: float, *, gravity: Array | None = None, levels: int = 0) -> str:
        """The deck of a case. ValueError for what a deck refuses."""
        return deck(case, pressure, kind=self.kind, gravity=gravity, levels=levels)

    def unfit(self, case: Case) -> str:
        """Always "": Abaqus has hybrid elements of every shape."""
        return ""

    def run(self, text: str, *, folder: Path | None = None) -> EngineResult:
        """Response of a deck over its last step. FileNotFoundError where Abaqus is not installed; never
        raises for lack of convergence. folder: the job's folder, by default temporary."""
        executable = self._program()

        def solve(folder: Path) -> EngineResult:
            (folder / "extract.py").write_text(EXTRACT, encoding="utf-8")
            for name in ("job.csv", "job.odb", "job.log"):
                (folder / name).unlink(missing_ok=True)  # of an earlier run
            start, failed, log = time.perf_counter(), "", ""
            for command in self.commands(steps_of(text)):
                done = process.output([executable, *command[1:]], folder=folder, seconds=self.timeout_s)
                log += f"$ {' '.join(command)}\n{done.text}\n"
                (folder / "job.log").write_text(log, encoding="utf-8")
                if done.code != 0:
                    message = done.stopped or (done.text.strip().splitlines() or ["no message"])[-1]
                    failed = failed or f"{' '.join(command)}: {message}"
                    if not (folder / "job.odb").exists():
                        break  # else what was reached is read
            return _read(folder / "job.csv", failed, time.perf_counter() - start)

        return process.run_job(text, folder or self.folder, solve)


def _read(path: Path, failed: str, seconds: float) -> EngineResult:
    if not path.exists():
        return EngineResult.failed(failed or f"{path.name} was not written by the extraction script", seconds)
    header, *rest = process.result_lines(path) or [""]
    if header != COLUMNS:
        return EngineResult.failed(f"{path.name} begins with {header!r}, wanted {COLUMNS}", seconds)
    table = process.numbers([cell for line in rest for cell in line.split(",")]).reshape(-1, 5)
    share, count = np.unique(table[:, 0], return_counts=True)
    if not len(share) or share[-1] <= 0.0:
        return EngineResult.failed(failed or "the result file holds no displacements", seconds)
    if len(np.unique(count)) > 1:
        return EngineResult.failed("the result file holds other nodes at other increments", seconds)
    rows = table[np.lexsort((table[:, 1], table[:, 0]))].reshape(len(share), -1, 5)
    reached = share[-1] > 1 - 1e-6
    stopped = f"stopped at {share[-1]:.3g} of the step"
    reason = "converged" if reached and not failed else f"{stopped}: {failed}" if failed else stopped
    labels = rows[0, :, 1].astype(np.int64)
    return EngineResult(labels, share, rows[:, :, 2:], reason == "converged", reason, seconds)
