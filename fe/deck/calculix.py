"""The engine CalculiX (`ccx`): runs a deck in a folder of its own and reads its result file."""

import os
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


@dataclass(frozen=True)
class CalculiX:
    """The engine `ccx`; folder: where its files stay, by default nowhere; kind: the element that takes the
    place of hex27, without its H."""

    executable: str = "ccx"
    folder: Path | None = None
    threads: int = 1
    kind: str = "C3D20RH"
    name: str = "CalculiX"

    def solve(self, case: Case, pressure: float, *, gravity: Array | None = None) -> EngineResult:
        """The response of a case to a follower pressure in MPa and a gravity (3,) mm/s2; see `run`.

        ValueError for what `check` refuses.
        """
        check(case)
        return self.run(deck(case, pressure, kind=self.kind, gravity=gravity))

    def run(self, text: str) -> EngineResult:
        """The response of a deck. FileNotFoundError where ccx is not installed; never raises for lack of
        convergence."""
        program = shutil.which(self.executable)
        if program is None:
            raise FileNotFoundError(
                f"{self.executable}: not found, wanted CalculiX; install the package calculix-ccx"
            )
        with tempfile.TemporaryDirectory() as scratch:
            folder = self.folder or Path(scratch)
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "job.inp").write_text(without_hybrid(text), encoding="utf-8")
            start = time.perf_counter()
            done = subprocess.run(
                [program, "-i", "job"],
                cwd=folder,
                env=os.environ | {"OMP_NUM_THREADS": str(self.threads), "CCX_NPROC_EQUATION_SOLVER": "1"},
                capture_output=True,
                text=True,
            )
            seconds = time.perf_counter() - start
            return _read(folder / "job.frd", done, seconds)


def check(case: Case) -> None:
    """ValueError for a case that it cannot solve.

    Mullins softening and creep it does not know; and C01 and C20 in one material: its polynomial of second
    order (2.20) softens by C20 what should stiffen.
    """
    for name, m in case.materials.items():
        for what, there in (("Mullins softening", m.mullins and m.mullins[0]), ("a Prony series", m.prony)):
            if there:
                raise ValueError(f"material {name!r} has {what}: CalculiX knows none; drop it")
        if m.C01 and m.C20 and not m.ogden:
            raise ValueError(
                f"material {name!r} has C01 and C20: CalculiX 2.20 solves that law wrongly; set one to 0"
            )


def without_hybrid(text: str) -> str:
    """The deck with the H dropped from its element types, as CalculiX knows no hybrid elements."""
    lines = text.splitlines()
    for k, line in enumerate(lines):
        if line.upper().startswith("*ELEMENT,"):
            lines[k] = ",".join(
                part.rstrip("Hh") if part.strip().upper().startswith("TYPE=C3D") else part
                for part in line.split(",")
            )
    return "\n".join(lines) + "\n"


def _read(path: Path, done: "subprocess.CompletedProcess[str]", seconds: float) -> EngineResult:
    """The last displacements of a result file (.frd: fixed columns, six digits)."""
    blocks: list[list[str]] = []
    inside = False
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else []:
        if line.startswith(" -4  DISP"):
            blocks.append([])
            inside = True
        elif line.startswith(" -3"):
            inside = False
        elif inside and line.startswith(" -1"):
            blocks[-1].append(line)
    finished = done.returncode == 0 and "Job finished" in done.stdout
    told = [line.strip() for line in done.stdout.splitlines() if "*ERROR" in line]
    reason = "converged" if finished and blocks else (told[0] if told else "ccx stopped before the end")
    if reason != "converged":
        return EngineResult.failed(reason, seconds)
    rows = blocks[-1]
    labels = np.array([int(r[3:13]) for r in rows], np.int64)
    u = np.array([[float(r[13 + 12 * k : 25 + 12 * k]) for k in range(3)] for r in rows]).reshape(-1, 3)
    return EngineResult(labels, u, True, reason, seconds)
