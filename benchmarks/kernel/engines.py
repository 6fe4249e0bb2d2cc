"""Engines, elements and linear solvers side by side on one mesh of the finger.

    python benchmarks/kernel/engines.py [--quick] [--json]

The half finger, four cells a bellow with straight walls, at 0.03 MPa, in one run on one thread: this kernel
with PARDISO and with SuperLU, its elements that stand for C3D20R and C3D10, CalculiX in these on nodes of the
same mesh, and FElupe's three fields in hex27. Then tips on finer meshes of a short finger: FElupe's element
has eight pressure modes instead of four, so it is stiffer on one mesh, but both have one limit. Seconds are
of the processor; what this kernel does once for a mesh is done before. --quick: the short finger in the first
table too, three minutes of the processor. An engine that is not installed is left out.
"""

import importlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from types import ModuleType
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options, processor
from benchmarks.kernel.convergence import PRESSURE, SHORT, SILICONE

import numpy as np

import fe.kernel.matrix
from fe import Case, Finger, Lattice, Path, finger_case
from fe.deck.calculix import CalculiX
from fe.mesh.convert import converted

try:
    from benchmarks.kernel import felupe_model
except ImportError:  # FElupe is not installed
    felupe_model = None  # type: ignore[assignment]

kernel: ModuleType = importlib.import_module("fe.solving")  # `fe.solving` itself is the function
TIP = 4401
MESH = Lattice(per_bellow=4, ring=False, centred=False)
COARSE = replace(MESH, per_bellow=2)  # of the finer meshes
KINDS = ("C3D20RH", "C3D10H")
DIVISIONS = (1, 2, 3)
STEPS = 8  # of pressure, for FElupe


@dataclass(frozen=True)
class Row:
    """One solve: engine and element, nodes, U3 of the tip in mm, factorisations (None: not told), seconds."""

    engine: str
    nodes: int
    tip: float
    iterations: int | None
    seconds: float


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """The result of a call and the seconds of the processor that it took."""
    start = processor()
    found = work()
    return found, processor() - start


def ours(case: Case, engine: str) -> Row:
    """A cold solve by this kernel."""

    def solve(pressure: float) -> Any:
        return kernel.solve(case, Path(np.array([0.0, 1.0]), np.array([0.0, pressure]), np.array([1.0])))

    solve(1e-3 * PRESSURE)
    found, seconds = timed(lambda: solve(PRESSURE))
    if not found.converged:
        raise RuntimeError(f"{engine}: {found.reason}")
    tip = float(found.at(case.position(TIP)[None])[0, 0, 2])
    return told(Row(engine, len(case.nodes), tip, found.iterations, seconds))


def told(row: Row) -> Row:
    """The row, told as it comes: some take minutes."""
    found = f"{row.nodes} nodes, {row.tip:.3f} mm, {row.seconds:.1f} s"
    print(f"{row.engine}: {found}", file=sys.stderr, flush=True)
    return row


@contextmanager
def without_pardiso() -> Iterator[None]:
    """What the kernel does where MKL is not available."""
    pardiso, fe.kernel.matrix.PyPardisoSolver = fe.kernel.matrix.PyPardisoSolver, None
    kernel._kernel.cache_clear()
    try:
        yield
    finally:
        fe.kernel.matrix.PyPardisoSolver = pardiso
        kernel._kernel.cache_clear()


def calculix(case: Case, kind: str) -> list[Row]:
    """A solve by CalculiX, or none where it is not installed."""
    try:
        found, seconds = timed(lambda: CalculiX(kind=kind).solve(case, PRESSURE))
    except FileNotFoundError:
        return []
    if not found.converged:
        raise RuntimeError(f"CalculiX, {kind}: {found.reason}")
    tip = float(found.at(TIP)[2])
    return [told(Row(f"CalculiX, {kind[:-1]}", len(found.labels), tip, None, seconds))]


def felupe(case: Case) -> list[Row]:
    """A solve by FElupe, or none where it is not installed."""
    if felupe_model is None:
        return []
    found, seconds = timed(lambda: felupe_model.solved(case, PRESSURE, steps=STEPS))
    tip = float(found.u[np.flatnonzero(case.labels == TIP)[0], 2])
    return [told(Row("FElupe, three fields, hex27", len(case.nodes), tip, found.iterations, seconds))]


def on_one_mesh(finger: Finger) -> list[Row]:
    """Every engine on one mesh of a finger."""
    case = finger_case(SILICONE, finger=finger, lattice=MESH)
    rows = [ours(case, "this kernel, hex27")]
    with without_pardiso():
        rows.append(ours(case, "the same with SuperLU"))
    rows += felupe(case)
    for kind in KINDS:
        rows += [ours(converted(case, kind), f"this kernel, {kind}"), *calculix(case, kind)]
    return rows


def on_finer_meshes() -> dict[str, list[Row]]:
    """This kernel's and FElupe's hex27 on a short finger, every cell divided by 1 and 2, and ours by 3."""
    rows: dict[str, list[Row]] = {"this kernel": [], "FElupe": []}
    for refine in DIVISIONS:
        case = finger_case(SILICONE, finger=SHORT, lattice=replace(COARSE, refine=refine))
        rows["this kernel"].append(ours(case, "this kernel, hex27"))
        if refine < 3:  # it would take a quarter of an hour and 5 GB
            rows["FElupe"] += felupe(case)
    return rows


def print_tables(rows: list[Row], finer: dict[str, list[Row]]) -> None:
    """The tables as they stand in docs/records/engines.md."""
    print("| engine, element | nodes | U3 tip / mm | factorisations | s |\n|---|---|---|---|---|")
    for r in rows:
        print(f"| {r.engine} | {r.nodes} | {r.tip:.3f} | {r.iterations or ''} | {r.seconds:.1f} |")
    print("\n| short finger, hex27 | h | h/2 | h/3 |\n|---|---|---|---|")
    for name, own in finer.items():
        cells = [f"{r.tip:.3f} mm, {r.seconds:.1f} s" for r in own] + [""] * (len(DIVISIONS) - len(own))
        print(f"| {name} | {' | '.join(cells)} |")


def main() -> int:
    """Print the tables."""
    typed = options(__doc__, quick="the short finger in both tables", json="one JSON line")
    rows = on_one_mesh(SHORT if typed.quick else Finger())
    finer = on_finer_meshes()
    if typed.json:
        found = {name: [asdict(r) for r in own] for name, own in finer.items()}
        print(json.dumps({"rows": [asdict(r) for r in rows], "finer": found}))
    else:
        print_tables(rows, finer)
    return 0


if __name__ == "__main__":
    sys.exit(main())
