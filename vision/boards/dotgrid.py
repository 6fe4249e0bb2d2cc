"""A grid of dots, of which a picture may show a part: the dots, and the row and column of each."""

from collections import deque
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from vision.camera import Array, Image

MIN_AREA = 12.0  # px2
FLAT = 0.25  # smaller axis of a dot, in larger ones: seen at 75 degrees
SMOOTH = 0.12  # rms distance of a rim from its ellipse, in radii, above which it is no dot
NEAR = 0.3  # of a step: how far a dot may lie from where the ones before it lead
LARGER = 1.5  # times the area of its neighbours: a coding dot
RING = 0.12  # area of a hole, in areas of its dot, that makes a ring


@dataclass(frozen=True)
class Dots:
    """Dark dots in a picture."""

    centre: Array  # (n,2) px
    area: Array  # (n,) px2, holes included
    ring: NDArray[np.bool_]  # (n,) with a light middle


def find_dots_of_board(picture: Image) -> Dots:
    """All dark elliptic spots of a picture (h,w), rings among them; whole ones only."""
    side = max(min(picture.shape) // 6 | 1, 15)
    dark = cv2.adaptiveThreshold(picture, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, side, 12)
    contours, tree = cv2.findContours(dark, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    spots: list[tuple[Array, float, bool]] = []
    for k, contour in enumerate(contours):
        outer = tree[0][k][3] < 0
        spot = _spot(contour[:, 0].astype(np.float64), picture) if outer else None
        if spot is not None:
            hole = tree[0][k][2]
            ring = hole >= 0 and cv2.contourArea(contours[hole]) > RING * spot[1]
            spots.append((*spot, bool(ring)))
    return Dots(
        np.array([c for c, _, _ in spots]).reshape(-1, 2),
        np.array([a for _, a, _ in spots]),
        np.array([r for _, _, r in spots], dtype=bool),
    )


def _spot(rim: Array, picture: Image) -> tuple[Array, float] | None:
    """Centre (2,) px and area px2 of an elliptic rim (k,2) px, None for another or one that is cut."""
    area = float(cv2.contourArea(rim.astype(np.float32)))
    cut = rim.min() < 1.0 or np.any(rim.max(axis=0) > np.array(picture.shape[::-1]) - 2.0)
    if len(rim) < 8 or area < MIN_AREA or area > 0.05 * picture.size or cut:
        return None
    (x, y), size, angle = cv2.fitEllipseDirect(rim.astype(np.float32).reshape(-1, 1, 2))
    if not min(size) > FLAT * max(size):
        return None
    turn = np.deg2rad(angle)
    to_axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    reach = np.linalg.norm((rim - (x, y)) @ to_axes.T / (0.5 * np.array(size)), axis=1)
    radius = np.sqrt(area / np.pi)
    if np.sqrt(np.mean((reach - 1.0) ** 2)) > SMOOTH + 0.5 / radius:
        return None
    return np.array([x, y]), float(np.pi * size[0] * size[1] / 4.0)


def walk(centre: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Dots (m,) of (n,2) px that are in the grid, and their steps (m,2) along its two directions, from some
    dot on; the second direction is the first turned as y is from x (clockwise as the picture shows it).

    From dot to dot: each step begins as the one that led there, so that perspective and lens may change it.
    The largest grid of those that begin at the dots nearest to the middle is given.
    """
    if len(centre) < 4:
        return np.empty(0, np.intp), np.empty((0, 2), np.intp)
    tree = scipy.spatial.cKDTree(centre)
    starts = np.argsort(np.linalg.norm(centre - np.median(centre, axis=0), axis=1))[:6]
    grids = [_walk_from(int(s), centre, tree) for s in starts]
    best = max(grids, key=len)
    rows = np.array(sorted(best), dtype=np.intp)
    return rows, np.array([best[int(r)] for r in rows], dtype=np.intp).reshape(-1, 2)


def _walk_from(start: int, centre: Array, tree: "scipy.spatial.cKDTree") -> dict[int, tuple[int, int]]:
    """Steps of every dot that is reached from one."""
    steps = _first_steps(start, centre, tree)
    if steps is None:
        return {}
    place, used = {start: (0, 0)}, {(0, 0)}
    waiting = deque([(start, steps)])
    while waiting:
        dot, local = waiting.popleft()
        for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
            cell = list(place[dot])
            cell[axis] += sign
            away, nearest = tree.query(centre[dot] + sign * local[axis])
            neighbour = int(nearest)
            if away > NEAR * np.hypot(*local[axis]) or neighbour in place or tuple(cell) in used:
                continue
            new = local.copy()
            new[axis] = sign * (centre[neighbour] - centre[dot])
            place[neighbour] = (cell[0], cell[1])
            used.add((cell[0], cell[1]))
            waiting.append((neighbour, new))
    return place


def _first_steps(start: int, centre: Array, tree: "scipy.spatial.cKDTree") -> Array | None:
    """Two steps (2,2) px from a dot to neighbours that have an opposite one, of the least sum of lengths: the
    grid's own up to 55 degrees of tilt."""
    near = np.ravel(tree.query(centre[start], k=min(9, len(centre)))[1])[1:]
    ways = [centre[n] - centre[start] for n in near]
    paired = [w for w in ways if any(np.hypot(*(w + v)) < NEAR * np.hypot(*w) for v in ways)]
    pairs = [
        (float(np.hypot(*a) + np.hypot(*b)), k, np.array([a, b]))
        for k, (a, b) in enumerate(product(paired, repeat=2))
        if a[0] * b[1] - a[1] * b[0] > 0.3 * np.hypot(*a) * np.hypot(*b)
    ]
    return min(pairs)[2] if pairs else None


def coding(dots: Dots, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Mask (m,) of the coding dots: rings, or larger than the dots around them."""
    centre = dots.centre[rows]
    near = scipy.spatial.cKDTree(centre).query(centre, k=min(9, len(centre)))[1]
    usual = np.median(dots.area[rows][near], axis=1)
    return np.asarray(dots.ring[rows] | (dots.area[rows] > LARGER * usual))
