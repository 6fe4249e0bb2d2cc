"""The measured error of the fitted mesh of the short finger, by `twin.model.discretisation`, kept.

    python benchmarks/diagnosis/meshbook.py [--folder DIR]

Solves the finer meshes: about two minutes of one core.
"""

import os
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.diagnosis.bank import MAIN, case_test, fitted_case
from benchmarks.diagnosis.snapshots import SHORT

import numpy as np

from fe import Lattice
from twin.model.discretisation import Discretisation, SolvedAt, discretisation_error
from twin.model.structure import of_finger, weighed
from twin.targets import Array
from twin.virtual.protocols import TOP
from twin.virtual.truthsolves import DENSITY

FILE = ROOT / "benchmarks" / "data" / "meshes.npz"


def solve_all(folder: Path) -> None:
    """Solve the finer meshes at all places in all directions of gravity, and keep what is needed."""
    folder.mkdir(parents=True, exist_ok=True)

    def keep(stage: str, tasks: Mapping[str, Callable[[], Array]]) -> dict[str, Array]:
        out = {}
        for number, (key, make) in enumerate(tasks.items()):
            path = folder / f"{number:02d}.npy"
            if not path.exists():
                np.save(path, make())
                print(f"{stage}: {path.name}", flush=True)
            out[key] = np.load(path)
        return out

    structure = weighed(of_finger(SHORT, Lattice()), DENSITY)
    at = SolvedAt.beside(MAIN, TOP)
    found = discretisation_error(case_test(fitted_case()), structure=structure, solved_at=at, cache=keep)
    arrays = {f.name: np.asarray(getattr(found, f.name)) for f in fields(found) if f.init}
    FILE.parent.mkdir(exist_ok=True)
    small = {k: v.astype(np.float32) if v.ndim > 2 else v for k, v in arrays.items()}
    np.savez_compressed(FILE, allow_pickle=False, **small)
    print(f"{FILE}: {FILE.stat().st_size / 1e6:.1f} MB")


@lru_cache(maxsize=1)
def _kept() -> dict[str, Any]:
    with np.load(FILE) as data:
        return {
            name: data[name].astype(float) if data[name].dtype.kind == "f" else data[name]
            for name in data.files
        }


def discretisation(rows: tuple[int, ...], heavy: bool) -> Discretisation:
    """The error of the mesh at some places; without weight the mean of upright and upside down."""
    d, at = _kept(), list(rows)
    found = Discretisation(
        names=tuple(map(str, d["names"])), scale=float(d["total"]), grid=d["grid"], gravities=d["gravities"],
        base=d["base"][:, :, at], changes=d["changes"][:, :, :, at], tested=float(d["tested"]),
    )  # fmt: skip
    if heavy:
        return found
    vertical = np.abs(found.gravities[:, 2]) > 0
    return replace(
        found,
        gravities=np.zeros((1, 3)),
        base=found.base[vertical].mean(axis=0, keepdims=True),
        changes=found.changes[:, vertical].mean(axis=1, keepdims=True),
    )


def main() -> int:
    solve_all(options(
        __doc__,
        {
            "--folder": (Path(tempfile.gettempdir()) / "softtwin-meshes", "where solves are kept"),
        },
    ).folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
