"""How fast and how right the finite-element kernel is: against CalculiX, its own factorisations, and itself.

    python benchmarks/kernel/speed.py [--quick] [--json]

Five measurements in one run, one thread each: CalculiX on the very deck, with the same element; CalculiX at
the same distance to the extrapolated tip; the time of a cold solve over that of its own factorisations and
back-substitutions; random constants of the study's bounds, and neighbours of a solved state; derivatives
against central differences of whole solves. --quick takes a finger of three bellows for the extrapolated
limits: about six minutes in all, else ten. Without CalculiX its figures are left out (null).
"""

import json
import os
import statistics
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.kernel.convergence import SHORT, SILICONE, extrapolate

import numpy as np

from fe import Case, Finger, Lattice, Path, Solution, Variation, finger_case, solve
from fe.engines.calculix import CalculiX
from fe.kernel.matrix import Symmetric
from fe.mesh.convert import converted

PRESSURE = 0.03  # MPa
TIP = 4401
REDUCED = "C3D20RH"
SETS = 50  # random sets of constants
SOFTEST = 0.2  # p / (C10 + C01), the largest that is tried
# Uniform cells and straight lines: what is refined of it converges from one side.
PLAIN = Lattice(per_bellow=4, ring=False, centred=False)
NEIGHBOURS = ((1.1, 1.0), (1.0, 1.1), (1.1, 1.1), (0.9, 0.9), (0.9, 1.1))  # factors of C10 and C01


@dataclass(frozen=True)
class Row:
    """One solve of the whole finger: who, how many cells a bellow, nodes, U3 of the tip in mm, seconds."""

    engine: str
    per_bellow: int
    nodes: int
    tip: float
    seconds: float


def to(pressure: float) -> Path:
    """A ramp whose end alone is wanted."""
    return Path(np.array([0.0, 1.0]), np.array([0.0, pressure]), np.array([1.0]))


def tip_of(case: Case, solution: Solution) -> float:
    """U3 of the tip in mm."""
    return float(solution.at(case.position(TIP)[None])[0, 0, 2])


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """The result of a call and the seconds that it took."""
    start = time.perf_counter()
    found = work()
    return found, time.perf_counter() - start


def ours(case: Case, per_bellow: int, engine: str) -> Row:
    """A cold solve; what is done once for a mesh is done before."""
    solve(case, to(1e-3 * PRESSURE))
    found, seconds = timed(lambda: solve(case, to(PRESSURE)))
    if not found.converged:
        raise RuntimeError(f"{engine}, {per_bellow} cells a bellow: {found.reason}")
    return Row(engine, per_bellow, len(case.nodes), tip_of(case, found), seconds)


def theirs(case: Case, per_bellow: int) -> Row | None:
    """The same by CalculiX in C3D20R, or nothing where it is not installed."""
    try:
        found = CalculiX(kind=REDUCED).solve(case, PRESSURE)
    except FileNotFoundError:
        return None
    if not found.converged:
        raise RuntimeError(f"CalculiX, {per_bellow} cells a bellow: {found.reason}")
    return Row("ccx C3D20R", per_bellow, len(found.labels), float(found.at(TIP)[2]), found.seconds)


def against_calculix() -> tuple[list[Row], float | None, float | None]:
    """Rows; CalculiX's time over ours on the cheapest mesh of ours whose tip is nearer to the limit (both are
    too stiff: the larger deflection is the nearer); and the relative difference on one deck."""
    rows = [ours(finger_case(SILICONE, lattice=Lattice(per_bellow=n)), n, "hex27") for n in (4, 6, 8)]
    same = finger_case(SILICONE, lattice=replace(PLAIN, per_bellow=8))
    twin = ours(converted(same, REDUCED), 8, "ours C3D20R")
    peer = theirs(same, 8)
    if peer is None:
        return [*rows, twin], None, None
    nearer = min((r for r in rows if r.tip <= peer.tip), key=lambda r: r.seconds)
    return [*rows, twin, peer], peer.seconds / nearer.seconds, abs(peer.tip / twin.tip - 1)


def limits(quick: bool) -> tuple[float | None, dict[str, Any]]:
    """Relative difference of the tips to which refined meshes of both elements extrapolate, and the tips.

    CalculiX itself would take hours for the finer ones: it solves the coarsest, and its element on the others
    is ours, which agrees with it on one deck (see above).
    """
    finger = SHORT if quick else Finger()
    tips: dict[str, list[float]] = {"hex27": [], REDUCED: [], "ccx C3D20R": []}
    for refine in (1, 2, 3):
        case = finger_case(SILICONE, finger=finger, lattice=replace(PLAIN, refine=refine))
        for kind in ("hex27", REDUCED):
            changed = case if kind == "hex27" else converted(case, kind)
            tips[kind].append(tip_of(changed, solve(changed, to(PRESSURE))))
        if refine == 1:
            with suppress(FileNotFoundError):
                tips["ccx C3D20R"].append(float(CalculiX(kind=REDUCED).solve(case, PRESSURE).at(TIP)[2]))
    found = {kind: extrapolate(tuple(tips[kind])) for kind in ("hex27", REDUCED)}
    told = {kind: {"tips_mm": tips[kind], "order": p, "limit_mm": v} for kind, (p, v) in found.items()}
    told["ccx C3D20R"] = {"tips_mm": tips["ccx C3D20R"]}
    a, b = (found[kind][1] for kind in found)
    return (abs(a / b - 1) if np.isfinite(a + b) else None), told


def floor(case: Case) -> tuple[float, int]:
    """Time of a cold solve over that of its own factorisations and back-substitutions, and their number."""
    spent, plain = [0.0], (Symmetric.factorise, Symmetric.solve)

    def clocked(method: Callable[..., Any]) -> Callable[..., Any]:
        def call(self: Symmetric, *arguments: Any) -> Any:
            found, seconds = timed(lambda: method(self, *arguments))
            spent[0] += seconds
            return found

        return call

    Symmetric.factorise, Symmetric.solve = (clocked(m) for m in plain)  # type: ignore[method-assign]
    try:
        ratios = []
        for _ in range(5):
            spent[0] = 0.0
            found, seconds = timed(lambda: solve(case, to(PRESSURE)))
            ratios.append(seconds / spent[0])
    finally:
        Symmetric.factorise, Symmetric.solve = plain  # type: ignore[method-assign]
    return statistics.median(ratios), found.iterations


def random_sets(case: Case, count: int) -> tuple[int, float, list[str]]:
    """How many of `count` random sets of constants converge from cold, the median number of factorisations,
    and the reasons of the others."""
    rng, iterations, reasons = np.random.default_rng(1), [], []
    while len(iterations) + len(reasons) < count:
        C10, C01 = rng.uniform(0.01, 0.5), rng.uniform(0.0, 0.5)
        if PRESSURE / (C10 + C01) > SOFTEST:
            continue
        found = solve(case.with_material(C10=C10, C01=C01), to(PRESSURE))
        if found.converged:
            iterations.append(found.iterations)
        else:
            reasons.append(found.reason)
    return len(iterations), statistics.median(iterations), reasons


def varied(case: Case, name: str, step: float) -> Variation:
    """The variation of a constant of the silicone."""
    value = getattr(SILICONE, name)
    plus, minus = (case.with_material(**{name: value + sign * step}) for sign in (1, -1))
    return Variation((plus, to(PRESSURE)), (minus, to(PRESSURE)), step)


def warm(case: Case) -> list[int]:
    """Factorisations of solves at neighbouring constants, each begun from the solved state to first order."""
    names = ("C10", "C01")
    base = solve(case, to(PRESSURE), variations=[varied(case, name, 2e-7) for name in names])
    out = []
    for factors in NEIGHBOURS:
        values = {n: getattr(SILICONE, n) * f for n, f in zip(names, factors, strict=True)}
        change = np.array([values[n] - getattr(SILICONE, n) for n in names])
        found = solve(case.with_material(**values), to(PRESSURE), start=base.ahead(change))
        out.append(found.iterations if found.converged else 99)
    return out


def sensitivity_error(case: Case) -> float:
    """Largest relative difference, over all nodes, between derivatives and central differences of whole
    solves, for C10 and C01; the differences are extrapolated from two steps (Richardson)."""
    names, worst = ("C10", "C01"), 0.0
    found = solve(case, to(PRESSURE), variations=[varied(case, name, 2e-7) for name in names])
    for n, name in enumerate(names):
        values = getattr(SILICONE, name)

        def field(change: float, name: str = name, values: float = values) -> Any:
            return solve(case.with_material(**{name: values + change}), to(PRESSURE)).fields([0])[0]

        wide, narrow = ((field(h) - field(-h)) / (2 * h) for h in (2e-3, 1e-3))
        exact = (4 * narrow - wide) / 3
        ours = found.curves[0].derivative[n][-1]
        worst = max(worst, float(np.abs(ours - exact).max() / np.abs(exact).max()))
    return worst


def main() -> int:
    """Print the figures; the exit code is 1 where a solve failed that should not."""
    typed = options(__doc__, quick="limits on a finger of three bellows", json="one JSON line")
    case = finger_case(SILICONE)
    solve(case, to(1e-3 * PRESSURE))  # compiled, and the mesh analysed
    floor_ratio, cold = floor(case)
    converged, factorisations, reasons = random_sets(case, SETS)
    neighbours = warm(case)
    error = sensitivity_error(case)
    rows, ratio, difference = against_calculix()
    apart, tips = limits(typed.quick)
    figures = {
        "ccx_ratio": ratio,
        "floor_ratio": floor_ratio,
        "cold_factorisations": cold,
        "warm_iterations": max(neighbours),
        "factorisations": factorisations,
        "converged": converged,
        "tried": SETS,
        "ccx_difference": difference,
        "ccx_limit_difference": apart,
        "sensitivity_error": error,
    }
    if typed.json:
        print(json.dumps(figures | {"rows": [asdict(r) for r in rows], "limits": tips, "reasons": reasons}))
    else:
        print_tables(figures, rows, tips)
    return int(converged < SETS)


def print_tables(figures: dict[str, Any], rows: list[Row], tips: dict[str, Any]) -> None:
    """The tables as they stand in docs/records/engines.md."""
    print("| engine, element | cells a bellow | nodes | U3 tip / mm | s |\n|---|---|---|---|---|")
    for r in rows:
        print(f"| {r.engine} | {r.per_bellow} | {r.nodes} | {r.tip:.3f} | {r.seconds:.2f} |")
    print("\n| element | U3 tip / mm at h, h/2, h/3 | order | limit / mm |\n|---|---|---|---|")
    for kind, told in tips.items():
        values = ", ".join(f"{x:.4f}" for x in told["tips_mm"])
        print(f"| {kind} | {values} | {told.get('order', np.nan):.2f} | {told.get('limit_mm', np.nan):.4f} |")
    print("\n| figure | measured |\n|---|---|")
    for name, value in figures.items():
        print(f"| {name} | {value if value is None or isinstance(value, int) else f'{value:.3g}'} |")


if __name__ == "__main__":
    sys.exit(main())
