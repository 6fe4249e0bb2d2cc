"""Frame marks in, homography between the finger's plane (mm) and ideal pixels out, one per frame."""

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MIN_VISIBLE = 4


def fit_homography(plane: Array, pixels: Array) -> Array:
    """Least-squares homography (3,3) from plane points (n,2) mm to ideal pixels (n,2), n >= 4."""
    shift, spread = plane.mean(axis=0), float(np.ptp(plane, axis=0).max())
    local = (plane - shift) / spread
    found = np.asarray(cv2.findHomography(local, pixels, 0)[0], dtype=np.float64)
    if found.shape != (3, 3):
        return np.full((3, 3), np.nan)  # all points on one line
    homography = _refine(found, local, pixels)
    to_local = np.array([[1.0, 0.0, -shift[0]], [0.0, 1.0, -shift[1]], [0.0, 0.0, spread]]) / spread
    full = homography @ to_local
    return np.asarray(full / full[2, 2])


def _refine(homography: Array, plane: Array, pixels: Array) -> Array:
    """Three Gauss-Newton steps on the reprojection error (cv2 stops at 1e-3 px or so)."""
    x, y = plane.T
    homography = homography / homography[2, 2]
    for _ in range(3):
        u, v, w = homography @ np.stack([x, y, np.ones_like(x)])
        u, v = u / w, v / w
        zero = np.zeros_like(x)
        du = np.stack([x, y, 1 + zero, zero, zero, zero, -u * x, -u * y], axis=1) / w[:, None]
        dv = np.stack([zero, zero, zero, x, y, 1 + zero, -v * x, -v * y], axis=1) / w[:, None]
        error = np.concatenate([pixels[:, 0] - u, pixels[:, 1] - v])
        step, *_ = np.linalg.lstsq(np.concatenate([du, dv]), error, rcond=None)
        homography = homography + np.append(step, 0.0).reshape(3, 3)
    return homography


def homographies(plane: Array, ideal: Array) -> Array:
    """Homographies (t,3,3) from the frame marks' nominal places (f,2) mm and ideal pixels (t,f,2).

    A frame that shows fewer than 4 of the marks gets NaN.
    """
    result = np.full((len(ideal), 3, 3), np.nan)
    for t, pixels in enumerate(ideal):
        seen = np.isfinite(pixels[:, 0])
        if np.count_nonzero(seen) >= MIN_VISIBLE:
            result[t] = fit_homography(plane[seen], pixels[seen])
    return result


def to_plane(homography: Array, ideal: Array) -> Array:
    """Plane coordinates mm (t,p,2) of ideal pixels (t,p,2) under homographies (t,3,3); NaN stays NaN."""
    inverse = np.full(homography.shape, np.nan)
    known = np.isfinite(homography[:, 0, 0])
    inverse[known] = np.linalg.inv(homography[known])
    mapped = np.einsum("tij,tpj->tpi", inverse[:, :, :2], ideal) + inverse[:, None, :, 2]
    return np.asarray(mapped[..., :2] / mapped[..., 2:])
