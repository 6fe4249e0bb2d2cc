"""How far a marker's centre may be off where its picture is not the printed pattern, blurred: covariances.

Light, sharpening in the camera and a print that is not flat leave a residual that is alike over many pixels.
White noise of its size would average out over them; it does not.
"""

import numpy as np

from vision.camera import Array
from vision.following.registration import Templates

BLOCKS = 6  # along a marker's side: a block is about as wide as its cells, over which residuals are alike
# Distance of a print from the plane that it should lie in, 1 sd in sides of the marker: 0.1 mm for 40 mm. It
# moves a centre only where the marker is seen at an angle. Real boards: 0.27 % and 0.3 to 0.4 %.
OFF_PLANE = 0.003


def misfit_covariance(reference: Templates, grey: Array, linear: Array) -> Array:
    """Covariance (p,2,2) px2 of the centres from residuals that are alike within blocks of the patch.

    grey: (p,n) what the picture shows under the patches.   linear: (p,2,2) px per local unit at the centre.

    Each of 6 x 6 blocks moves the centre by the sum of its residuals' pulls; their squares are added (the
    sandwich of White, doi 10.2307/1912934, by blocks).
    """
    flat = grey - grey.mean(axis=1, keepdims=True)
    flat = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    residual = flat - np.sum(flat * reference.grey, axis=1, keepdims=True) * reference.grey
    pull = residual[..., None] * reference.step[..., [2, 5]]
    side = round(float(np.sqrt(reference.grid.shape[1])))
    along = np.arange(side) * BLOCKS // side
    block = np.eye(BLOCKS**2)[(BLOCKS * along[:, None] + along).ravel()]
    moves = np.einsum("pnk,nb,pjk->pbj", pull, block, linear)
    return np.asarray(np.einsum("pbi,pbj->pij", moves, moves))


def print_covariance(linear: Array) -> Array:
    """Covariance (p,2,2) px2 of the centres for prints that lie off their plane, as far as the view shows it.

    linear: (p,2,2) px per local unit at the centre, half a side being the unit. A normal of length 1 is seen
    along the shorter axis, with a length of sqrt(longer^2 - shorter^2).
    """
    axes, size, _ = np.linalg.svd(linear)
    seen = np.sqrt(np.maximum(size[:, 0] ** 2 - size[:, 1] ** 2, 0.0))
    shift = 2.0 * OFF_PLANE * seen[:, None] * axes[:, :, 1]
    return np.asarray(shift[:, :, None] * shift[:, None])


def larger(one: Array, other: Array) -> Array:
    """The larger (p,2,2) of two covariances each, by their traces."""
    first = np.trace(one, axis1=1, axis2=2) >= np.trace(other, axis1=1, axis2=2)
    return np.where(first[:, None, None], one, other)
