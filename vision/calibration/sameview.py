"""Whether a camera that was calibrated for one film still fits another film of the same rig."""

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Camera
from vision.plane import fit_homography


def view_misfit(camera: Camera, then: Array, now: Array, *, defines: NDArray[np.bool_]) -> float:
    """How far the markers of a flat rig lie from where the camera would see them, rms in px.

    then, now: their centres (m,2) in the two films, raw px, in one order.   defines: (m,) which of them
    define the view, 4 or more; the others are tested, 1 or more.

    A pinhole camera sees a plane from two places in pictures that a homography maps onto each other exactly.
    With the wrong lens (another focus or zoom) something is left, and so it is where a marker was moved.
    """
    a, b = camera.undistort(then), camera.undistort(now)
    if defines.sum() < 4 or defines.all():
        raise ValueError(
            f"{int(defines.sum())} of {len(defines)} markers define the view; wanted 4 or more of them, and "
            "others to test it by"
        )
    foretold = camera.distort(_mapped(fit_homography(a[defines], b[defines]), a[~defines]))
    return float(np.sqrt(((foretold - now[~defines]) ** 2).sum(axis=1).mean()))


def _mapped(homography: Array, points: Array) -> Array:
    """Points (m,2) under a homography (3,3)."""
    out = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return np.asarray(out[:, :2] / out[:, 2:])
