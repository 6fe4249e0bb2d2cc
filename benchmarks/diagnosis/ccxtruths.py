"""What hidden kinds change, solved by another engine: CalculiX beside this kernel, on one mesh.

    python benchmarks/diagnosis/ccxtruths.py [--json] [--only NAME ..]

The short finger on a lattice of four cells a bellow, upright under its weight, at the top pressure; every
static kind at its smallest and largest size that an Abaqus deck can say. A row holds what the kind changes at
the places for markers, by both engines in C3D20R, and the rms of the difference in sds of the trials' noise.
About ten minutes of one core. The table is written to `benchmarks/results/ccxtruths.json`.
"""

import json
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.diagnosis.snapshots import COURSE, POINTS, SHORT
from benchmarks.diagnosis.truthbook import SD_MM

import numpy as np

from fe import Case, Lattice, solve
from fe import Path as Course
from fe.deck.calculix import CalculiX
from twin.effects.protocol import Test
from twin.gravity import G
from twin.targets import Array
from twin.virtual.hidden import KINDS, Kind
from twin.virtual.protocols import TOP, WAYS
from twin.virtual.truthsolves import truth_case, truth_test

RESULTS = ROOT / "benchmarks" / "results" / "ccxtruths.json"
MESH = Lattice(per_bellow=4, ring=False, centred=False)
ELEMENT = "C3D20RH"  # for which CalculiX takes its C3D20R
UP = G * np.array(WAYS[0])


def wanted(names: list[str]) -> Iterator[tuple[Kind, float]]:
    """Kinds and sizes whose change can be solved for one pressure alone."""
    for kind in KINDS.values():
        able = kind.part == "static" and not kind.whole and kind.name == kind.key
        if able and (not names or kind.name in names):
            for size in dict.fromkeys((min(kind.sizes), max(kind.sizes))):
                yield kind, size


def here(case: Case, points: Array) -> Array:
    """Displacements (p, 3) mm of points by this kernel."""
    load = np.array([0.0, TOP])
    found = solve(case, Course(load, load, load[1:], gravity=UP))
    if not found.converged:
        raise RuntimeError(found.reason)
    return found.at(points)[0]


def there(case: Case, points: Array) -> Array:
    """The same by CalculiX. RuntimeError where it does not converge."""
    found = CalculiX().solve(case, TOP, gravity=UP)
    if not found.converged:
        raise RuntimeError(found.reason)
    own = np.argsort(found.labels)
    u = found.u[own[np.searchsorted(found.labels, case.labels, sorter=own)]]
    return np.asarray(u[nearest(case, points)], float)


def nearest(case: Case, points: Array) -> list[int]:
    """The rows (p,) of the nodes nearest to points (p, 3) mm."""
    return [int(np.linalg.norm(case.nodes - x, axis=1).argmin()) for x in points]


def row(kind: Kind, size: float, bare: dict[str, Array], test: Test) -> dict[str, Any]:
    """What a kind changes by both engines."""
    changed = kind.before(replace(test, path=COURSE), size).case
    points = changed.nodes[nearest(test.case, test.points)]
    ours, theirs = here(changed, points) - bare["ours"], there(changed, points) - bare["theirs"]
    gap = float(np.sqrt(((theirs - ours)[:, ::2] ** 2).mean()))
    return {
        "kind": kind.name, "size": size, "change_mm": float(np.abs(ours).max()), "rms_gap_mm": gap,
        "gap_in_sd": gap / SD_MM,
    }  # fmt: skip


def main() -> int:
    typed = options(__doc__, {"--only": {"nargs": "*", "default": []}}, json="one JSON line")
    case = truth_case(SHORT, MESH, element=ELEMENT)
    points = case.nodes[nearest(case, POINTS)]
    test = truth_test(case, COURSE, points)
    bare = {"ours": here(case, points), "theirs": there(case, points)}
    rows, lost = [], {}
    for kind, size in wanted(typed.only):
        try:
            rows.append(row(kind, size, bare, test))
        except (RuntimeError, ValueError) as error:
            lost[f"{kind.name} {size:g}"] = str(error)
            print(f"{kind.name} {size:g}: {error}", file=sys.stderr, flush=True)
            continue
        if not typed.json:
            r = rows[-1]
            differs = f"differs by {1e3 * r['rms_gap_mm']:6.2f} um, {r['gap_in_sd']:.2f} sd"
            print(f"{r['kind']:24s} {size:10.3g} {r['change_mm']:8.3f} mm  {differs}", flush=True)
    worst = max((r["gap_in_sd"] for r in rows), default=None)
    gap = float(np.abs(bare["ours"] - bare["theirs"]).max())
    table = {"n": len(rows), "bare_gap_mm": gap, "largest_gap_in_sd": worst, "rows": rows, "not_solved": lost}
    if not typed.only:
        RESULTS.parent.mkdir(exist_ok=True)
        RESULTS.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(table) if typed.json else f"{len(rows)} changes, the largest gap is {worst:.2f} sd")
    return 0


if __name__ == "__main__":
    sys.exit(main())
