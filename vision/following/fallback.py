"""A mark on which plain registration fails: by smoothed correlation (ECC), then by its four corners.

Noise, weak light and uneven light leave a mark's place but not its grey levels. Both ways are less certain
than registration, and say so. What covers a part of a mark must pass neither.
"""

import cv2
import numpy as np

from vision.camera import Array, Camera, Image
from vision.following import registration
from vision.following.reference import Follower
from vision.following.tracks import Method
from vision.marks import px_per_unit

SMOOTH = 5  # points (about px), side of the Gaussian filter on both patches
# Drawn marks of 20 to 46 px: in weak light (contrast 21 to 35 of 175, noise 4 to 6) the smoothed patches
# correlate by 0.98 to 0.996; where a strip covers 6 to 30 %, and registration fails, by 0.983 at the most.
MIN_ECC = 0.985
# Rms pull of ECC against the sd of a plain fit with that residual: 1.15 to 1.27 (31, 46 px), 1.4 (20 px).
ECC_SD = 1.25
# The corners' misfit against the last shape, of the side and in px: of 3617 drawn marks with a covered strip
# of 6 to 30 % that do not register, 4 pass, at most 0.32 px off.
MAX_MISFIT, MAX_MISFIT_PX = 0.01, 0.4
# Four corners with independent errors of sd s: the misfit's mean square is 5/4 s2 (5 degrees of freedom), the
# centre's variance s2 / 4. SUBPIX corners err together too, by some hundredths of a px.
CORNERS_SD, CORNERS_SD_PX = 0.2**0.5, 0.03
ITERATIONS, CHANGE = 60, 1e-6
AROUND = 0.25  # of the patch: what is cut round it, for it to move in
SQUARE = np.array([[-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0]])  # in ArUco's order

Place = tuple[Array, float, Method, Array]


def place(
    image: Image, follower: Follower, row: int, start: Array, corners: Array | None, last: Array
) -> Place:
    """Warp (3,3), correlation, method and, for corners, covariance (2,2) px2 of a mark; NaN when it is lost.

    row: of the coded marks.   start: (3,3) first guess.   corners: (4,2) ideal px as detected, or None.
    last: (3,3) where the mark was last seen.
    """
    none = np.full((2, 2), np.nan)
    warp, alike = ecc(image, follower.camera, follower.templates, row, start)
    if alike > MIN_ECC:
        return warp, _correlation(image, follower, row, warp), Method.ECC, none
    if corners is not None:
        warp, misfit = quad(corners, last)
        if misfit < min(MAX_MISFIT * 2.0 * float(px_per_unit(last)), MAX_MISFIT_PX):
            variance = (CORNERS_SD * misfit) ** 2 + CORNERS_SD_PX**2
            return warp, 0.0, Method.CORNERS, variance * np.eye(2)
    return np.full((3, 3), np.nan), 0.0, Method.LOST, none


def ecc(
    image: Image, camera: Camera, reference: registration.Templates, row: int, start: Array
) -> tuple[Array, float]:
    """Warp (3,3) that lays a reference patch on the picture, and the correlation of the two smoothed.

    row: of the reference.   start: (3,3) first guess.   Enhanced correlation coefficient of a homography, doi
    10.1109/TPAMI.2008.113. A correlation of 0 means that the search diverged or left the picture.
    """
    grid = reference.grid
    side, pitch = round(float(np.sqrt(grid.shape[1]))), float(grid[0, 1] - grid[0, 0])
    more = round(AROUND * side)
    wide = registration.local_grid(side + 2 * more, float(grid[0].max()) + more * pitch)
    seen = _square(registration.patches(image, registration.lens_of(camera), start[None], wide)[0, 0])
    shift = np.array([[1.0, 0.0, more], [0.0, 1.0, more], [0.0, 0.0, 1.0]], dtype=np.float32)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, ITERATIONS, CHANGE)
    try:
        alike, fitted = cv2.findTransformECC(
            _square(reference.grey[row]),
            seen,
            shift,
            cv2.MOTION_HOMOGRAPHY,
            stop,
            np.ones(seen.shape, dtype=np.uint8),
            SMOOTH,
        )
    except cv2.error:  # it did not converge
        return start, 0.0
    index = [np.array([[pitch, 0.0, g[0, 0]], [0.0, pitch, g[0, 0]], [0.0, 0.0, 1.0]]) for g in (wide, grid)]
    warp = start @ index[0] @ np.asarray(fitted, dtype=np.float64) @ np.linalg.inv(index[1])
    warp /= warp[2, 2]
    edge = camera.distort(registration.project(warp, SQUARE * [[grid[0].max()], [grid[0].max()], [1.0]]))
    inside = np.all((edge >= 0.0) & (edge <= np.array(camera.size) - 1.0))  # False for NaN too
    return warp, float(alike) if inside else 0.0


def quad(corners: Array, last: Array) -> tuple[Array, float]:
    """The last warp (3,3) turned and shifted onto corners (4,2) ideal px, and their rms misfit in px.

    Least squares, doi 10.1109/34.88573. Size and shape stay as they were last: the misfit is what the corners
    say against it. An edge that is d px wrong puts the centre d / 2 off, and leaves a misfit of as much.
    """
    old = registration.project(last, SQUARE)
    a, b = old - old.mean(axis=0), corners - corners.mean(axis=0)
    angle = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    c, s = np.cos(angle), np.sin(angle)
    moved = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    moved[:2, 2] = corners.mean(axis=0) - moved[:2, :2] @ old.mean(axis=0)
    misfit = b - a @ moved[:2, :2].T
    return moved @ last, float(np.sqrt(np.mean(np.sum(misfit**2, axis=1))))


def _correlation(image: Image, follower: Follower, row: int, warp: Array) -> float:
    """Correlation of the reference patch with what the picture shows there, not smoothed."""
    grid = follower.templates.grid
    seen = registration.patches(image, registration.lens_of(follower.camera), warp[None], grid)[0, 0]
    return float(np.mean(_scaled(seen) * _scaled(follower.templates.grey[row])))


def _scaled(patch: Array) -> Array:
    return np.asarray((patch - patch.mean()) / max(float(patch.std()), 1e-9))


def _square(patch: Array) -> Array:
    side = round(float(np.sqrt(patch.size)))
    return np.asarray(_scaled(patch).reshape(side, side), dtype=np.float32)
