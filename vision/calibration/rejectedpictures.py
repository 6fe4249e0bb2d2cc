"""Board pictures that do not fit the others, and boards that were moved between the pictures of several
cameras: which are left out, by which rule, and why."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vision.boards.board import BoardView
from vision.calibration.bundle import Shot, board_pose
from vision.calibration.rig import Rig, project
from vision.camera import Array

# A picture, or a pose of the board, is left out where its corners' rms is above so many times the median of
# all, the worst first, and the cameras are fitted again. Noise alone reaches 1.7 times with 8 corners, the
# fewest.
WORSE = 2.5
LEAST_PX, LEAST_POSE_PX = 0.05, 0.15  # below which a picture, a pose is good, however good the others are
POSE_STEPS = 8  # of Gauss-Newton to the best pose
MIN_LEFT = 10  # pictures that must be left,
SHARE = 0.3  # of all, the most that are left out
COVERS = 0.65  # and of the area that all covered, what the rest must cover
BLURRED = 1.5  # times the usual width of edges


Fitted = Callable[[Sequence[BoardView]], Array]  # rms distance (v,) px of each view's corners


@dataclass(frozen=True)
class Rejected:
    """Views that were left out of a calibration."""

    kept: tuple[int, ...]  # rows of the views
    dropped: tuple[int, ...]  # worst first
    rms: tuple[float, ...]  # px, of the dropped
    usual: float  # px, median rms of all views in the last fit
    stays: int | None = None  # a view that does not fit but is kept, because too few others would be left


def without_outliers(views: Sequence[BoardView], fitted: Fitted) -> Rejected:
    """The views without those that do not fit.

    fitted: fits a camera to some views and says how well it fits each.
    """
    rows = list(range(len(views)))
    dropped: list[int] = []
    dropped_rms: list[float] = []
    while True:
        rms = fitted([views[i] for i in rows])
        worst, usual = int(np.argmax(rms)), float(np.median(rms))
        if rms[worst] <= max(WORSE * usual, LEAST_PX):
            return Rejected(tuple(rows), tuple(dropped), tuple(dropped_rms), usual)
        remaining = [i for i in rows if i != rows[worst]]
        if not _enough(remaining, views):
            return Rejected(tuple(rows), tuple(dropped), tuple(dropped_rms), usual, rows[worst])
        dropped_rms.append(float(rms[worst]))
        dropped.append(rows[worst])
        rows = remaining


def _enough(rows: list[int], views: Sequence[BoardView]) -> bool:
    """True if the remaining views are many, and cover the picture as all did."""
    if len(rows) < max(MIN_LEFT, (1.0 - SHARE) * len(views)):
        return False
    return area([views[i] for i in rows]) >= COVERS * area(views)


def area(views: Sequence[BoardView]) -> float:
    """Area in px2 inside the hull of all corners."""
    hull = cv2.convexHull(np.concatenate([view.pixels for view in views]).astype(np.float32))
    return float(cv2.contourArea(hull))


def why(blur: Array, row: int) -> str:
    """The fault of a picture that does not fit, from the widths of edges (n,) px of all pictures."""
    usual = float(np.median(blur))
    if blur[row] > BLURRED * usual:
        return f"it is blurred, its edges are {blur[row] / usual:.1f} times as wide as usual"
    return "it is as sharp as the others, so the board was bent or moved, or something covered a part of it"


def empty_corners(views: Sequence[BoardView], size: tuple[int, int]) -> list[str]:
    """Names of the corners of the picture into which no board reaches, to a quarter of its sides."""
    pixels = np.concatenate([view.pixels for view in views]) / size
    names = {(0, 0): "top left", (1, 0): "top right", (0, 1): "bottom left", (1, 1): "bottom right"}
    return [
        name
        for (right, down), name in names.items()
        if not np.any(np.all(np.abs(pixels - (right, down)) < 0.25, axis=1))
    ]


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
    return Moved(instant, rms, usual) if rms > max(WORSE * usual, LEAST_POSE_PX) else None


def _rms(rig: Rig, shots: Sequence[Shot]) -> float:
    """Rms distance in px of the corners of one pose from where the rig sees them, at the best pose."""
    theta = rig.parameters
    camera = shots[0].camera
    turn = cv2.Rodrigues(theta[camera, 9:12])[0]
    seen = board_pose(shots[0], rig.cameras[camera])
    start = np.column_stack([turn.T @ seen[:3, :3], turn.T @ (seen[:3, 3] - theta[camera, 12:])])
    pose = np.concatenate([np.ravel(cv2.Rodrigues(start[:, :3])[0]), start[:, 3]])
    residual = np.empty(0)
    for _ in range(POSE_STEPS):
        residual, slope = _residual(theta, shots, pose)
        pose = pose + np.linalg.lstsq(slope, residual, rcond=None)[0]
    return float(np.sqrt(np.mean(np.sum(residual.reshape(-1, 2) ** 2, axis=1))))


def _residual(theta: Array, shots: Sequence[Shot], pose: Array) -> tuple[Array, Array]:
    """Residuals (m,) px of all corners, and their derivatives (m,6) to the pose."""
    parts = [(v, project(theta[v.camera], pose[:3], pose[3:], v.points)) for v in shots]
    residual = np.concatenate([(v.pixels - pixels).ravel() for v, (pixels, _, _) in parts])
    return residual, np.concatenate([slope for _, (_, _, slope) in parts])
