"""Boards that were moved between the pictures of several cameras: which ones, and how far."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vision.calibration.bundle import Shot, board_pose
from vision.calibration.rig import Rig, project
from vision.camera import Array

# A pose is left out where its corners' rms is above so many times the median of all poses, and above px.
WORSE, LEAST_PX = 2.5, 0.15
STEPS = 8


@dataclass(frozen=True)
class Moved:
    """A board pose that does not fit the rig."""

    instant: int
    rms: float  # px, of its corners under one pose for all cameras
    usual: float  # px, median over all poses


def worst_pose(rig: Rig, shots: Sequence[Shot]) -> Moved | None:
    """The board pose that fits worst, where it is an outlier; of those that two cameras or more see."""
    instants = sorted({v.instant for v in shots})
    groups = [[v for v in shots if v.instant == i] for i in instants]
    joint = [(i, _rms(rig, group)) for i, group in zip(instants, groups, strict=True) if len(group) > 1]
    if len(joint) < 3:
        return None
    usual = float(np.median([rms for _, rms in joint]))
    instant, rms = max(joint, key=lambda each: each[1])
    return Moved(instant, rms, usual) if rms > max(WORSE * usual, LEAST_PX) else None


def _rms(rig: Rig, shots: Sequence[Shot]) -> float:
    """Rms distance in px of the corners of one pose from where the rig sees them, at the best pose."""
    theta = rig.parameters
    first = shots[0].camera
    turn = cv2.Rodrigues(theta[first, 9:12])[0]
    seen = board_pose(shots[0], rig.cameras[first])
    start = np.column_stack([turn.T @ seen[:3, :3], turn.T @ (seen[:3, 3] - theta[first, 12:])])
    pose = np.concatenate([np.ravel(cv2.Rodrigues(start[:, :3])[0]), start[:, 3]])
    residual = np.empty(0)
    for _ in range(STEPS):
        residual, slope = _residual(theta, shots, pose)
        pose = pose + np.linalg.lstsq(slope, residual, rcond=None)[0]
    return float(np.sqrt(np.mean(np.sum(residual.reshape(-1, 2) ** 2, axis=1))))


def _residual(theta: Array, shots: Sequence[Shot], pose: Array) -> tuple[Array, Array]:
    """Residuals (m,) px of all corners, and their derivatives (m,6) to the pose."""
    parts = [(v, project(theta[v.camera], pose[:3], pose[3:], v.points)) for v in shots]
    residual = np.concatenate([(v.pixels - pixels).ravel() for v, (pixels, _, _) in parts])
    return residual, np.concatenate([slope for _, (_, _, slope) in parts])
