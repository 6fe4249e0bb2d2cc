"""Outline of a solid as a camera sees it, in the plane of the frame marks: places and normals."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from vision.camera import Array
from vision.perspective import Viewpoint
from vision.placing.restplaces import BodyPose

RASTER_MM = 0.05  # of the raster that tells the order along the outline; places are exact
APART_MM = 0.4  # from one place to the next
SMOOTH_MM = 0.8  # over which a normal is taken
CORNER = 1.0  # 1/mm, a curvature beyond which it is a corner, whose normal is not known
NEAR_MM = 0.6  # from a place: there the outline of a slightly other body is


@dataclass(frozen=True)
class BodySurface:
    """What a camera looks at: a body at rest, in its own axes."""

    faces: Array  # (f,c,3) mm, corners of its surface's faces in turn
    held: Array  # (h,3) mm, places where it is clamped: its outline is hidden there
    changes: Callable[[], tuple["Changed", ...]] = tuple  # takes long: asked for where edges are seen
    waves: "Waves | None" = None  # that repeat along its upper side

    @cached_property
    def changed(self) -> tuple["Changed", ...]:
        """The solid with each of its numbers changed."""
        return self.changes()


@dataclass(frozen=True)
class Waves:
    """Pleats or chambers along a body's upper side."""

    count: int
    start: float  # mm from the clamp to the first
    end: float  # mm to behind the last
    low: float  # mm, a height that all of them exceed
    high: float  # mm, of the highest
    other: Callable[[int], Callable[[Mapping[str, float]], BodySurface]]  # the solid with so many


@dataclass(frozen=True)
class Changed:
    """The solid with one number changed, such as a dimension."""

    name: str
    faces: Array  # (f,c,3) mm, the same faces where they are then
    change: float  # of the number, in its unit
    sd: float  # how well it is known without the outline


@dataclass(frozen=True)
class Silhouette:
    """The outline of a solid in the plane of the frame marks."""

    place: Array  # (k,2) mm
    normal: Array  # (k,2) outwards
    curvature: Array  # (k,) 1/mm, positive where the body bulges

    def __getitem__(self, rows: NDArray[Any]) -> "Silhouette":
        return Silhouette(self.place[rows], self.normal[rows], self.curvature[rows])


def on_plane(points: Array, pose: BodyPose, view: Viewpoint, plane_mm: float) -> Array:
    """Places (...,2) mm where the rays to points (...,3) mm of a body meet the plane of the frame marks."""
    c, s, (x, y, z) = np.cos(pose.turn), np.sin(pose.turn), np.moveaxis(points, -1, 0)
    place = np.stack([pose.x_mm + c * x - s * z, pose.z_mm + s * x + c * z], axis=-1)
    stretch = view.distance / (view.distance - (y - plane_mm))
    return np.asarray(view.foot + (place - view.foot) * stretch[..., None])


def silhouette(flat: Array) -> Silhouette:
    """The outer outline of faces (f,c,2) mm in the plane. Corners are left out, as no normal is known there.

    >>> x = np.array([[(0.0, 0.0), (30.0, 0.0), (30.0, 10.0), (0.0, 10.0)]])
    >>> outline = silhouette(x)
    >>> low = outline.place[outline.normal[:, 1] < -0.99]
    >>> float(np.abs(low[:, 1]).max().round(9)), int(low[:, 0].min()), int(low[:, 0].max())
    (0.0, 0, 29)
    """
    line = _contour(flat)
    step = np.linalg.norm(np.diff(line, axis=0, append=line[:1]), axis=1)
    span = max(round(SMOOTH_MM / float(step.mean())), 3)
    smooth = scipy.ndimage.uniform_filter1d(line, span, axis=0, mode="wrap")
    tangent = np.roll(smooth, -span // 2, axis=0) - np.roll(smooth, span // 2, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    clockwise = np.sum(line[:, 0] * np.roll(line[:, 1], -1) - line[:, 1] * np.roll(line[:, 0], -1)) < 0
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1) * (-1.0 if clockwise else 1.0)
    before, after = np.roll(normal, span // 2, axis=0), np.roll(normal, -(span // 2), axis=0)
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    curvature = np.arcsin(np.clip(turn, -1.0, 1.0)) / (2 * (span // 2) * float(step.mean()))
    curvature *= -1.0 if clockwise else 1.0
    rows = np.arange(0, len(line), max(round(APART_MM / float(step.mean())), 1))
    rows = rows[np.abs(curvature[rows]) < CORNER]
    off = cut(flat, smooth[rows], normal[rows]).off
    place = smooth[rows] + off[:, None] * normal[rows]
    return Silhouette(place, normal[rows], curvature[rows])[np.isfinite(off)]


@dataclass(frozen=True)
class Cut:
    """Where lines along normals leave a body."""

    off: Array  # (k,) mm from where they start; NaN where the outline is not within NEAR_MM
    side: NDArray[np.intp]  # (k,) the side of a face, f c + its number, that is the outline there
    share: Array  # (k,) of that side, from its first corner

    def of(self, moved: Array, normal: Array) -> Array:
        """Motion (k,) mm of the outline along its normals (k,2) as corners of faces move by (f,c,2) mm: the
        outline moves as the places on the body do that are its outermost (the envelope theorem)."""
        start, end = (x.reshape(-1, 2)[self.side] for x in (moved, np.roll(moved, -1, axis=1)))
        return np.asarray(((start + self.share[:, None] * (end - start)) * normal).sum(axis=1))


def cut(flat: Array, place: Array, normal: Array) -> Cut:
    """Where lines from places (k,2) mm along normals (k,2) leave faces (f,c,2) mm."""
    start, end = (x.reshape(-1, 2) for x in (flat, np.roll(flat, -1, axis=1)))
    reach = NEAR_MM + 0.5 * float(np.linalg.norm(end - start, axis=1).max())
    middles = scipy.spatial.cKDTree(0.5 * (start + end))
    pairs = scipy.spatial.cKDTree(place).sparse_distance_matrix(middles, reach, output_type="ndarray")
    k, near = pairs["i"], pairs["j"]
    turned = np.stack([-normal[:, 1], normal[:, 0]], axis=1)[k]
    left, right = (((x[near] - place[k]) * turned).sum(axis=1) for x in (start, end))
    crossing = np.flatnonzero((left * right <= 0.0) & (left != right))
    k, near, share = k[crossing], near[crossing], left[crossing] / (left - right)[crossing]
    out = ((start[near] + share[:, None] * (end - start)[near] - place[k]) * normal[k]).sum(axis=1)
    order = np.lexsort((near, out))  # the outermost of each line comes last
    order = order[np.abs(out[order]) <= NEAR_MM]
    off, shares = np.full((2, len(place)), np.nan)
    side = np.zeros(len(place), np.intp)
    off[k[order]], shares[k[order]], side[k[order]] = out[order], share[order], near[order]
    return Cut(off, side, shares)


def _contour(flat: Array) -> Array:
    """The outermost edge (n,2) mm of the raster of faces (f,c,2) mm, in order."""
    low = flat.min(axis=(0, 1)) - 4 * RASTER_MM
    size = np.ceil((flat.max(axis=(0, 1)) - low) / RASTER_MM).astype(int) + 5
    mask: NDArray[np.uint8] = np.zeros((size[1], size[0]), np.uint8)
    for face in np.ascontiguousarray(np.round((flat - low) / RASTER_MM * 16), np.int32):
        cv2.fillConvexPoly(mask, face, 255, cv2.LINE_8, 4)
    lines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    longest = max(lines, key=len)
    return np.asarray(longest.reshape(-1, 2) * RASTER_MM + low, float)
