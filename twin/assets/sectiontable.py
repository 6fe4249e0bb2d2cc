"""The rod as a plain table: curvature, stretch and stiffness of every section against the pressure."""

import numpy as np

from twin.assets.rod import Rod
from twin.table import DataTable
from twin.targets import Array

COLUMNS = (
    "pressure_MPa", "section", "x_mm", "bend_rad", "curvature_per_mm", "length_mm", "stretch",
    "bend_stiffness_Nmm_per_rad", "pull_stiffness_N_per_mm",
)  # fmt: skip


def written(rod: Rod) -> dict[str, str]:
    """The texts of sections.csv, a row a pressure and section, and rod.json by name."""
    n, rest = len(rod.mass), rod.length[0]
    rows = [
        [p, k + 1, rod.rest[k, 0], rod.bend[i, k], rod.bend[i, k] / rest[k], rod.length[i, k],
         rod.length[i, k] / rest[k], rod.bend_stiffness[i, k], rod.pull_stiffness[k]]
        for i, p in enumerate(rod.pressure) for k in range(n)
    ]  # fmt: skip
    return {"sections.csv": DataTable(list(COLUMNS), rows).csv(digits=8), "rod.json": rod.json()}


def tips(rod: Rod, pressures: Array, force: float = 0.0) -> Array:
    """Displacements (k, 3) mm of the tip at pressures (k,) MPa under a force in N up, as the table says."""
    return np.array([rod.tip(float(p), force) for p in pressures])
