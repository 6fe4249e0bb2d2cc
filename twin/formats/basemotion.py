"""The rigid motion of markers on the base, taken off all markers, and what in a record is no motion: the
first rows in which the capture's filter settles, and names that two markers have exchanged."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from twin.targets import Array

BASE = 3  # markers, at least, whose rigid motion is taken off
FIRST = 30  # rows at most in which a filter settles
JUMPS, JUMP_MM = 10.0, 0.1  # times the usual step from row to row, and in mm: no base moves so
EXCHANGED_MM = 5.0  # by how much places at rest must agree better with names exchanged


@dataclass(frozen=True)
class Freed:
    """Places (s, p, 3) mm without the motion of the base; the sd (p, 3) mm that the base's own error gives
    them; by how much the base moves at most, and what that takes off the places, mm."""

    position: Array
    sd: Array
    moved: float
    taken: float


def rigid(a: Array, b: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and shift (3,) that bring points a (k, 3) nearest to b (Kabsch 1976, doi
    10.1107/S0567739476001873)."""
    U, _, Vt = np.linalg.svd((a - a.mean(axis=0)).T @ (b - b.mean(axis=0)))
    turn = Vt.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))]) @ U.T
    return np.asarray(turn, float), b.mean(axis=0) - turn @ a.mean(axis=0)


def without_base(position: Array, rest: Array, base: Sequence[int], sd_mm: float) -> Freed:
    """Places (s, p, 3) mm in the axes of the base as it lay at rest (p, 3).

    base: rows of its markers, three or more. sd_mm: of one of their coordinates; what a rigid motion leaves
    of them counts where it is larger. Its covariance is that of the least squares for shift and turn. A row
    in which a base marker is not seen becomes NaN.
    """
    base = list(base)
    out = np.full_like(position, np.nan)
    for k in np.flatnonzero(np.isfinite(position[:, base]).all(axis=(1, 2))):
        turn, shift = rigid(position[k, base], rest[base])
        out[k] = position[k] @ turn.T + shift
    middle = rest[base].mean(axis=0)
    design = np.concatenate([_motion(x - middle) for x in rest[base]])  # (3b, 6): shift, turn
    left = out[:, base] - rest[base]
    free = 3 * len(base) - 6
    per_row = np.sqrt(np.nanmean((left**2).sum(axis=(1, 2))) / free) if np.isfinite(left).any() else 0.0
    covariance = max(sd_mm, float(per_row)) ** 2 * np.linalg.pinv(design.T @ design)
    sd = np.array([np.sqrt(np.diag(_motion(x - middle) @ covariance @ _motion(x - middle).T)) for x in rest])
    off = [k for k in range(position.shape[1]) if k not in base]
    return Freed(
        out, np.nan_to_num(sd), _largest(position[:, base] - rest[base]),
        _largest((position - out)[:, off]),
    )  # fmt: skip


def _motion(x: Array) -> Array:
    """How a point (3,) moves (3, 6) by a small shift and a small turn about the origin."""
    return np.hstack([np.eye(3), -np.cross(np.eye(3), x)])


def _largest(moved: Array) -> float:
    """The largest length of vectors (..., 3), 0 without any that is known."""
    length = np.linalg.norm(moved, axis=-1)
    return float(np.nanmax(length)) if np.isfinite(length).any() else 0.0


def settling_rows(position: Array, base: Sequence[int]) -> int:
    """The number of first rows of places (s, p, 3) mm, FIRST at most, after the last of which the markers of
    the base jump: there the capture's filter settles. 0 where they do not.

    >>> still = np.tile([0.01, -0.01], 50)[:, None, None] * np.ones((1, 3, 3))
    >>> still[:7] += 0.4
    >>> settling_rows(still, [0, 1, 2])
    7
    """
    if len(base) < BASE or len(position) < 2 * FIRST:
        return 0
    step = np.linalg.norm(np.diff(position[:, list(base)], axis=0), axis=2).max(axis=1)
    large = np.nan_to_num(step[:FIRST]) > max(JUMPS * float(np.nanmedian(step)), JUMP_MM)
    return int(np.flatnonzero(large)[-1]) + 1 if large.any() else 0


def exchanged(rest: Array, first: Array) -> tuple[int, int] | None:
    """Rows of a marker and of the one in whose place (p, 3) mm it lies, where places at rest agree better
    with those of another recording once names are exchanged; None where they do not.

    >>> place = np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 30.0, 0.0]])
    >>> exchanged(place[[1, 0, 2]], place), exchanged(place + 1.0, place)
    ((0, 1), None)
    """
    known: NDArray[np.intp] = np.flatnonzero(np.isfinite(rest).all(axis=1) & np.isfinite(first).all(axis=1))
    away = np.linalg.norm(rest[known, None] - first[None, known], axis=2)
    rows, columns = scipy.optimize.linear_sum_assignment(away)
    if not len(known) or away[rows, rows].sum() - away[rows, columns].sum() < EXCHANGED_MM:
        return None
    k = int(np.flatnonzero(rows != columns)[0])
    return int(known[k]), int(known[columns[k]])
