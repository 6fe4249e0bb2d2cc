"""Rotation and stretch of each followed mark in the finger's plane."""

from collections.abc import Sequence

import numpy as np

from vision.camera import Array
from vision.following.tracks import Followed, Method
from vision.marks import Mark
from vision.plane import to_plane


def linear_maps(followed: Followed, homography: Array) -> Array:
    """Linear map (t,p,2,2) of each mark in the plane against its mean over the reference; NaN for dots."""
    ends = [
        to_plane(homography, _local_point(followed.warp, x, y))
        for x, y in ((0.5, 0), (-0.5, 0), (0, 0.5), (0, -0.5))
    ]
    across, down = ends[0] - ends[1], ends[2] - ends[3]
    linear = np.stack([across, down], axis=-1)
    reference = mean_seen(linear[followed.reference].reshape(len(followed.reference), -1, 4)).reshape(
        -1, 2, 2
    )
    turn = np.full(linear.shape, np.nan)
    finite = np.isfinite(reference[:, 0, 0])
    turn[:, finite] = linear[:, finite] @ np.linalg.inv(reference[finite])
    turn[followed.method == Method.DOT] = np.nan
    return turn


def rotations(turn: Array) -> Array:
    """Rotation (t,p) rad of each mark in the plane, from x towards z, from its linear map (t,p,2,2).

    >>> turn = np.deg2rad([0.0, 170.0, 190.0])
    >>> linear = np.array([[[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]] for a in turn])
    >>> np.degrees(rotations(linear[:, None])).ravel().round(6)
    array([  0., 170., 190.])
    """
    angle = np.arctan2(turn[..., 1, 0] - turn[..., 0, 1], turn[..., 0, 0] + turn[..., 1, 1])
    for of_mark in angle.T:  # a lost frame must not spoil those after it
        seen = np.isfinite(of_mark)
        of_mark[seen] = np.unwrap(of_mark[seen])
    return np.asarray(angle)


def sides(linear: Array) -> Array:
    """Root of the area by which linear maps (...,2,2) change a square."""
    return np.sqrt(np.abs(linear[..., 0, 0] * linear[..., 1, 1] - linear[..., 0, 1] * linear[..., 1, 0]))


def finger_turns(value: Array, rotation: Array, marks: Sequence[Mark]) -> Array:
    """Rotation (s,p) rad of the finger where each mark sits; a dot takes the chord between its neighbours.

    The first and the last have one neighbour: a chord turns by the mean of its two ends.
    """
    points = np.array([mark.position for mark in marks])
    finger = sorted((p for p, mark in enumerate(marks) if mark.role == "finger"), key=lambda p: points[p, 0])
    turned = np.where(np.isfinite(value[:, :, 0]), rotation, 0.0)
    for i, p in sorted(enumerate(finger), key=lambda item: item[0] in (0, len(finger) - 1)):
        if marks[p].kind.shows_turn or len(finger) < 2:
            continue
        a, b = finger[max(i - 1, 0)], finger[min(i + 1, len(finger) - 1)]
        chord = (points[b] - points[a])[[0, 2]]
        now = chord + (value[:, b] - value[:, a])[:, [0, 2]]
        turned[:, p] = np.arctan2(chord[0] * now[:, 1] - chord[1] * now[:, 0], now @ chord)
        if p in (a, b) and len(finger) > 2:
            turned[:, p] = 2.0 * turned[:, p] - turned[:, a + b - p]
    return np.nan_to_num(turned)


def mean_seen(place: Array) -> Array:
    """Mean (p,2) over the frames in which a point is seen; NaN for one never seen.

    >>> mean_seen(np.array([[[1.0, 2.0]], [[np.nan, np.nan]], [[3.0, 4.0]]]))
    array([[2., 3.]])
    """
    count = np.isfinite(place).sum(axis=0)
    return np.where(count > 0, np.nan_to_num(place).sum(axis=0) / np.maximum(count, 1), np.nan)


def _local_point(warp: Array, x: float, y: float) -> Array:
    mapped = warp @ np.array([x, y, 1.0])
    return np.asarray(mapped[..., :2] / mapped[..., 2:])
