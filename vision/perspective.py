"""Place of a camera over the plane of the frame marks, and perspective of places off the plane.

A mark's height is how far its own plane is in front of the frame marks' plane, towards +y.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vision.camera import Array, Camera
from vision.marks import Mark

MOST_FRAMES = 200  # that the viewpoint is the median of


@dataclass(frozen=True)
class Viewpoint:
    """Place of the camera over the plane."""

    foot: Array  # (2,) mm, x and z of the point of the plane right below it
    distance: float  # mm from the plane, positive towards +y


def viewpoint(camera: Camera, homography: Array) -> Viewpoint:
    """Place of a camera that sees the plane under homographies (t,3,3), mm to ideal px.

    H = K [r1 r2 t] up to scale, doi 10.1109/34.888718; the median over the frames, because one frame's six
    marks leave it uncertain by a millimetre or so.

    >>> camera = Camera(np.diag([1000.0, 1000.0, 1.0]), np.zeros(5), (1280, 720))
    >>> homography = np.array([[[-2.0, 0, 100], [0, -2, 40], [0, 0, 1]]])  # 2 px per mm, x to the left, z up
    >>> view = viewpoint(camera, homography)
    >>> view.foot.round(6), round(view.distance, 6)
    (array([50., 20.]), 500.0)
    """
    finite = homography[np.isfinite(homography[:, 0, 0])]
    finite = finite[:: max(len(finite) // MOST_FRAMES, 1)]
    if not len(finite):
        return Viewpoint(np.full(2, np.nan), np.nan)
    columns = np.linalg.inv(camera.matrix) @ finite
    lengths = np.linalg.norm(columns[..., :2], axis=1)
    columns = columns / np.sqrt(lengths[:, 0] * lengths[:, 1])[:, None, None]
    columns = columns * np.sign(columns[:, 2:, 2:])  # the plane lies before the camera
    across = np.cross(columns[..., 0], columns[..., 1])  # ex x ez = -ey
    turn = np.stack([columns[..., 0], columns[..., 1], across], axis=-1)
    u, _, v = np.linalg.svd(turn)
    centre = -np.einsum("tji,tj->ti", u @ v, columns[..., 2])
    x, z, behind = np.median(centre, axis=0)
    return Viewpoint(np.array([x, z]), -float(behind))


def unlike(camera: Camera, homography: Array, nominal: Array) -> Array:
    """Misfit (...,f,2) mm of places (f,2) mm of a plane that homographies (...,3,3) to ideal px hide: to a
    camera of known lens both axes of the plane are of one length and at right angles.

    A homography takes up any stretch and shear of the frame. What of these no motion of the camera makes is a
    misfit of the places, to first order, beside that left by the homography's fit.

    >>> camera = Camera(np.diag([1000.0, 1000.0, 1.0]), np.zeros(5), (1280, 720))
    >>> square = np.array([[-50.0, -50], [50, -50], [50, 50], [-50, 50]])
    >>> unlike(camera, np.array([[2.02, 0, 0], [0, -1.98, 0], [0, 0, 1]]), square).round(3).tolist()[2]
    [0.505, -0.505]
    """
    columns = np.linalg.inv(camera.matrix) @ homography
    x, z = columns[..., :, 0], columns[..., :, 1]
    lengths = np.linalg.norm(x, axis=-1), np.linalg.norm(z, axis=-1)
    stretch, shear = lengths[0] / lengths[1] - 1.0, (x * z).sum(axis=-1) / (lengths[0] * lengths[1])
    (a, b), middle = (0.5 * np.asarray(s)[..., None] for s in (stretch, shear)), nominal.mean(axis=0)
    along, up = (nominal - middle).T
    off = np.stack([a * along + b * up, b * along - a * up], axis=-1)
    rows = np.zeros((2 * len(nominal), 6))
    rows[::2, 0], rows[1::2, 1] = 1.0, 1.0
    rows[::2, 2], rows[1::2, 2], rows[::2, 3], rows[1::2, 3] = along, up, up, -along
    rows[::2, 4], rows[1::2, 4] = along * along, along * up
    rows[::2, 5], rows[1::2, 5] = along * up, up * up
    q = np.linalg.qr(rows / np.linalg.norm(rows, axis=0))[0]
    flat = off.reshape(*off.shape[:-2], -1)
    return np.asarray((flat - flat @ q @ q.T).reshape(off.shape))


def to_own_plane(place: Array, height: Array, view: Viewpoint) -> Array:
    """Places (t,p,2) mm on the marks' own planes, from where their rays meet the frame's plane.

    height: (p,) mm.   Rays meet in the camera: x = foot + (x' - foot) (1 - h / distance), for any tilt.
    """
    return view.foot + (place - view.foot) * (1.0 - height / view.distance)[:, None]


def heights(marks: Sequence[Mark], frame: Sequence[int]) -> Array:
    """Heights (m,) mm of all marks over the plane of the frame marks."""
    y = np.array([mark.position[1] for mark in marks])
    return np.asarray(y - y[list(frame)].mean())


@dataclass(frozen=True, kw_only=True)
class Projection:
    """World to raw pixels and back, while the frame marks are seen under homographies."""

    camera: Camera
    homography: Array  # (t,3,3) frame marks' plane (x, z, 1) mm to ideal px; NaN: not enough marks seen
    view: Viewpoint
    plane_mm: float  # y of the frame marks' plane

    @classmethod
    def of(cls, camera: Camera, homography: Array, marks: Sequence[Mark]) -> "Projection":
        """The projection of a film; marks: those whose frame marks made its homographies."""
        plane = float(np.mean([mark.position[1] for mark in marks if mark.role == "frame"]))
        return cls(camera=camera, homography=homography, view=viewpoint(camera, homography), plane_mm=plane)

    def pixels(self, places: Array, frame: int) -> Array:
        """Raw pixels (n,2) of places (n,3) mm in world axes in one frame; NaN where that has no homography.

        The ray of a place h in front of the plane meets the plane at foot + (x - foot) d / (d - h): the
        reverse of `to_own_plane`, for any tilt.
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
