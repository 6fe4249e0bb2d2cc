"""How far off linear tetrahedra are: they cannot bend, nor keep their volume, without being too stiff."""

import numpy as np

from fe import Case
from fe.engines.engine import Embedded
from fe.mesh.refine import enriched

SMALL = 1e-3  # of the shear modulus: a pressure at which the structure is linear
LARGEST = 10_000  # nodes of a mesh of linear tetrahedra of which the quadratic one is solved: 80,000 there


def stiffness_doubt(case: Case) -> str:
    """A sentence on how much less a mesh of 4-node tetrahedra moves than the same one with 10-node ones, ""
    for other elements."""
    if len(case.element.local) != 4:
        return ""
    told = f"Its linear tetrahedra ({case.element.name}) are too stiff for rubber"
    if len(case.nodes) > LARGEST:
        return f"{told}. Mesh it with C3D10H."
    pressure = SMALL * min(m.shear for m in case.materials.values())
    moved = [
        float(np.abs(found.u[: len(case.nodes)]).max()) if found.converged else np.nan
        for found in (Embedded().solve(c, pressure) for c in (case, enriched(case)))
    ]
    share = 1 - moved[0] / moved[1]
    if not np.isfinite(share):
        return f"{told}. Mesh it with C3D10H."
    return (
        f"{told}: at a small pressure they move {100 * share:.0f} % less than 10-node ones on the same mesh. "
        "Mesh it with C3D10H."
    )
