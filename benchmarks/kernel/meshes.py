"""Candidates for the default mesh of the finger: error of tip and middle against seconds, in one run.

    python benchmarks/kernel/meshes.py [--quick] [--json]

The error is U3 over the limit of the same geometry, to which the default lattice, not centred on the pleats,
extrapolates when divided by 1, 2 and 3 (convergence.py beside it), minus 1. Seconds are of the processor, one
thread, for a cold solve to 0.03 MPa, what is done once for a mesh done before; a candidate needs the
markers' stations among its nodes.
--quick takes a finger of three bellows: two minutes, else about ten and 5 GB.
"""

import json
import os
import sys
import time
from dataclasses import asdict, dataclass, replace

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.kernel.convergence import PRESSURE, REFINEMENTS, SHORT, SILICONE, extrapolate, run

import numpy as np

from fe import Finger, Lattice, Path, finger_case, solve

BASE = Lattice()
# Centred cells are nearer to the limit than their size says until they are divided: no order is to be had.
SETTLING = replace(BASE, centred=False)
CANDIDATES = {
    **{f"{n} cells a bellow": replace(BASE, per_bellow=n) for n in (4, 6, 8)},
    **{f"{n}, not centred": replace(BASE, per_bellow=n, centred=False) for n in (4, 6, 8)},
    **{f"{n}, block": replace(BASE, per_bellow=n, ring=False) for n in (4, 6, 8)},
    **{f"{n}, block, not centred": replace(BASE, per_bellow=n, ring=False, centred=False) for n in (4, 6, 8)},
    **{f"two in {name}": replace(BASE, **{name: 2}) for name in ("wall", "fillet", "across", "up", "caps")},
    "two in wall, fillet, across, up": replace(BASE, wall=2, fillet=2, across=2, up=2),
}
WANTED = 0.02  # relative error of tip and middle
PHASES = np.arange(4) / 4  # of a bellow: where markers may sit


@dataclass(frozen=True)
class Row:
    """One candidate: U3 in mm of tip and middle, their relative errors, s of the processor for a cold solve,
    factorisations, and whether markers find nodes at the quarters of a bellow."""

    name: str
    nodes: int
    tip: float
    middle: float
    tip_error: float
    middle_error: float
    seconds: float
    factorisations: int
    stations: bool


def measured(name: str, finger: Finger, lattice: Lattice, limit: tuple[float, float]) -> Row:
    """A candidate's row; RuntimeError where it has no equilibrium."""
    case = finger_case(SILICONE, finger=finger, lattice=lattice)
    path = Path(np.array([0.0, 1.0]), np.array([0.0, PRESSURE]), np.ones(1))
    solve(case, replace(path, pressure=1e-3 * path.pressure))
    start = time.process_time()
    found = solve(case, path)
    seconds = time.process_time() - start
    if not found.converged:
        raise RuntimeError(f"{name}: {found.reason}")
    tip, middle = found.at(np.array([finger.tip_node, finger.middle_node]))[0][:, 2]
    edge = case.nodes[(case.nodes[:, 2] < 1e-9) & (case.nodes[:, 1] > finger.width / 2 - 1e-9), 0]
    pitch = (finger.length - finger.base_cap - finger.tip_cap) / finger.bellows
    wanted = finger.base_cap + pitch * (np.arange(1, finger.bellows)[:, None] + PHASES).ravel()
    gap = np.abs(edge[:, None] - wanted).min(axis=0).max()
    return Row(
        name, len(case.nodes), float(tip), float(middle), float(tip / limit[0] - 1),
        float(middle / limit[1] - 1), seconds, found.iterations, bool(gap < 1e-6),
    )  # fmt: skip


def cheapest(rows: list[Row]) -> Row | None:
    """The candidate within WANTED at both nodes, with the markers' stations, that takes least time."""
    good = [r for r in rows if r.stations and max(abs(r.tip_error), abs(r.middle_error)) <= WANTED]
    return min(good, key=lambda r: r.seconds, default=None)


def main() -> int:
    """Print the table; the exit code is 1 where the default misses WANTED."""
    typed = options(
        __doc__,
        quick="a short finger of three bellows",
        json="the same as one JSON object",
    )
    finger = SHORT if typed.quick else Finger()
    meshes = [run(finger, replace(SETTLING, refine=n)) for n in REFINEMENTS]
    limit = (extrapolate(tuple(r.tip for r in meshes))[1], extrapolate(tuple(r.middle for r in meshes))[1])
    rows = []
    for name, lattice in CANDIDATES.items():
        rows.append(measured(name, finger, lattice, limit))
        print(f"{name}: {rows[-1].nodes} nodes", file=sys.stderr, flush=True)
    chosen = cheapest(rows)
    default = next(r for r in rows if CANDIDATES[r.name] == BASE)
    if typed.json:
        found = {"limit_mm": limit, "default": default.name, "cheapest": chosen.name if chosen else None}
        print(json.dumps(found | {"rows": [asdict(r) for r in rows]}))
    else:
        print_table(rows, limit, chosen)
    # not "> WANTED", which is false of a limit that is not to be had
    return int(not max(abs(default.tip_error), abs(default.middle_error)) <= WANTED)


def print_table(rows: list[Row], limit: tuple[float, float], chosen: Row | None) -> None:
    """The table as it stands in docs/records/meshes.md, cheapest first."""
    least = min(r.seconds for r in rows)
    print(f"limit: tip {limit[0]:.3f} mm, middle {limit[1]:.3f} mm; 1 is {least:.2f} s\n")
    print("| cells | nodes | tip | middle | time | factorisations |\n|---|---|---|---|---|---|")
    for r in sorted(rows, key=lambda r: r.seconds):
        print(f"| {r.name}{'' if r.stations else ' (stations off nodes)'} | {r.nodes} | {r.tip_error:+.2%} "
              f"| {r.middle_error:+.2%} | {r.seconds / least:.2f} | {r.factorisations} |")  # fmt: skip
    print(f"\ncheapest within {WANTED:.0%}: {chosen.name if chosen else 'none'}")


if __name__ == "__main__":
    sys.exit(main())
