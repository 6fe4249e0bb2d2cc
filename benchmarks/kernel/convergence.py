"""Three uniformly refined meshes of the finger -> the order and the limit of its displacements, measured.

    python benchmarks/kernel/convergence.py [--quick] [--block] [--json]

The default lattice, not centred on the pleats, is divided by 1, 2 and 3 (--quick: a short finger of three
bellows on a coarser lattice; --block: four cells a bellow, walls by straight lines). Centred cells are nearer
to the limit than their size says until they are divided, so that they show no order.
From values at h, h/2 and h/3 the order p and the limit v solve v(h) = v + c h^p exactly; neither is assumed.
"""

import json
import os
import sys
import time
from dataclasses import asdict, dataclass, replace

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options

import numpy as np
from scipy.optimize import brentq

from fe import Finger, Lattice, Material, Path, finger_case, solve

SILICONE = Material(C10=0.214, C01=0.083)  # MPa, the values of the reference study
PRESSURE = 0.03  # MPa
REFINEMENTS = (1, 2, 3)
NAMES = ("tip", "middle")
END = 10 + 3 * 100 / 9  # mm, length of the short finger
SHORT = Finger(length=END, bellows=3, tip_node=(END, 11.5, 0.0), middle_node=(4 + 150 / 9, 11.5, 0.0))


@dataclass(frozen=True)
class Row:
    """One mesh: its divisions, nodes, U3 in mm at the two nodes, seconds, and the reason where it stopped."""

    refine: int
    nodes: int
    tip: float
    middle: float
    seconds: float
    reason: str


def run(finger: Finger, lattice: Lattice) -> Row:
    """U3 at the tip and the middle node of `finger` on `lattice`, at the top pressure."""
    start = time.perf_counter()
    case = finger_case(SILICONE, finger=finger, lattice=lattice)
    found = solve(case, Path(np.array([0.0, 1.0]), np.array([0.0, PRESSURE]), np.array([1.0])))
    u = np.full((2, 3), np.nan)
    if found.converged:
        u = found.at(np.array([finger.tip_node, finger.middle_node]))[0]
    seconds = time.perf_counter() - start
    return Row(lattice.refine, len(case.nodes), float(u[0, 2]), float(u[1, 2]), seconds, found.reason)


def extrapolate(value: tuple[float, ...]) -> tuple[float, float]:
    """The order p and the limit v of v(h) = v + c h^p, from values at h, h/2 and h/3; NaN where they do not
    settle."""
    a, b, c = value
    ratio = (a - b) / (b - c)

    def miss(p: float) -> float:
        return float((1 - 2**-p) / (2**-p - 3**-p) - ratio)

    if not miss(0.05) < 0 < miss(12.0):
        return np.nan, np.nan
    p = float(brentq(miss, 0.05, 12.0))
    return p, c - (a - b) / (1 - 2**-p) * 3**-p


def main() -> int:
    """Print the table; the exit code is 1 where a mesh did not converge."""
    typed = options(__doc__, {"--block": "four cells a bellow, walls by straight lines"},
                    quick="a short finger, coarser meshes: under a minute", json="one JSON line")  # fmt: skip
    finger = SHORT if typed.quick else Finger()
    cells = 4 if typed.quick or typed.block else Lattice().per_bellow
    lattice = Lattice(per_bellow=cells, centred=False, ring=not typed.block)
    rows = []
    for refine in REFINEMENTS:
        rows.append(run(finger, replace(lattice, refine=refine)))
        print(
            f"refine {refine}: {rows[-1].nodes} nodes, {rows[-1].seconds:.0f} s", file=sys.stderr, flush=True
        )
    limits = {name: extrapolate(tuple(getattr(r, name) for r in rows)) for name in NAMES}
    if typed.json:
        found = {name: {"order": p, "limit_mm": v} for name, (p, v) in limits.items()}
        print(json.dumps({"meshes": [asdict(r) for r in rows], **found}))
    else:
        print_table(rows, limits)
    return int(any(r.reason != "converged" for r in rows))


def print_table(rows: list[Row], limits: dict[str, tuple[float, float]]) -> None:
    """The table as it stands in docs/records/meshes.md."""
    print("| mesh | nodes | U3 tip / mm | U3 middle / mm |\n|---|---|---|---|")
    for r in rows:
        print(f"| h/{r.refine} | {r.nodes} | {r.tip:.3f} | {r.middle:.3f} |")
    print("| limit | | " + " | ".join(f"{limits[n][1]:.3f}" for n in NAMES) + " |")
    print("| order | | " + " | ".join(f"{limits[n][0]:.2f}" for n in NAMES) + " |")


if __name__ == "__main__":
    sys.exit(main())
