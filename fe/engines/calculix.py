"""The engine CalculiX (`ccx`): runs a deck in a folder of its own and reads its result file."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fe.case import Case
from fe.element import Array
from fe.engines import process
from fe.engines.engine import EngineResult, Program, program
from fe.engines.writer import deck, steps_of


@dataclass(frozen=True)
class CalculiX(Program):
    """The engine `ccx`; folder: where its files stay, by default nowhere; kind: the element that takes the
    place of hex27, without its H."""

    executable: str = "ccx"
    folder: Path | None = None
    threads: int = 1
    kind: str = "C3D20RH"
    name: str = "CalculiX"
    timeout_s: float = process.TIMEOUT_S

    def deck(self, case: Case, pressure: float, *, gravity: Array | None = None, levels: int = 0) -> str:
        """The deck of a case. ValueError for what `check` or a deck refuses."""
        check(case)
        text = deck(case, pressure, kind=self.kind, gravity=gravity, levels=levels)
        return without_hybrid(text)

    def unfit(self, case: Case) -> str:
        """Reason why CalculiX cannot solve a case of rubber, "" if it can: only its C3D20R does not lock."""
        name = case.element.name
        if name in ("hex27", "C3D20R", "C3D20RH"):
            return ""
        return (
            f"elements {name}: without hybrid ones it moves nearly incompressible rubber too little (a tube "
            "of C3D8 by 0.009 mm instead of 0.107); mesh it with C3D20R"
        )

    def release(self) -> str:
        """CalculiX's version. FileNotFoundError where ccx is not installed."""
        lines = process.release_words([self._program(), "-v"])
        return f"CalculiX {lines[-1][-1][:40]}" if lines else "CalculiX"

    def _program(self) -> str:
        return program(self.executable, "CalculiX", "install the package calculix-ccx")

    def run(self, text: str, *, folder: Path | None = None) -> EngineResult:
        """Response of a deck over its last step. FileNotFoundError where ccx is not installed; never raises
        for lack of convergence. folder: the job's folder, by default temporary."""
        executable = self._program()
        threads = dict.fromkeys(("OMP_NUM_THREADS", "CCX_NPROC_EQUATION_SOLVER"), str(self.threads))

        def solve(folder: Path) -> EngineResult:
            for name in ("job.frd", "job.log"):
                (folder / name).unlink(missing_ok=True)  # of an earlier run
            start, env = time.perf_counter(), os.environ | threads
            done = process.output([executable, "-i", "job"], folder=folder, seconds=self.timeout_s, env=env)
            seconds = time.perf_counter() - start
            (folder / "job.log").write_text(done.text, encoding="utf-8")
            return _read(folder / "job.frd", done, seconds, steps_of(text))

        return process.run_job(without_hybrid(text), folder or self.folder, solve)


def check(case: Case) -> None:
    """ValueError for a case with Mullins softening or a Prony series, which CalculiX does not know."""
    for name, m in case.materials.items():
        for what, there in (("Mullins softening", m.mullins and m.mullins[0]), ("a Prony series", m.prony)):
            if there:
                raise ValueError(f"material {name!r} has {what}: CalculiX knows none; drop it")


def without_hybrid(text: str) -> str:
    """The deck with the H dropped from its element types, as CalculiX knows no hybrid elements.

    >>> print(without_hybrid("*ELEMENT, TYPE=C3D20RH, ELSET=BODY"), end="")
    *ELEMENT, TYPE=C3D20R, ELSET=BODY
    """
    lines = text.splitlines()
    for k, line in enumerate(lines):
        if line.upper().startswith("*ELEMENT,"):
            lines[k] = ",".join(
                part.rstrip("Hh") if part.strip().upper().startswith("TYPE=C3D") else part
                for part in line.split(",")
            )
    return "\n".join(lines) + "\n"


def _read(path: Path, done: process.Output, seconds: float, steps: int) -> EngineResult:
    """The displacements of a result file (.frd: fixed columns, six digits) in the last of its steps."""
    times, blocks, inside, now = [0.0], list[list[str]](), False, 0.0
    for line in process.result_lines(path):
        if line.startswith("  100C"):
            now = float(process.numbers([line[12:24]])[0])  # of all steps, each of which takes 1
        elif line.startswith(" -4  DISP"):
            blocks.append([])
            times.append(now)
            inside = True
        elif line.startswith(" -3"):
            inside = False
        elif inside and line.startswith(" -1"):
            blocks[-1].append(line)
    finished = done.code == 0 and "Job finished" in done.text
    if not finished:  # the last is cut off, or the best of an increment that did not converge
        blocks = blocks[:-1]
    complete = [rows for rows in blocks if len(rows) == len(blocks[0])]
    errors = [done.stopped] if done.stopped else [x.strip() for x in done.text.splitlines() if "*ERROR" in x]
    share = np.array(times[1 : len(complete) + 1]) - (steps - 1)
    if finished and complete:
        reason = "converged"
    elif not finished and len(share) and share[-1] > 0.0:
        reason = f"stopped at {share[-1]:.3g} of the step: {errors[0] if errors else 'ccx gives no reason'}"
    else:
        reason = errors[0] if errors else "ccx stopped before the end"
    if not complete:
        return EngineResult.failed(reason, seconds)
    labels = process.numbers([r[3:13] for r in complete[0]]).astype(np.int64)
    rows = [k for k, s in enumerate(share) if s >= -1e-9]
    words = [r[13 + 12 * d : 25 + 12 * d] for k in rows for r in complete[k] for d in range(3)]
    u = process.numbers(words).reshape(len(rows), len(labels), 3)
    return EngineResult(labels, share[rows], u, reason == "converged", reason, seconds)
