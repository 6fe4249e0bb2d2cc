"""Corners of squares to a few hundredths of a pixel, and a smaller picture to look for them in."""

import cv2
import numpy as np

from vision.boards.board import BoardView
from vision.camera import Array, Image

SEARCH_PX = 1280  # larger pictures are shrunk to this to find a board without markers, not to measure it
# Half window of the corner refinement in squares: at 0.4 it reaches the next corners of tilted boards and
# moves the focal length by sds; at 0.1 it wastes half the information (measured on real boards).
WINDOW = 0.3
LEAST_HALF, MOST_HALF = 2, 12  # px


def shrunk(picture: Image) -> tuple[Image, float]:
    """The picture with no side above SEARCH_PX, and by what it was divided."""
    factor = max(1.0, max(picture.shape) / SEARCH_PX)
    if factor == 1.0:
        return picture, 1.0
    size = (round(picture.shape[1] / factor), round(picture.shape[0] / factor))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8), factor


def refined(picture: Image, points: Array, pixels: Array, reach_mm: float) -> BoardView:
    """Corners to a few hundredths of a pixel, each in a window that reaches reach_mm on the board."""
    half = np.clip(reach_mm * px_per_mm(points, pixels), LEAST_HALF, MOST_HALF).astype(int)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    corners = np.array(pixels, dtype=np.float64)
    for size in np.unique(half):
        rows = np.flatnonzero(half == size)
        start = np.ascontiguousarray(pixels[rows], dtype=np.float32).reshape(-1, 1, 2)
        window = (int(size), int(size))
        corners[rows] = cv2.cornerSubPix(picture, start, window, (-1, -1), stop).reshape(-1, 2)
    return BoardView(points, corners)


def px_per_mm(points: Array, pixels: Array) -> Array:
    """Smallest scale (n,) px/mm from each corner to the ones nearest to it on the board."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    apart = np.linalg.norm(pixels[:, None] - pixels[None], axis=-1)
    np.fill_diagonal(distance, np.inf)
    near = distance < 1.01 * distance.min(axis=1, keepdims=True)
    return np.asarray(np.where(near, apart / distance, np.inf).min(axis=1))
