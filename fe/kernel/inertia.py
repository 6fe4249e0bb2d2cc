"""The force of inertia of a time step, as one more force on the nodes, and its tangent."""

from dataclasses import dataclass, replace

import numpy as np

from fe.element import Array, Integers, scatter


@dataclass(frozen=True, eq=False)
class InertiaForces:
    """Forces -M (scale u + ahead) of a mass M on displacements u, as an implicit time step has them.

    dofs (g, k) and blocks (g, k, k) tonne: the mass by groups of degrees of freedom; nodes (n, 3) mm
    undeformed; scale in 1/s2; ahead (n, 3) mm/s2.
    """

    dofs: Integers
    blocks: Array
    nodes: Array
    scale: float
    ahead: Array

    def of_step(self, scale: float, ahead: Array) -> "InertiaForces":
        """The same mass in another time step."""
        return replace(self, scale=scale, ahead=np.asarray(ahead, float))

    def force(self, x: Array) -> Array:
        """Forces (n, 3) N at deformed positions x (n, 3) mm."""
        return self.of(self.scale * (x - self.nodes) + self.ahead)

    def of(self, acceleration: Array) -> Array:
        """Forces (n, 3) N of an acceleration (n, 3) mm/s2."""
        parts = (self.blocks @ acceleration.ravel()[self.dofs][..., None])[..., 0]
        return -scatter(self.dofs, parts, acceleration.size).reshape(-1, 3)

    def energy(self, velocity: Array) -> float:
        """Kinetic energy in N mm of a velocity (n, 3) mm/s."""
        return float(-0.5 * (self.of(velocity) * velocity).sum())

    def tangent(self, x: Array) -> tuple[Integers, Array]:
        """Degrees of freedom (g, k) and matrices (g, k, k) N/mm, the derivative of minus the forces."""
        del x
        return self.dofs, self.scale * self.blocks
