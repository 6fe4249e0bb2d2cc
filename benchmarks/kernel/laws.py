"""Every law of the silicone: its derivatives against its energy, and its finger against CalculiX.

    python benchmarks/kernel/laws.py [--json]

derivative_error: of the kernel's stress and tangent at random deformations, against differences of the
energy that the law states in one line, over the shear modulus. ccx_difference: of the tip of a finger of one
bellow, in elements C3D20R, between this kernel and CalculiX on the same nodes, over the tip's way; null where
CalculiX does not know the law, as Gent's, or is not installed.
"""

import json
import os
import sys

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options

import numpy as np

from fe import Path, solve
from fe.deck.calculix import CalculiX
from fe.element import Array
from fe.mesh.convert import converted
from tests.fe.lawpoints import stress, tangent
from twin.contract.specimen import COARSE, SMALL
from twin.laws.catalogue import LAWS
from twin.laws.law import Constants, RubberLaw
from twin.model.structure import base_case

POINTS, SEED = 20, 1
STEP = 1e-5  # of F, of central differences
REACH = 0.12  # pressure over the scale, MPa / MPa, to which the finger is blown up
TIP = "tip_face"


def felt(law: RubberLaw) -> Constants:
    """Constants at which every term counts."""
    return law.of({p.name: (p.start or 0.0) + 0.5 * p.step for p in law.parameters})


def energy(c: Constants, F: Array) -> Array:
    """W (n,) MPa of the law's own line at F (n, 3, 3), at constant volume; complex where F is."""
    C = np.swapaxes(F, 1, 2) @ F
    C = C / np.linalg.det(F)[:, None, None] ** (2 / 3)
    I1 = np.trace(C, axis1=1, axis2=2)
    I2 = (I1**2 - np.trace(C @ C, axis1=1, axis2=2)) / 2
    # of a complex C, which is real but for a complex step, by the general solver
    squares = np.linalg.eigvals(C) if np.iscomplexobj(C) else np.linalg.eigvalsh(C)
    return np.asarray(c.law.energy(c.named, I1, I2, np.sqrt(squares)))


def derivative_error(law: RubberLaw) -> float:
    """The largest error of stress and tangent over the shear modulus at rest."""
    c = felt(law)
    F = np.eye(3) + np.random.default_rng(SEED).uniform(-0.25, 0.25, (POINTS, 3, 3))
    P, A, worst = stress(F, c.material)[0], tangent(F, c.material, np.zeros(POINTS), np.ones(POINTS)), 0.0
    for i, k in np.ndindex(3, 3):
        d = np.zeros((3, 3))
        d[i, k] = STEP
        slope = (energy(c, F + d) - energy(c, F - d)) / (2 * STEP)
        curve = (stress(F + d, c.material)[0] - stress(F - d, c.material)[0]) / (2 * STEP)
        worst = max(worst, np.abs(slope - P[:, i, k]).max(), np.abs(curve - A[:, :, :, i, k]).max())
    return float(worst / c.material.shear)


def ccx_difference(law: RubberLaw) -> float | None:
    """The difference of the tip's ways over the way itself; None where CalculiX does not know the law."""
    c = felt(law)
    case = converted(base_case(finger=SMALL, lattice=COARSE).with_material(**c.terms), "C3D20RH")
    top, row = REACH * c.scale, int(case.node_sets[TIP][0])
    try:
        theirs = CalculiX().solve(case, top)
    except (FileNotFoundError, ValueError):  # not installed; no such law
        return None
    ours = solve(case, Path(np.array([0.0, 1.0]), np.array([0.0, top]), np.array([1.0])))
    if not (theirs.converged and ours.converged):
        raise RuntimeError(f"{law.name}: CalculiX {theirs.reason}; this kernel {ours.reason}")
    u, v = ours.at(case.nodes[row][None])[0, 0], theirs.at(int(case.labels[row]))
    return float(np.linalg.norm(u - v) / np.linalg.norm(u))


def measured() -> dict[str, dict[str, float | None]]:
    """Both errors of each law, by its name."""
    return {
        name: {"derivative_error": derivative_error(law), "ccx_difference": ccx_difference(law)}
        for name, law in LAWS.items()
    }


if __name__ == "__main__":
    asked = options(__doc__, json="print JSON")
    found = measured()
    if asked.json:
        print(json.dumps(found, indent=1))
    else:
        for name, row in found.items():
            ccx = "-" if row["ccx_difference"] is None else f"{row['ccx_difference']:.2e}"
            print(f"{name:14} derivatives {row['derivative_error']:.1e}   CalculiX {ccx}")
