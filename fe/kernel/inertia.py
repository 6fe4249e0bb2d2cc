"""The force of inertia of a time step, as one more force on the nodes, and its tangent."""

import numpy as np
from scipy.sparse import csr_matrix

from fe.element import Array, Integers


class InertiaForces:
    """Forces -M (scale u + ahead) of a mass M on displacements u, as an implicit time step has them.

    dofs (g, k) and blocks (g, k, k) tonne: the mass by groups of degrees of freedom; matrix (3 n, 3 n): all
    of them; nodes (n, 3) mm undeformed; scale in 1/s2; ahead (n, 3) mm/s2.
    """

    def __init__(
        self, dofs: Integers, blocks: Array, matrix: csr_matrix, nodes: Array, *, scale: float, ahead: Array
    ) -> None:
        self.dofs, self._blocks, self._matrix, self._nodes = dofs, blocks, matrix, nodes
        self._scale, self._ahead = scale, ahead

    def of_step(self, scale: float, ahead: Array) -> "InertiaForces":
        """The same mass in another time step."""
        return InertiaForces(
            self.dofs, self._blocks, self._matrix, self._nodes, scale=scale, ahead=np.asarray(ahead, float)
        )

    def force(self, x: Array) -> Array:
        """Forces (n, 3) N at deformed positions x (n, 3) mm."""
        return self.of(self._scale * (x - self._nodes) + self._ahead)

    def of(self, acceleration: Array) -> Array:
        """Forces (n, 3) N of an acceleration (n, 3) mm/s2."""
        return -np.asarray(self._matrix @ acceleration.ravel(), float).reshape(-1, 3)

    def energy(self, velocity: Array) -> float:
        """Kinetic energy in N mm of a velocity (n, 3) mm/s."""
        return float(-0.5 * (self.of(velocity) * velocity).sum())

    def tangent(self, x: Array) -> tuple[Integers, Array]:
        """Degrees of freedom (g, k) and matrices (g, k, k) N/mm, the derivative of minus the forces."""
        del x
        return self.dofs, self._scale * self._blocks
