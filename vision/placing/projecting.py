"""Where a camera sees places in space: the reverse of `flat`, for what is drawn over the film."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vision.camera import Array, Camera
from vision.marks import Mark
from vision.placing.depth import Viewpoint, viewpoint


@dataclass(frozen=True, kw_only=True)
class Projection:
    """How the camera sees the world while its frame marks are seen under homographies."""

    camera: Camera
    homography: Array  # (t,3,3) frame marks' plane (x, z, 1) mm to ideal px; NaN: not enough marks seen
    view: Viewpoint
    plane_mm: float  # y of the frame marks' plane

    @classmethod
    def of(cls, camera: Camera, homography: Array, marks: Sequence[Mark]) -> "Projection":
        """The projection of a film; marks: those whose frame marks made its homographies."""
        plane = float(np.mean([mark.position[1] for mark in marks if mark.role == "frame"]))
        return cls(
            camera=camera,
            homography=homography,
            view=viewpoint(camera, homography),
            plane_mm=plane,
        )

    def pixels(self, places: Array, frame: int) -> Array:
        """Raw pixels (n,2) of places (n,3) mm in world axes in one frame; NaN where that has no homography.

        The ray of a place h in front of the plane meets the plane at foot + (x - foot) d / (d - h): the
        reverse of `depth.to_own_plane`, for any tilt.
        """
        stretch = self.view.distance / (self.view.distance - (places[:, 1] - self.plane_mm))
        foot = self.view.foot
        on_plane = foot + (places[:, [0, 2]] - foot) * stretch[:, None]
        mapped = np.column_stack([on_plane, np.ones(len(on_plane))]) @ self.homography[frame].T
        return self.camera.distort(mapped[:, :2] / mapped[:, 2:])

    def places(self, pixels: Array, frame: int, *, y_mm: Array) -> Array:
        """Places (n,3) mm in world axes, at y (n,) mm, of raw pixels (n,2) in one frame."""
        ideal = self.camera.undistort(pixels)
        mapped = np.column_stack([ideal, np.ones(len(ideal))]) @ np.linalg.inv(self.homography[frame]).T
        shrink = 1.0 - (y_mm - self.plane_mm) / self.view.distance
        x, z = (self.view.foot + (mapped[:, :2] / mapped[:, 2:] - self.view.foot) * shrink[:, None]).T
        return np.stack([x, np.broadcast_to(y_mm, x.shape), z], axis=1)
