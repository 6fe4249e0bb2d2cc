"""Rigid obstacles: signed distance, outward normal, and curvature."""

from dataclasses import dataclass

import numpy as np

from fe.element import Array


@dataclass(frozen=True)
class Flat:
    """Half space behind a plane at `distance` mm from the origin along its normal (3,), which points to the
    body."""

    normal: tuple[float, float, float]
    distance: float

    @property
    def out(self) -> Array:
        """Unit normal (3,)."""
        return np.asarray(self.normal, float) / np.linalg.norm(self.normal)

    def height(self, place: Array) -> Array:
        """Signed distance (...,) mm of points (..., 3) mm from the plane, negative inside the obstacle.

        >>> Flat((0.0, 0.0, 1.0), -2.0).height(np.array([[0.0, 0.0, 3.0], [5.0, 0.0, -3.0]]))
        array([ 5., -1.])
        """
        return np.asarray(place @ self.out - self.distance, float)

    def even(self, y: float) -> bool:
        """True if the obstacle is symmetric about the plane y in mm."""
        del y
        return self.normal[1] == 0


@dataclass(frozen=True)
class Round:
    """Sphere of `radius` mm about `centre` (3,) mm, or with an `axis` (3,) an infinite cylinder."""

    centre: tuple[float, float, float]
    radius: float
    axis: tuple[float, float, float] | None = None

    @property
    def across(self) -> Array:
        """Projection (3, 3) normal to the axis; of a sphere the identity."""
        if self.axis is None:
            return np.eye(3)
        a = np.asarray(self.axis, float) / np.linalg.norm(self.axis)
        return np.eye(3) - np.outer(a, a)

    def height(self, place: Array) -> Array:
        """Signed distance (...,) mm of points (..., 3) mm from the surface, negative inside the obstacle.

        >>> Round((0.0, 0.0, 0.0), 2.0, axis=(0.0, 1.0, 0.0)).height(np.array([3.0, 7.0, 4.0])).item()
        3.0
        """
        return np.asarray(self._arm(place)[1][..., 0] - self.radius)

    def normal(self, place: Array) -> Array:
        """Outward unit normal (..., 3) at points (..., 3) mm."""
        arm, length = self._arm(place)
        return np.asarray(arm / length)

    def bend(self, place: Array) -> Array:
        """Derivative (..., 3, 3) 1/mm of `normal` by the position: (across - normal normal^T) / r, with r the
        distance from the centre or the axis."""
        arm, length = self._arm(place)
        n = arm / length
        return np.asarray((self.across - n[..., :, None] * n[..., None, :]) / length[..., None])

    def even(self, y: float) -> bool:
        """True if the obstacle is symmetric about the plane y in mm."""
        if self.axis is None or self.axis[1] == 0:
            return self.centre[1] == y
        return self.axis[0] == self.axis[2] == 0

    def _arm(self, place: Array) -> tuple[Array, Array]:
        """Vector (..., 3) mm from centre or axis to points, and its length (..., 1)."""
        arm = (place - np.asarray(self.centre, float)) @ self.across
        return arm, np.maximum(np.linalg.norm(arm, axis=-1, keepdims=True), 1e-12)


Obstacle = Flat | Round

