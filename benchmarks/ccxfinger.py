"""A PneuNet of two chambers that CalculiX has solved, as a program that is not ours: its curve over the
pressure, scaled with the modulus.

Nothing but the pressure loads one Mooney-Rivlin rubber, so its displacements depend on the pressure over the
modulus alone: one job of 20-node reduced elements tells all. The truth's job is on a finer mesh, and the roof
of its last chamber may be thinner. Jobs are kept in the system's temporary folder.
"""

import tempfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from fe import Case, Material
from fe.engines.calculix import CalculiX
from fe.engines.engine import over_pressure
from fe.mesh.convert import converted
from twin.bodies.body import Cells
from twin.bodies.pneunet import PneunetTable
from twin.calibrated.actuators import Actuator, pneunet

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


@lru_cache(maxsize=8)
def curve(fine: bool, thinner: float = 0.0) -> tuple[Array, Array]:
    """Pressures (k,) MPa and displacements (k, p, 3) mm of PLACES at E = UNIT; thinner: by how many mm
    the roof of the last chamber is."""
    name = f"{'fine' if fine else 'model'}{f'-{thinner:g}' if thinner else ''}"
    kept = Path(tempfile.gettempdir()) / f"softtwin-calculix-{name}.npz"
    if kept.exists():
        with np.load(kept) as job:
            return job["pressure"], job["u"]
    material = Material((1 - SHARE) * UNIT / 6, SHARE * UNIT / 6)
    case = BODY.case(FINE if fine else BODY.lattice, material)
    if thinner:
        case = roofed(case, thinner)
    case = converted(case, "C3D20R")
    result = CalculiX().solve(case, TOP, levels=LEVELS)
    if not result.converged:
        raise ValueError(f"CalculiX: {result.reason}")
    pressure, u = over_pressure(result, case, "C3D20R", top=TOP)
    rows = [int(np.linalg.norm(case.nodes - np.array(x), axis=1).argmin()) for x in PLACES.values()]
    np.savez(kept, pressure=pressure, u=u[:, rows])
    return pressure, u[:, rows]


def roofed(case: Case, thinner: float) -> Case:
    """The case whose last chamber is higher inside by so many mm; nodes in its roof move in proportion."""
    inner, (x, z) = BODY.height_mm - BODY.top_wall_mm, case.nodes[:, ::2].T
    last = x > case.nodes[case.face_nodes("chamber"), 0].max() - BODY.chamber_length_mm - 1e-6
    share = (BODY.height_mm - z) / BODY.top_wall_mm * (last & (z > inner - 1e-6))
    nodes = case.nodes.copy()
    nodes[:, 2] += thinner * share
    return replace(case, nodes=nodes)


def displaced(
    values: dict[str, float], pressure: Array, *, parts: int = 100, thinner: float = 0.0
) -> Array:
    """Displacements (s, p, 3) mm at pressures (s,) MPa; parts above 100: of the finer mesh."""
    grid, u = curve(parts > 100, thinner)
    return np.asarray(CubicSpline(grid, u)(pressure * UNIT / values["E"]))


def like() -> Actuator:
    """A model of ours of a like body, whose silicone and elements are others."""
    size = {"chambers": BODY.chambers, "chamber_length_mm": BODY.chamber_length_mm}
    return pneunet(**size, base_cap_mm=BODY.base_cap_mm, law="neo-hooke", mesh_error=False)
