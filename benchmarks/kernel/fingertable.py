"""Solves the load paths and finer meshes of the built-in finger and of the quick demo's, and writes them into
the package.

    python benchmarks/kernel/fingertable.py [--only default | quick]    writes twin/model/fingertable*.npz

in about five minutes and one. To be run where tests/twin/model/test_twin_fingertable.py says that a mesh or a
law has changed.
"""

import os
import sys
import time

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options

import numpy as np

from fe import Path, Solution, solve
from twin import files
from twin.laws.mooneyrivlin import NOMINAL
from twin.model import fingertable
from twin.model.arraycache import no_cache
from twin.model.fingertable import FILES, FieldSums, KnownFinger
from twin.model.loadpaths import LEVELS, load_paths
from twin.model.structure import BuiltIn, Structure, of_finger
from twin.project.folder import Project, dataset

SAMPLES = 48  # reduced pressures of a finer mesh
WITHIN = 2e-5  # mm


def main() -> None:
    typed = options(__doc__, {"--only": {"choices": tuple(FILES), "help": "this finger alone"}})
    for name in (typed.only,) if typed.only else FILES:
        path = files.Path(fingertable.__file__).with_name(FILES[name])
        np.savez_compressed(path, **solved(structure(name)).arrays())
        print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB")


def structure(name: str) -> Structure:
    """The structure of a finger of FILES: the default one, or that of a data set of this name."""
    table = None if name == "default" else Project.open(dataset(name)).config.model.finger
    own = BuiltIn() if table is None else BuiltIn.of(table.finger)
    return of_finger(own.finger, own.lattice)


def solved(structure: Structure) -> KnownFinger:
    """The table of a structure."""
    began, outer = time.process_time(), np.unique(structure.outside)
    own = load_paths(structure.case, structure.case.nodes[outer], cache=no_cache, key=structure.key)
    print(f"load paths: to {own.reached.min():.3f}, {time.process_time() - began:.0f} s", flush=True)
    meshes = {"base": structure.base, **structure.finer}
    fine, solutions = np.linspace(0, own.reached.min(), SAMPLES), {}
    for name, mesh in meshes.items():
        load = fine * NOMINAL.scale
        case = mesh.build().with_material(**NOMINAL.named)
        solutions[mesh.key] = found = solve(case, Path(load, load, load), count=LEVELS)
        fine = fine[load <= found.reached * (1 + 1e-9)]
        print(f"{name}: to {fine[-1]:.3f}, {time.process_time() - began:.0f} s", flush=True)
    fields = {key: surface(found, len(fine)) for key, found in solutions.items()}
    paths = FieldSums.of(outer, own.u, WITHIN)
    print(f"fields: {[f.basis.shape[:2] for f in (paths, *fields.values())]}")
    return KnownFinger(structure.key, own.nodes[0], own.reduced, own.reached, fine, paths, fields)


def surface(found: Solution, count: int) -> FieldSums:
    """The first so many states of a solution, at its outer nodes."""
    outer = np.unique(found.case.face_nodes("outside"))
    return FieldSums.of(outer, found.fields(range(count))[:, outer], WITHIN)


if __name__ == "__main__":
    main()
