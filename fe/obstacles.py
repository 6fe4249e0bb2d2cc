"""The shapes of rigid obstacles: how far a place is from one, which way is out, and how that way turns."""

from dataclasses import dataclass

import numpy as np

from fe.element import Array


@dataclass(frozen=True)
class Flat:
    """All that lies behind a plane: `distance` mm from the origin along `normal` (3,), which points to the
    body's side."""

    normal: tuple[float, float, float]
    distance: float

    @property
    def out(self) -> Array:
        """The normal (3,) of length 1."""
        return np.asarray(self.normal, float) / np.linalg.norm(self.normal)

    def height(self, place: Array) -> Array:
        """The distance (..., ) mm of places (..., 3) mm from its surface, below 0 inside."""
        return np.asarray(place @ self.out - self.distance, float)

    def even(self, y: float) -> bool:
        """Whether it is its own image across the plane y in mm."""
        del y
        return self.normal[1] == 0


@dataclass(frozen=True)
class Round:
    """A sphere of `radius` mm about `centre` (3,) mm, or with an `axis` (3,) through it a cylinder without
    ends."""

    centre: tuple[float, float, float]
    radius: float
    axis: tuple[float, float, float] | None = None

    @property
    def across(self) -> Array:
        """The projection (3, 3) on what is across the axis: of a sphere the identity."""
        if self.axis is None:
            return np.eye(3)
        a = np.asarray(self.axis, float) / np.linalg.norm(self.axis)
        return np.eye(3) - np.outer(a, a)

    def height(self, place: Array) -> Array:
        """The distance (..., ) mm of places (..., 3) mm from its surface, below 0 inside."""
        return np.asarray(self._arm(place)[1][..., 0] - self.radius)

    def normal(self, place: Array) -> Array:
        """The way out (..., 3), of length 1, at places (..., 3) mm."""
        arm, length = self._arm(place)
        return np.asarray(arm / length)

    def bend(self, place: Array) -> Array:
        """The derivative (..., 3, 3) 1/mm of `normal` to the place: (across - normal normal^T) / r, r being
        the distance from the centre or the axis."""
        arm, length = self._arm(place)
        n = arm / length
        return np.asarray((self.across - n[..., :, None] * n[..., None, :]) / length[..., None])

    def even(self, y: float) -> bool:
        """Whether it is its own image across the plane y in mm."""
        if self.axis is None or self.axis[1] == 0:
            return self.centre[1] == y
        return self.axis[0] == self.axis[2] == 0

    def _arm(self, place: Array) -> tuple[Array, Array]:
        """The way (..., 3) mm from centre or axis to places, and its length (..., 1)."""
        arm = (place - np.asarray(self.centre, float)) @ self.across
        return arm, np.maximum(np.linalg.norm(arm, axis=-1, keepdims=True), 1e-12)


Obstacle = Flat | Round

