"""How often is the diagnosis right? Virtual trials on the short finger, with intervals, and simpler rules
beside.

    python benchmarks/diagnosis/identify.py [--quick] [--json] [--folder DIR] [--only GROUP ..] [--share K/N]

Every trial hides something of a stated non-centrality in a truth of another mesh and element
(`snapshots.py` beside it), draws noise and markers, and runs `twin.diagnosis.procedure.diagnose` on a model
that looks its answers up in tables of the fitted mesh (`bank.py`). Results go to a file as they
come (--folder), so that the command goes on where it was stopped; --share 1/2 and 2/2 do a half each. The
table is written to `benchmarks/results/identify.json`. --quick: a tenth of the trials, not written.
"""

import json
import os
import platform
import sys
import tempfile
import time
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.diagnosis.tally import CLEAR, summary
from benchmarks.diagnosis.trialbench import Scene, Spec, cosine, largest, run

import numpy as np

from twin.virtual.hidden import KINDS

RESULTS = ROOT / "benchmarks" / "results" / "identify.json"
PLAIN = (10.0, 30.0, 100.0)  # sizes at which an effect ought to be named
FAINT = (3.0, 5.0)  # and at which it need not be: the foot of the power curve
SAME = [k.name for k in KINDS.values() if k.law == "same"]
OTHER = [k.name for k in KINDS.values() if k.law == "other"]
UNKNOWN = [k.name for k in KINDS.values() if k.law == "unknown"]
GRAVITY = ("gravity",)
FORCES = ("force_up", "force_down", "force_side")
ALIKE = 0.95  # cosine of two effects that no data of a protocol tell apart
COUNTS = {"P5": 150, "P3": 60, "P1": 60}  # of each law


def specs() -> list[Spec]:
    """All trials, those of every group spread evenly, so that a part of them is a fair part."""
    groups: list[list[Spec]] = []
    for protocol, count in COUNTS.items():
        for law, names in (("same", SAME), ("other", OTHER)):
            seen = seen_in(protocol, [n for n in names if protocol == "P5" or n not in GRAVITY])
            groups.append(_trials(f"{protocol} {law}", protocol, seen, PLAIN, count))
            if protocol == "P5":
                groups.append(_trials(f"{protocol} {law}", protocol, seen, FAINT, 2 * len(seen), first=5000))
    groups.append([Spec("white", "P5", (), 0.0, "white", 10_000 + s) for s in range(200)])
    groups.append([Spec("ar1", "P5", (), 0.0, "ar1", 20_000 + s) for s in range(200)])
    groups.append(_trials("unknown", "P5", UNKNOWN, PLAIN, 20 * len(UNKNOWN), first=30_000))
    groups.append(_pairs(120))
    total = max(map(len, groups))
    placed = [(k * total / len(g), j, spec) for j, g in enumerate(groups) for k, spec in enumerate(g)]
    return [spec for _, _, spec in sorted(placed, key=lambda row: row[:2])]


def seen_in(protocol: str, names: Sequence[str]) -> list[str]:
    """The kinds that a protocol can show plainly at their largest size."""
    scene = Scene.of(Spec("", protocol, (), 0.0, "white", 2))
    several = [n for n in names if n != "marker_slip" or scene.protocol.along > 1]
    return [n for n in several if largest(scene, KINDS[n]) >= CLEAR]


def _trials(
    group: str, protocol: str, names: Sequence[str], sizes: Sequence[float], count: int, *, first: int = 1000
) -> list[Spec]:
    """So many trials of a group, kinds and sizes in turn."""
    out = []
    for k in range(count):
        name = names[k % len(names)]
        size = sizes[(k // len(names) + k) % len(sizes)]
        noise = "white" if k % 2 else "ar1"
        without = ("tube",) if name in FORCES else ()
        out.append(Spec(group, protocol, (name,), size, noise, first + k, without))
    return out


def _pairs(count: int) -> list[Spec]:
    """Pairs of effects of which neither does the other's work: where both are plain and their changes, beside
    the constants, have a cosine below ALIKE."""
    rng, scene, out = np.random.default_rng(5), Scene.of(Spec("", "P5", (), 0.0, "white", 2)), []
    able = [n for n in seen_in("P5", SAME) if n not in ("gravity", "clamp")]
    both = [{a, b} for a, b in combinations(able, 2) if cosine(scene, KINDS[a], KINDS[b]) < ALIKE]
    while len(out) < count:
        a, b = (able[k] for k in rng.choice(len(able), 2, replace=False))
        if {a, b} in both:
            sigmas = (30.0, 100.0)[len(out) % 2]
            out.append(Spec("pairs", "P5", (a, b), sigmas, "white", 40_000 + len(out)))
    return out


def done(file: Path) -> list[dict[str, Any]]:
    """The results in a file, one a line."""
    if not file.exists():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines() if line.strip()]


def main() -> int:
    typed = options(__doc__, {
        "--folder": (Path(tempfile.gettempdir()) / "softtwin-identify", "where results are kept"),
        "--only": {"nargs": "*", "default": (), "help": "groups, such as 'P5 same'"},
        "--share": ("1/1", "which part of the trials to run: 1/2, 2/2"),
        "--table": "run nothing; make the table of what is there",
    }, quick="a tenth of the trials; nothing is written", json="print the table as JSON")  # fmt: skip
    folder: Path = typed.folder
    folder.mkdir(parents=True, exist_ok=True)
    part, parts = map(int, typed.share.split("/"))
    wanted = [s for s in specs() if not typed.only or s.group in typed.only]
    wanted = wanted[:: 10 if typed.quick else 1]
    rows = [row for file in sorted(folder.glob("*.jsonl")) for row in done(file)]
    have = {row["key"] for row in rows}
    todo = [] if typed.table else [s for s in wanted[part - 1 :: parts] if s.key not in have]
    began = time.perf_counter()
    name = f"{part}of{parts}-{'-'.join(typed.only) or 'all'}.jsonl".replace(" ", "_")
    with (folder / name).open("a", encoding="utf-8") as out:
        for k, spec in enumerate(todo):
            row = run(spec)
            rows.append(row)
            out.write(json.dumps(row) + "\n")
            out.flush()
            if not typed.json:
                print(f"{k + 1:5d} {spec.key:58s} {row['seconds']:5.1f} s  {row['verdict']}", flush=True)
    keys = {s.key for s in wanted}
    table = summary([row for row in rows if row["key"] in keys or row["group"] in ("film", "full_fe")])
    table["planned"] = len(wanted)
    table["versions"] = {"python": platform.python_version(), "numpy": np.__version__}
    table["seconds"]["of_this_run"] = time.perf_counter() - began
    if not typed.quick and not typed.only:
        RESULTS.parent.mkdir(exist_ok=True)
        RESULTS.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(table, indent=None if typed.json else 1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
