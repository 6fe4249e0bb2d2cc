"""Marker patches in, sub-pixel homographies out: inverse-compositional Gauss-Newton on grey levels.

A patch lives in local coordinates: the printed mark is the square (-1..1)^2, x to the right and y down in
its own upright picture. A warp (3,3) takes local coordinates to ideal (undistorted) pixels.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
ToPixels = Callable[[Array], Array]

_POLE = np.sqrt(3.0) - 2.0
# Impulse response of the cubic B-spline prefilter (Unser 1999, doi 10.1109/79.799930), 1e-5 at its cut ends.
_PREFILTER = np.array([np.sqrt(3.0) * _POLE ** abs(k) for k in range(-8, 9)])
MAX_ITERATIONS = 20
CONVERGED_PX = 0.002


@dataclass(frozen=True)
class Templates:
    """Reference patches of p marks on one local grid, ready for Gauss-Newton steps."""

    grid: Array  # (3,n) local homogeneous coordinates of the patch points
    grey: Array  # (p,n) grey levels with mean 0 and norm 1
    step: Array  # (p,8,n) takes a grey difference (of norm-1 patches) to the eight warp parameters
    covariance: Array  # (p,8,8) of the parameters for a difference of unit variance per point


def spline(image: Image | NDArray[np.float32]) -> NDArray[np.float32]:
    """Cubic B-spline coefficients (h,w) of a picture (h,w)."""
    return cv2.sepFilter2D(
        image, cv2.CV_32F, _PREFILTER, _PREFILTER, borderType=cv2.BORDER_REFLECT_101
    ).astype(np.float32, copy=False)


def local_grid(points: int, half: float) -> Array:
    """Regular local grid (3, points^2), row by row, that reaches from -half to half."""
    axis = np.linspace(-half, half, points)
    y, x = np.meshgrid(axis, axis, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.ones(points * points)])


def project(warp: Array, local: Array) -> Array:
    """Where warps (...,3,3) take homogeneous local points (3,n): ideal pixels (...,n,2)."""
    mapped = warp @ local
    return np.stack([mapped[..., 0, :], mapped[..., 1, :]], axis=-1) / mapped[..., 2, :, None]


def sample(coefficients: NDArray[np.float32], pixels: Array) -> Array:
    """Grey levels of the spline picture at pixels (...,2) (x, y); points outside take the nearest edge."""
    return map_coordinates(
        coefficients,
        [pixels[..., 1], pixels[..., 0]],
        output=np.float64,
        order=3,
        mode="nearest",
        prefilter=False,
    )


def patches(
    coefficients: NDArray[np.float32], to_pixels: ToPixels, warp: Array, grid: Array, delta: float
) -> Array:
    """Grey levels (p,3,n) at the warped grid and their local derivatives in x and y (central, step delta)."""
    shifts = np.array([[0.0, 0.0], [delta, 0.0], [-delta, 0.0], [0.0, delta], [0.0, -delta]])
    moved = grid[None] + np.concatenate([shifts, np.zeros((5, 1))], axis=1)[:, :, None]
    grey = sample(coefficients, to_pixels(project(warp[:, None], moved[None])))
    slope = (grey[:, 1::2] - grey[:, 2::2]) / (2.0 * delta)
    return np.concatenate([grey[:, :1], slope], axis=1)


def templates(patch: Array, grid: Array) -> Templates:
    """Templates from grey levels and local slopes (p,3,n) of the reference patches.

    Brightness and contrast are fitted with the warp (the grey level and a constant are projected out of
    the steepest-descent images), as in the zero-normalised criterion, doi 10.1007/s11340-011-9505-9.
    """
    x, y, _ = grid
    grey = patch[:, 0] - patch[:, 0].mean(axis=1, keepdims=True)
    norm = np.linalg.norm(grey, axis=1, keepdims=True)
    grey, gx, gy = grey / norm, patch[:, 1] / norm, patch[:, 2] / norm
    radial = gx * x + gy * y
    descent = np.stack([gx * x, gx * y, gx, gy * x, gy * y, gy, -radial * x, -radial * y], axis=1)
    descent = descent - descent.mean(axis=2, keepdims=True)
    descent = descent - (descent @ grey[:, :, None]) * grey[:, None, :]
    covariance = np.linalg.inv(descent @ descent.transpose(0, 2, 1))
    return Templates(grid, grey, covariance @ descent, covariance)


def register(
    coefficients: NDArray[np.float32],
    to_pixels: ToPixels,
    reference: Templates,
    start: Array,
    scale: Array,
    which: NDArray[np.intp],
) -> tuple[Array, Array]:
    """Warps (m,3,3) that lay the reference patches on the picture, and their correlation (m,) with it.

    coefficients: (h,w) spline coefficients of the picture.   to_pixels: ideal to raw pixels.
    start: (m,3,3) first guess, within about half a marker cell.   scale: (m,) px per local unit.
    which: (m,) rows of the reference.

    Inverse compositional, doi 10.1023/B:VISI.0000011205.11775.fd. A correlation of 0 means that the search
    left the picture or folded; nothing is raised.
    """
    warp, correlation = start.copy(), np.zeros(len(start))
    active = np.arange(len(start))
    for _ in range(MAX_ITERATIONS):
        grey, correlation[active] = _normalised(
            coefficients, to_pixels, warp[active], reference, which[active]
        )
        active = active[correlation[active] > 0.0]
        if not active.size:
            break
        change = (reference.step[which[active]] @ grey[:, :, None])[..., 0]
        warp[active] = _compose(warp[active], change)
        moved = np.abs(change[:, [2, 5]]).max(axis=1) * scale[active]
        active = active[moved > CONVERGED_PX]
        if not active.size:
            return warp, correlation
    correlation[active] = 0.0
    return warp, correlation


def _normalised(
    coefficients: NDArray[np.float32],
    to_pixels: ToPixels,
    warp: Array,
    reference: Templates,
    which: NDArray[np.intp],
) -> tuple[Array, Array]:
    """Sampled patches with mean 0 and norm 1 (those with positive correlation only), and all correlations."""
    height, width = coefficients.shape
    pixels = to_pixels(project(warp, reference.grid))
    inside = (np.abs(2.0 * pixels - (width - 1, height - 1)) <= (width - 1, height - 1)).all(axis=(1, 2))
    correlation = np.zeros(len(warp))
    grey = sample(coefficients, pixels[inside])
    grey = grey - grey.mean(axis=1, keepdims=True)
    grey = grey / np.maximum(np.linalg.norm(grey, axis=1, keepdims=True), 1e-6)
    correlation[inside] = np.einsum("pn,pn->p", grey, reference.grey[which[inside]])
    return grey[correlation[inside] > 0.0], correlation


def _compose(warp: Array, change: Array) -> Array:
    """Warp after the inverse of the step (m,8) is put before it, scaled so that its last entry is 1."""
    step = np.concatenate([change, np.zeros((len(change), 1))], axis=1).reshape(-1, 3, 3) + np.eye(3)
    determinant = np.linalg.det(step)
    step[np.abs(determinant) < 1e-3] = np.eye(3)  # a folded step: keep the guess, its correlation will tell
    composed = warp @ np.linalg.inv(step)
    last = composed[:, 2:, 2:]
    return composed / np.where(np.abs(last) < 1e-9, 1.0, last)
