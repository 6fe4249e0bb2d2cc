"""Turns a mesh into the edge that a camera beside it sees: the outer contour in x and z, on the near side."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from twin.review.states import Array, Integers

DRAWN = 4000  # px along the longest side, of the picture in which the contour is found
SHIFT = 4  # bits of a drawn pixel that corners are rounded to
MARGIN = 2  # drawn px round the body
NEAR = 1.5  # drawn px from the contour, within which a node lies on it


def edge_rows(nodes: Array, triangles: Integers) -> NDArray[np.intp]:
    """Rows (k,) of the nodes along the outer contour of a skin at rest, closed: the last is the first.

    nodes (n,3) mm; triangles (t,3) of its skin.   The contour is that of all triangles seen along y. Where
    several nodes lie on one place of it, as along the underside, the nearest to the camera counts: largest y.
    These are material points, so that the edge follows the finger as it bends.
    """
    used = np.unique(triangles)
    flat = nodes[:, [0, 2]]
    scale = DRAWN / float(np.ptp(flat[used], axis=0).max())
    drawn = (flat - flat[used].min(axis=0)) * scale + MARGIN
    contour = _contour(drawn[triangles])
    along, off = _on_contour(drawn[used], contour)
    chosen = off < NEAR
    rows, along = used[chosen], along[chosen]
    order = np.argsort(along)
    groups = np.split(order, np.flatnonzero(np.diff(along[order]) > 2 * NEAR) + 1)
    edge = [rows[group[np.argmax(nodes[rows[group], 1])]] for group in groups]
    return np.array([*edge, edge[0]])


def _contour(corners: Array) -> Array:
    """The longest outer contour (m,2) of filled triangles (t,3,2), all in drawn px."""
    width, height = np.ceil(corners.max(axis=(0, 1))).astype(int) + MARGIN + 1
    mask = np.zeros((height, width), np.uint8)
    for triangle in np.round(corners * 2**SHIFT).astype(np.int32):
        cv2.fillConvexPoly(mask, triangle, 255, cv2.LINE_8, SHIFT)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(max(contours, key=cv2.contourArea)[:, 0], np.float64)


def _on_contour(points: Array, contour: Array) -> tuple[Array, Array]:
    """Arc length of points (n, 2) along a contour (m, 2) of neighbouring pixels, and their distance from it.
    """
    neighbours = cKDTree(contour).query(points)
    off, nearest = np.asarray(neighbours[0], np.float64), np.asarray(neighbours[1], np.intp)
    steps = np.linalg.norm(np.diff(contour, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])[nearest], off
