"""Places in world axes of marks that several cameras followed, whatever shakes the cameras.

The rig's frame is laid on the frame marks' nominal places by a rigid fit; in every frame each camera's pose
is then found again from the frame marks, so that a shaken tripod does no harm.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from vision.calibration.rig import Rig, triangulate
from vision.camera import Array
from vision.following.markrotations import mean_seen
from vision.plane import MIN_VISIBLE

STEPS = 5  # of Gauss-Newton from the rig's pose


@dataclass(frozen=True, kw_only=True)
class Sight:
    """Pixels in which c cameras see m marks in t frames on one clock."""

    raw: Array  # (c,t,m,2) raw px; NaN where lost
    variance: Array  # (c,m) px2, usual, of a centre
    nominal: Array  # (m,3) mm, world axes, at rest
    frame: Sequence[int]  # rows of the frame marks
    points: Sequence[int]  # rows that are given out
    reference: NDArray[np.intp]  # (r,) frames


@dataclass(frozen=True)
class Places:
    """Marks in space."""

    place: Array  # (t,p,3) mm, world axes; NaN where fewer than two cameras see a mark
    spread: Array  # (t,p,3,3) mm2, of the centres' usual variance alone
    residual: Array  # (c,t,p,2) px, what the cameras disagree by
    misfit: Array  # (f,3) mm, frame marks minus their nominal places after the rigid fit
    matrices: Array  # (c,t,3,4) world mm to ideal px


def places_of(rig: Rig, sight: Sight) -> Places:
    """Places (t,p,3) mm in world axes of the marks that two cameras or more see, and how well they agree.

    First where the rig's frame lies in the world: the frame marks' mean places over the reference, laid on
    their nominal ones. Then each camera's pose in every frame, from the frame marks alone. Then every mark
    from these poses. Raises ValueError as `rigid_fit`.
    """
    ideal = np.array([c.undistort(raw) for c, raw in zip(rig.cameras, sight.raw, strict=True)])  # (c,t,m,2)
    covariance = sight.variance[..., None, None] * np.eye(2)  # (c,m,2,2) px2
    held, nominal = _frame_marks_at_rest(rig, sight, ideal, covariance), sight.nominal[list(sight.frame)]
    turn, shift = rigid_fit(held, nominal)
    matrices = _projections(rig, held, ideal[:, :, list(sight.frame)]) @ _to_rig(turn, shift)
    place, spread, residual = _in_space(
        matrices, ideal[:, :, list(sight.points)], covariance[:, list(sight.points)]
    )
    return Places(place, spread, residual, held @ turn.T + shift - nominal, matrices)


def _frame_marks_at_rest(rig: Rig, sight: Sight, ideal: Array, covariance: Array) -> Array:
    """Mean places (f,3) mm of the frame marks over the reference, in the rig's frame.

    ideal: (c,t,m,2) px.   covariance: (c,m,2,2) px2.
    """
    rest = np.array([mean_seen(of_camera[sight.reference]) for of_camera in ideal])[:, list(sight.frame)]
    return triangulate(rig.matrices, rest, covariance[:, list(sight.frame)])[0]


def _projections(rig: Rig, held: Array, seen: Array) -> Array:
    """Matrices (c,t,3,4) from the rig's frame (mm) to ideal px, from each camera's pose in every frame.

    held: (f,3) mm, the frame marks in the rig's frame; NaN for those that it does not know.
    seen: (c,t,f,2) ideal px, where the cameras see them.
    """
    finite = np.isfinite(held[:, 0])
    return np.array([
        camera.matrix @ _poses(camera.matrix, pose, held[finite], of_camera[:, finite])
        for camera, pose, of_camera in zip(rig.cameras, _rig_poses(rig), seen, strict=True)
    ])  # fmt: skip


def _in_space(matrices: Array, ideal: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Places (t,p,3) mm, their covariance (t,p,3,3) mm2, and what the cameras disagree by (c,t,p,2) px.

    matrices: (c,t,3,4).   ideal: (c,t,p,2) px.   covariance: (c,p,2,2) px2, alike in all frames.
    """
    c, t, count = ideal.shape[:3]
    wide, pixels = np.repeat(matrices, count, axis=1), ideal.reshape(c, -1, 2)  # a row a frame and mark
    place, spread = triangulate(wide, pixels, np.tile(covariance, (1, t, 1, 1)))
    mapped = np.einsum("cnij,nj->cni", wide[..., :3], place) + wide[..., 3]
    residual = (pixels - mapped[..., :2] / mapped[..., 2:]).reshape(ideal.shape)
    return place.reshape(t, count, 3), spread.reshape(t, count, 3, 3), residual


def rigid_fit(points: Array, nominal: Array) -> tuple[Array, Array]:
    """Rotation (3,3) and shift (3,) mm that lay points (n,3) mm on nominal ones (n,3) by least squares.

    Points that are NaN are left out. Raises ValueError for fewer than 4, or when they lie on one line.

    >>> nominal = np.array([[0.0, 0, 0], [100, 0, 0], [0, 50, 0], [0, 0, 30]])
    >>> turn, shift = rigid_fit(nominal @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + 5.0, nominal)
    >>> turn.round(6) + 0.0
    array([[ 0.,  1.,  0.],
           [-1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    >>> shift.round(6)
    array([-5.,  5., -5.])
    """
    finite = np.isfinite(points[:, 0])
    if finite.sum() < MIN_VISIBLE:
        raise ValueError(
            f"{finite.sum()} frame markers are seen by two cameras, wanted {MIN_VISIBLE} or more: mount them "
            "where both cameras see them"
        )
    a, b = points[finite] - points[finite].mean(axis=0), nominal[finite] - nominal[finite].mean(axis=0)
    power = np.linalg.svd(b.T @ a, compute_uv=False)
    if power[1] < 1e-6 * power[0]:
        raise ValueError("the frame markers lie on one line: mount them round the finger")
    turn = scipy.spatial.transform.Rotation.align_vectors(b, a)[0].as_matrix()
    return turn, nominal[finite].mean(axis=0) - turn @ points[finite].mean(axis=0)


def _to_rig(turn: Array, shift: Array) -> Array:
    """World to rig (4,4), from the rotation and shift of rig to world."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.T, -turn.T @ shift
    return pose


def _rig_poses(rig: Rig) -> list[Array]:
    return [
        np.column_stack([np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64), shift])
        for turn, shift in zip(rig.turn, rig.shift, strict=True)
    ]


def _poses(matrix: Array, start: Array, points: Array, pixels: Array) -> Array:
    """Poses (t,3,4) of a camera that sees points (f,3) mm at ideal pixels (t,f,2); NaN with fewer than 4."""
    seen = np.isfinite(pixels[..., 0])
    rows = np.flatnonzero(seen.sum(axis=1) >= MIN_VISIBLE)
    ray = (np.where(seen[rows, :, None], pixels[rows], 0.0) - matrix[:2, 2]) / np.diag(matrix)[:2]
    turn, shift = (np.repeat(part[None], len(rows), axis=0) for part in (start[:, :3], start[:, 3]))
    weight = seen[rows, :, None] * np.diag(matrix)[:2]  # px per unit of a normalised coordinate
    for _ in range(STEPS):
        local = points @ np.swapaxes(turn, 1, 2)
        x, y, z = np.moveaxis(local + shift[:, None], -1, 0)
        error = (ray - np.stack([x / z, y / z], axis=-1)) * weight
        zero = np.zeros_like(z)
        slope = (
            np.stack(
                [np.stack([1 / z, zero, -x / z**2], axis=-1), np.stack([zero, 1 / z, -y / z**2], axis=-1)],
                axis=-2,
            )
            * weight[..., None]
        )
        around = -slope @ _cross(local)
        normal = np.concatenate([around, slope], axis=-1).reshape(len(rows), -1, 6)
        heavy = np.swapaxes(normal, 1, 2)
        step = np.linalg.solve(heavy @ normal, heavy @ error.reshape(len(rows), -1, 1))[..., 0]
        turn = _small_turns(step[:, :3]) @ turn
        shift = shift + step[:, 3:]
    poses = np.full((len(pixels), 3, 4), np.nan)
    poses[rows] = np.concatenate([turn, shift[..., None]], axis=2)
    return poses


def _cross(vectors: Array) -> Array:
    """Matrices (...,3,3) of the cross product with vectors (...,3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def _small_turns(vectors: Array) -> Array:
    """Rotations (n,3,3) by vectors (n,3) rad, by the Cayley map."""
    half = 0.5 * _cross(vectors)
    return np.asarray(np.linalg.solve(np.eye(3) - half, np.eye(3) + half))
