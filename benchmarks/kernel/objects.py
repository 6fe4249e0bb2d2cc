"""The force of a finger on a rigid object against CalculiX.

    python benchmarks/kernel/objects.py [--quick] [--json]

A short finger bends onto a cylinder, with and without friction, and onto a sphere, up to 0.03 MPa. CalculiX
has the same mesh and elements (C3D20R), the object as held bricks whose faces turn by 5 degrees, and the same
stiffness of contact. object_ccx: the largest difference of the force on the object without friction, of its
size.

CalculiX 2.20 does not end its second increment where contact of surfaces has friction. So friction is
compared in its contact of nodes, which sees the object's facets: friction_ccx is the difference of what
friction adds to the force, of the force, and friction_whole_ccx that of all of it. --quick: the cylinder
without friction alone.
"""

import os
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path as Folder

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import whole
from benchmarks.kernel.convergence import PRESSURE, SHORT, SILICONE

import numpy as np

from fe import Case, Lattice, Path, finger_case, solve
from fe.case import Contact
from fe.deck.calculix import CalculiX
from fe.element import Array
from fe.mesh.convert import converted
from fe.obstacles import Round

MESH = Lattice(per_bellow=2, ring=False, centred=False)
STIFFNESS = 5.0  # MPa/mm
ROD, BALL = Round((38.0, 0.0, -12.0), 10.0, (0.0, 1.0, 0.0)), Round((40.0, 0.0, -12.0), 10.0)
OBJECTS = {
    "cylinder": Contact("outside", ROD, STIFFNESS),
    "sphere": Contact("outside", BALL, STIFFNESS),
    "cylinder, nodes": Contact("outside", ROD, STIFFNESS),
    "cylinder, friction 0.4, nodes": Contact("outside", ROD, STIFFNESS, 0.4),
}
SURFACES, NODES = "TYPE=SURFACE TO SURFACE", "TYPE=NODE TO SURFACE"
PRINTED = "*NODE PRINT, NSET=OBSTACLE_NODES, TOTALS=ONLY\nRF\n"


@dataclass(frozen=True)
class Row:
    """One object: the force on it in N along x and z by this kernel and by CalculiX, and their difference
    over its size."""

    name: str
    ours: tuple[float, float]
    ccx: tuple[float, float]
    difference: float


def compared(case: Case, name: str) -> Row:
    """The force on one object. RuntimeError where one of the two does not converge."""
    lying = replace(converted(case, "C3D20R"), contact=OBJECTS[name])
    found = solve(lying, Path(np.array([0.0, 1.0]), np.array([0.0, PRESSURE]), np.array([1.0])))
    if not found.converged:
        raise RuntimeError(f"{name}: {found.reason}")
    ours, theirs = -found.contact_force[0], 2 * calculix_force(lying, by_nodes="nodes" in name)
    off = float(np.linalg.norm((ours - theirs)[[0, 2]]) / np.linalg.norm(theirs[[0, 2]]))
    return Row(name, (float(ours[0]), float(ours[2])), (float(theirs[0]), float(theirs[2])), off)


def calculix_force(case: Case, *, by_nodes: bool) -> Array:
    """The force (3,) N with which the half finger pushes its object, by CalculiX: what holds the bricks is
    against it."""
    engine = CalculiX()
    text = engine.deck(case, PRESSURE).replace("*NODE FILE\n", PRINTED + "*NODE FILE\n")
    text = text.replace(SURFACES, NODES) if by_nodes else text
    with tempfile.TemporaryDirectory() as scratch:
        found = engine.run(text, folder=Folder(scratch))
        if not found.converged:
            raise RuntimeError(f"CalculiX: {found.reason}")
        told = (Folder(scratch) / "job.dat").read_text(encoding="utf-8").splitlines()
    return -np.array([float(x) for x in [line for line in told if line.strip()][-1].split()])


def friction(rows: dict[str, Row]) -> dict[str, float]:
    """How far what friction adds to the force differs, and the whole force with it."""
    free, held = rows["cylinder, nodes"], rows["cylinder, friction 0.4, nodes"]
    ours, theirs = (np.subtract(getattr(held, who), getattr(free, who)) for who in ("ours", "ccx"))
    off = float(np.linalg.norm(ours - theirs) / np.linalg.norm(held.ccx))
    return {"friction_ccx": off, "friction_whole_ccx": held.difference}


def objects(quick: bool) -> dict[str, object]:
    """The largest difference, that of friction, and a table, which is printed."""
    case = finger_case(SILICONE, finger=SHORT, lattice=MESH)
    rows = {name: compared(case, name) for name in list(OBJECTS)[: 1 if quick else None]}
    print(f"{'object':<32}{'ours x, z, N':>20}{'CalculiX':>20}{'apart':>8}")
    for r in rows.values():
        forces = "".join(f"{f'{x:.4f}, {z:.4f}':>20}" for x, z in (r.ours, r.ccx))
        print(f"{r.name:<32}{forces}{r.difference:>8.2%}")
    free = max(r.difference for name, r in rows.items() if "nodes" not in name)
    own: dict[str, object] = {"object_ccx": free, "objects": [asdict(r) for r in rows.values()]}
    return own if quick else own | friction(rows)


if __name__ == "__main__":
    sys.exit(whole(__doc__, objects, quick="the cylinder without friction alone"))
