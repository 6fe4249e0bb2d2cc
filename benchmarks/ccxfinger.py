"""A PneuNet of two chambers that CalculiX has solved, as a program that is not ours: its curve over the
pressure, scaled with the modulus.

Nothing but the pressure loads one Mooney-Rivlin rubber, so its displacements depend on the pressure over the
modulus alone: one job of 20-node reduced elements tells all. The truth's job is on a finer mesh. Jobs are
kept in the system's temporary folder.
"""

import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from fe import Material
from fe.engines.calculix import CalculiX
from fe.engines.engine import over_pressure
from fe.mesh.convert import converted
from twin.bodies.body import Cells
from twin.bodies.pneunet import PneunetTable

Array = NDArray[np.float64]
BODY = PneunetTable(chambers=2, chamber_length_mm=10.0, base_cap_mm=6.0)
EDGE = [name for name in BODY.places if name.startswith("p")]
PLACES = {  # where both meshes have a node
    name: tuple(map(float, BODY.places[name])) for name in (EDGE[0], EDGE[2], "tip")
}
TOP, LEVELS = 0.045, 10  # MPa, of the jobs; increments
SHARE = 0.2  # of the modulus E = 6 (C10 + C01) that C01 has
UNIT = 1.8  # MPa, the E of the jobs
FINE = Cells(along=2, across=1, up=3, wall=1, caps=3)


@lru_cache(maxsize=2)
def curve(fine: bool) -> tuple[Array, Array]:
    """Pressures (k,) MPa and displacements (k, p, 3) mm of PLACES at E = UNIT."""
    kept = Path(tempfile.gettempdir()) / f"softtwin-calculix-{'fine' if fine else 'model'}.npz"
    if kept.exists():
        with np.load(kept) as job:
            return job["pressure"], job["u"]
    material = Material((1 - SHARE) * UNIT / 6, SHARE * UNIT / 6)
    case = converted(BODY.case(FINE if fine else BODY.lattice, material), "C3D20R")
    result = CalculiX().solve(case, TOP, levels=LEVELS)
    if not result.converged:
        raise ValueError(f"CalculiX: {result.reason}")
    pressure, u = over_pressure(result, case, "C3D20R", top=TOP)
    rows = [int(np.linalg.norm(case.nodes - np.array(x), axis=1).argmin()) for x in PLACES.values()]
    np.savez(kept, pressure=pressure, u=u[:, rows])
    return pressure, u[:, rows]


def displaced(values: dict[str, float], pressure: Array, *, parts: int = 100) -> Array:
    """Displacements (s, p, 3) mm at pressures (s,) MPa; parts above 100: of the finer mesh."""
    grid, u = curve(parts > 100)
    return np.asarray(CubicSpline(grid, u)(pressure * UNIT / values["E"]))
