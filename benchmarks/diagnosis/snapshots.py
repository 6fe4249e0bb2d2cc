"""Solves of hidden truths on a mesh and element of their own, kept small: `benchmarks/data/truths.npz`.

    python benchmarks/diagnosis/snapshots.py [--only NAME ..] [--folder DIR] [--pack] [--later]

The truths are those of `twin.virtual.hidden`, on the short finger, at all places for markers. Every solve is
saved as it ends (a file in --folder, by default the system's temporary folder), so that the command goes on
where it was stopped; --pack writes them into one file. About 15 minutes of one core. --later: the kinds in
the folder `kinds`, and differences between two castings, instead, into a file of their own.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.diagnosis.kindsbetween import BETWEEN
from benchmarks.diagnosis.laterkinds import KINDS_LATER

import numpy as np

from fe import Finger
from fe.mesh.mirror import mirrored
from twin.effects.protocol import Test
from twin.virtual.hidden import KINDS, Kind
from twin.virtual.protocols import PROTOCOLS, places
from twin.virtual.truthsolves import (
    BARE,
    CHANGE,
    curves,
    history,
    slopes,
    solved,
    truth_case,
    truth_test,
)

SHORT = Finger(
    length=10 + 100 / 3, bellows=3, tip_node=(10 + 100 / 3, 11.5, 0.0), middle_node=(4 + 50 / 3, 11.5, 0.0)
)
POINTS = np.array(list(places(SHORT).values()))
DATA = ROOT / "benchmarks" / "data" / "truths.npz"
LATER = DATA.with_name("latertruths.npz")
COURSE = PROTOCOLS["P5"].course


SMOOTH = tuple(k for k in KINDS.values() if k.part == "static" and not k.whole and k.name == k.key)


def tasks(*, later: bool = False) -> dict[str, Callable[[], np.ndarray]]:
    """Every solve by its name."""
    case = truth_case(SHORT, CHANGE)
    half, whole = (truth_test(c, COURSE, POINTS) for c in (case, mirrored(case)))
    found: dict[str, Callable[[], np.ndarray]] = {
        "fine": lambda: curves(truth_test(truth_case(SHORT, BARE), COURSE, POINTS)),
        "bare": lambda: curves(half),
        "course": lambda: history(half),
        "slopes": lambda: slopes(SMOOTH, half),
    }
    return of_sizes(KINDS_LATER | BETWEEN, half, whole) if later else found | of_sizes(KINDS, half, whole)


def of_sizes(kinds: Mapping[str, Kind], half: Test, whole: Test) -> dict[str, Callable[[], np.ndarray]]:
    """The solves of kinds at their sizes, by name."""
    return {
        f"{kind.name}@{size:g}": partial(solved, kind, whole if kind.whole else half, size)
        for kind in kinds.values()
        if kind.part in ("static", "history") and kind.name == kind.key
        for size in kind.sizes
    }


def main() -> int:
    typed = options(__doc__, {
        "--only": {"nargs": "*", "default": (), "help": "kinds to solve, instead of all"},
        "--part": {"choices": ("static", "history"), "help": "these kinds alone"},
        "--folder": (Path(tempfile.gettempdir()) / "softtwin-truths", "where solves are kept"),
        "--pack": "write what is solved into one file",
        "--later": "the kinds that were written after the rule was frozen",
    })  # fmt: skip
    typed.folder.mkdir(parents=True, exist_ok=True)
    made, target = tasks(later=typed.later), LATER if typed.later else DATA
    for name, make in made.items():
        path = typed.folder / f"{name}.npy"
        kind = (KINDS | KINDS_LATER | BETWEEN).get(name.partition("@")[0])
        if path.exists() or (typed.only and name.partition("@")[0] not in typed.only):
            continue
        if typed.part and (kind.part if kind else "static") != typed.part:
            continue
        began = time.process_time()
        try:
            array = make()
        except (RuntimeError, ValueError) as error:
            print(f"{name}: {error}", flush=True)
            continue
        scratch = path.with_suffix(".part.npy")
        np.save(scratch, array)
        scratch.replace(path)
        print(f"{name}: {time.process_time() - began:.1f} s of CPU", flush=True)
    if typed.pack:
        target.parent.mkdir(exist_ok=True)
        files = sorted(p for p in typed.folder.glob("*.npy") if p.stem in made)
        arrays = {p.stem: np.load(p).astype(np.float32) for p in files}
        np.savez_compressed(target, allow_pickle=False, **arrays)
        print(f"{target}: {len(arrays)} solves, {target.stat().st_size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
