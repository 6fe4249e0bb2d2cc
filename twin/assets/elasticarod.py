"""A calibrated soft finger as a Cosserat rod of PyElastica: mm, tonne, s, N, MPa.

    python finger_pyelastica.py 0.01 0.02     tips at these pressures in MPa

It reads rod.json from its own folder. The pressure turns and stretches the rod's own rest shape, and sets
its bending stiffness. The first element is the clamp. Bending across the plane and torsion are as stiff as
bending in it, and shear as stretching; none of the three was calibrated.
"""

import json
import sys
from pathlib import Path

import elastica as ea
import numpy as np
from numpy.typing import NDArray

COURANT = 0.4  # of the time in which the fastest wave crosses an element
WINDOWS, STILL = 100, 1e-3  # of a damping time, and mm in one by which a finger at rest still moves


class ElasticSystem(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
    """A system with supports, forces and damping."""


class ElasticFinger:
    """The rod of a rod.json, n links and the clamp before them."""

    def __init__(self, folder: Path) -> None:
        data = json.loads((folder / "rod.json").read_text(encoding="utf-8"))
        for name, value in data.items():
            if isinstance(value, list):
                setattr(self, name, np.array(value, float))
        self.settling = float(data["settling"])

    pressure: NDArray[np.float64]
    rest: NDArray[np.float64]
    bend: NDArray[np.float64]
    length: NDArray[np.float64]
    bend_stiffness: NDArray[np.float64]
    pull_stiffness: NDArray[np.float64]
    mass: NDArray[np.float64]

    def between(self, table: NDArray[np.float64], pressure: float) -> NDArray[np.float64]:
        """A row (n,) of a table (k, n) at a pressure in MPa, linear in between."""
        return np.array([np.interp(pressure, self.pressure, column) for column in table.T])

    def made(self) -> ea.CosseratRod:
        """The rod at rest."""
        first = self.rest[1] - self.rest[0]
        nodes = np.concatenate([self.rest[:1] - first, self.rest]).T  # (3, n + 2)
        length = np.linalg.norm(np.diff(nodes, axis=1), axis=0)
        volume = self.mass.sum() / 1e-9
        rod = ea.CosseratRod.straight_rod(
            len(length), nodes[:, 0], first / np.linalg.norm(first), np.array([0.0, 1.0, 0.0]),
            float(length.sum()), float(np.sqrt(volume / length[1:].sum() / np.pi)), 1e-9,
            youngs_modulus=float(np.mean(self.pull_stiffness * length[1:]) / volume * length[1:].sum()),
            position=nodes,
        )  # fmt: skip
        stretching = np.append(self.pull_stiffness[0], self.pull_stiffness) * length
        rod.shear_matrix[:] = np.eye(3)[:, :, None] * stretching
        return rod

    def press(self, rod: ea.CosseratRod, pressure: float) -> None:
        """Gives a rod the rest shape and the stiffness that it has under a pressure in MPa."""
        bend, stiffness = (self.between(x, pressure) for x in (self.bend, self.bend_stiffness))
        rod.rest_kappa[0] = bend / rod.rest_voronoi_lengths  # about y, the first director
        rod.rest_sigma[2, 1:] = self.between(self.length, pressure) / self.length[0] - 1
        rod.bend_matrix[:] = np.eye(3)[:, :, None] * stiffness * rod.rest_voronoi_lengths


def tips(folder: Path, pressures: NDArray[np.float64], force: float = 0.0) -> NDArray[np.float64]:
    """Displacements (k, 3) mm of the tip at rest under pressures (k,) MPa, with a force in N up there."""
    return np.array([_tip(ElasticFinger(folder), float(p), force) for p in pressures])


def _tip(finger: ElasticFinger, pressure: float, force: float) -> NDArray[np.float64]:
    rod, system = finger.made(), ElasticSystem()
    finger.press(rod, pressure)
    system.append(rod)
    system.constrain(rod).using(
        ea.FixedConstraint, constrained_position_idx=(0, 1), constrained_director_idx=(0,)
    )
    up = np.array([0.0, 0.0, force])
    system.add_forcing_to(rod).using(ea.EndpointForces, 0 * up, up, ramp_up_time=finger.settling)
    inertia = rod.mass_second_moment_of_inertia[0, 0][1:] / rod.lengths[1:]
    stiff = rod.shear_matrix[2, 2].max()
    fastest = max(
        stiff / (rod.rest_lengths * rod.mass[1:]).min(), stiff * rod.rest_lengths.max() / inertia.min(),
        (rod.bend_matrix[0, 0] / rod.rest_voronoi_lengths).max() / inertia.min(),
    )  # of the squares of frequencies: along, shear, bending
    step = COURANT / float(np.sqrt(fastest))
    system.dampen(rod).using(
        ea.AnalyticalLinearDamper, uniform_damping_constant=2 / finger.settling, time_step=step
    )
    system.finalize()
    stepper, time, before = ea.PositionVerlet(), np.float64(0.0), rod.position_collection[:, -1].copy()
    for _ in range(WINDOWS):
        for _ in range(int(np.ceil(finger.settling / step))):
            time = stepper.step(system, time, np.float64(step))
        after = rod.position_collection[:, -1].copy()
        if np.abs(after - before).max() < STILL:
            break
        before = after
    return np.asarray(after - finger.rest[-1])


if __name__ == "__main__":
    asked = [float(x) for x in sys.argv[1:]]
    for p, u in zip(asked, tips(Path(__file__).parent, np.array(asked)), strict=True):
        print(f"{1e3 * p:.3g} kPa: tip {u[0]:.3f}, {u[1]:.3f}, {u[2]:.3f} mm")
