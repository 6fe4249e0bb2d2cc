"""Sub-pixel homographies of marker patches, by inverse-compositional Gauss-Newton on grey levels.

A patch lives in local coordinates: the printed mark is the square (-1..1)^2, x to the right and y down in
its own upright picture. A warp (3,3) takes local coordinates to ideal (undistorted) pixels, a lens those to
raw ones.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Camera
from vision.following import sampling

Picture = NDArray[np.uint8] | NDArray[np.float32]

NO_LENS = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
# Share of the variance of white noise that a cubic B-spline keeps between the pixels, mean over all places:
# the square of the energy of its cardinal function, 0.87423.
INTERPOLATED = 0.76428


@dataclass(frozen=True)
class Templates:
    """Reference patches of p marks on one square local grid, ready for Gauss-Newton steps."""

    grid: Array  # (3,n) local homogeneous coordinates of the patch points
    grey: Array  # (p,n) grey levels with mean 0 and norm 1
    step: Array  # (p,n,8) takes a grey difference (of norm-1 patches) to the eight warp parameters
    covariance: Array  # (p,8,8) of the parameters for a difference of unit variance per point


def lens_of(camera: Camera, shift: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Ideal to raw pixels as `register` wants it, (11,): fx fy cx cy k1 k2 p1 p2 k3 and a shift in raw px."""
    (fx, _, cx), (_, fy, cy), _ = camera.matrix
    return np.array([fx, fy, cx, cy, *camera.distortion, *shift], dtype=np.float64)


def local_grid(points: int, half: float) -> Array:
    """Regular local grid (3, points^2), row by row, that reaches from -half to half."""
    axis = np.linspace(-half, half, points)
    y, x = np.meshgrid(axis, axis, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.ones(points * points)])


def project(warp: Array, local: Array) -> Array:
    """Ideal pixels (...,n,2) of homogeneous local points (3,n) under warps (...,3,3).

    >>> warp = np.array([[20.0, 0.0, 100.0], [0.0, 20.0, 80.0], [0.0, 0.0, 1.0]])  # a mark of 40 px
    >>> project(warp, local_grid(2, 1.0))
    array([[ 80.,  60.],
           [120.,  60.],
           [ 80., 100.],
           [120., 100.]])
    """
    mapped = warp @ local
    return np.stack([mapped[..., 0, :], mapped[..., 1, :]], axis=-1) / mapped[..., 2, :, None]


def grey_under(image: Picture, lens: Array, warp: Array, grid: Array) -> Array:
    """Grey levels (p,n) of the picture at the warped grid; points outside take its nearest grey level."""
    grey = np.empty((len(warp), grid.shape[1]))
    picture = np.asarray(image, dtype=np.float32)
    sampling.sample(picture, lens, np.ascontiguousarray(warp), grid[:2], _side(grid), grey)
    return grey


def patches(image: Picture, lens: Array, warp: Array, grid: Array) -> Array:
    """Grey levels (p,3,n) at the warped grid and their local derivatives in x and y (central differences).

    Points outside the picture take its nearest grey level.
    """
    side = _side(grid)
    delta = 0.25 * float(grid[0, 1] - grid[0, 0])
    picture = np.asarray(image, dtype=np.float32)
    grey = np.empty((5, len(warp), grid.shape[1]))
    for k, shift in enumerate(((0.0, 0.0), (delta, 0.0), (-delta, 0.0), (0.0, delta), (0.0, -delta))):
        moved = grid[:2] + np.array(shift)[:, None]
        sampling.sample(picture, lens, np.ascontiguousarray(warp), moved, side, grey[k])
    return np.stack([grey[0], (grey[1] - grey[2]) / (2 * delta), (grey[3] - grey[4]) / (2 * delta)], axis=1)


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
    step = np.ascontiguousarray((covariance @ descent).transpose(0, 2, 1))
    return Templates(grid, grey, step, covariance)


def affine_templates(patch: Array, grid: Array) -> Templates:
    """Templates as of `templates` whose steps change the six affine parameters only.

    Laid by a homography, they stay on the plane that it belongs to: perspective is kept, not fitted.
    """
    full = templates(patch, grid)
    information = np.linalg.inv(full.covariance)[:, :6, :6]
    covariance = np.linalg.inv(information)
    slope = np.linalg.solve(full.covariance, full.step.transpose(0, 2, 1))[:, :6]
    step = np.zeros(full.step.shape)
    step[:, :, :6] = (covariance @ slope).transpose(0, 2, 1)
    padded = np.zeros(full.covariance.shape)
    padded[:, :6, :6] = covariance
    return Templates(grid, full.grey, step, padded)


def register(
    image: Picture, lens: Array, reference: Templates, start: Array, scale: Array, which: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Warps (m,3,3) that lay the reference patches on the picture, and their correlation (m,) with it.

    image: (h,w) grey levels.   lens: (11,) ideal to raw pixels, from `lens` or NO_LENS.
    start: (m,3,3) first guess, within about half a marker cell.   scale: (m,) px per local unit.
    which: (m,) rows of the reference.

    Inverse compositional, doi 10.1023/B:VISI.0000011205.11775.fd, on the cubic B-spline of the picture. A
    correlation of 0 means that the search left the picture, folded, or did not settle; nothing is raised.
    """
    return register_quarters(image, lens, reference, start, scale, which)[:2]


def register_quarters(
    image: Picture, lens: Array, reference: Templates, start: Array, scale: Array, which: NDArray[np.intp]
) -> tuple[Array, Array, Array, Array]:
    """Warps, correlations as from `register`, sums (m,4,10) of each patch's quarters, see `uneven`, and grey
    levels (m,n) under it.

    The sums are those of normalised grey levels with `step`, with the template and with 1. The levels are
    those before the last step, of CONVERGED_PX at most; where the search failed they mean nothing.
    """
    warp, correlation = np.array(start, dtype=np.float64), np.zeros(len(start))
    grid = reference.grid
    sums, seen = np.zeros((len(start), 4, 10)), np.zeros((len(start), grid.shape[1]))
    sampling.lay(
        np.asarray(image, dtype=np.float32),  # one type, compiled once
        lens,
        grid[:2],
        _side(grid),
        reference.grey,
        reference.step,
        which,
        scale,
        warp,
        correlation,
        sums,
        seen,
    )
    return warp, correlation, sums, seen


def centre_covariance(reference: Templates, linear: Array, correlation: Array) -> Array:
    """Covariance (...,p,2,2) px2 of the patch centres, from what the fit leaves.

    linear: (...,p,2,2) px per local unit at the centre.   correlation: (...,p) with the reference.

    Residual variance times (J^T J)^-1 of the patch points, as if these were the pixels that they stand for:
    white noise is correlated between points that lie closer, and smaller between pixels.
    """
    grid = reference.grid
    count, pitch = grid.shape[1], float(grid[0, 1] - grid[0, 0])
    pixels = pitch**2 * np.abs(linear[..., 0, 0] * linear[..., 1, 1] - linear[..., 0, 1] * linear[..., 1, 0])
    residual = np.maximum(1.0 - correlation**2, 0.0) / np.maximum(count - 10.0 / pixels, 1.0)
    local = reference.covariance[:, [[2], [5]], [[2, 5]]]
    spread = residual * np.maximum(1.0 / (INTERPOLATED * pixels), 1.0)
    return np.asarray(linear @ local @ np.swapaxes(linear, -1, -2) * spread[..., None, None])


def _side(grid: Array) -> int:
    return round(float(np.sqrt(grid.shape[1])))
