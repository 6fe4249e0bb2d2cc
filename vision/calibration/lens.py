"""A camera from views of a board: every lens model fitted, the best by evidence, with its covariance; and
whether the lens of a camera is still the same in another film."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.boards.board import BoardView
from vision.boards.circles import centroid
from vision.camera import DISTORTION, Array, Camera
from vision.following.registration import project
from vision.plane import fit_homography, to_plane

MODELS: tuple[tuple[str, ...], ...] = (
    (),
    ("k1",),
    ("k1", "k2"),
    ("k1", "p1", "p2"),
    ("k1", "k2", "p1", "p2"),
    DISTORTION,
)
FIXED = {"k1": cv2.CALIB_FIX_K1, "k2": cv2.CALIB_FIX_K2, "k3": cv2.CALIB_FIX_K3}
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-12)


@dataclass(frozen=True)
class LensFit:
    """A camera and where its boards were."""

    camera: Camera
    turns: tuple[Array, ...]  # (v) of (3,) rotation vectors, board to camera
    shifts: tuple[Array, ...]  # (v) of (3,) mm
    residuals: tuple[Array, ...]  # (v) of (n,2) px, seen minus projected

    @property
    def bic(self) -> float:
        """Bayes' information criterion, doi 10.1214/aos/1176344136; corner noise of unknown size."""
        error = np.concatenate(self.residuals)
        free = 4 + len(self.camera.model) + 6 * len(self.turns)
        return float(error.size * np.log(np.mean(error**2)) + free * np.log(error.size))

    def view_rms(self) -> Array:
        """Rms distance (v,) px of each view's corners."""
        return np.array([np.sqrt(np.mean(np.sum(r**2, axis=1))) for r in self.residuals])


def fit_models(views: Sequence[BoardView], size: tuple[int, int]) -> list[LensFit]:
    """A fit with each lens model, best (lowest BIC) first."""
    return sorted((fit_lens(views, size, model) for model in MODELS), key=lambda fit: fit.bic)


def fit_lens(views: Sequence[BoardView], size: tuple[int, int], model: tuple[str, ...]) -> LensFit:
    """Zhang's method with the distortion terms of the model, doi 10.1109/34.888718.

    size: px, width and height. Circles are centred on the board as the fit sees it, where perspective and
    distortion do not shift them, and fitted again.
    """
    fit = _fit(views, size, model)
    for _ in range(2 if any(view.outlines for view in views) else 0):
        views = [centred(view, fit.camera) for view in views]
        fit = _fit(views, size, model)
    return fit


@contextmanager
def _one_thread() -> Iterator[None]:
    """OpenCV on one thread: several add up in the order in which they end, so that the last digits differ."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def _fit(views: Sequence[BoardView], size: tuple[int, int], model: tuple[str, ...]) -> LensFit:
    flags = sum(flag for name, flag in FIXED.items() if name not in model)
    flags += 0 if "p1" in model else cv2.CALIB_ZERO_TANGENT_DIST
    with _one_thread():
        rms, matrix, distortion, turns, shifts = cv2.calibrateCamera(
            [view.points.astype(np.float32) for view in views],
            [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in views],
            size,
            np.eye(3),
            np.zeros(5),
            flags=flags,
            criteria=STOP,
        )
    camera = Camera(
        np.asarray(matrix, dtype=np.float64),
        np.asarray(distortion, dtype=np.float64).reshape(-1)[:5],
        size,
        float(rms),
        len(views),
        model=model,
    )
    places = [
        (np.asarray(r, dtype=np.float64).ravel(), np.asarray(t, dtype=np.float64).ravel())
        for r, t in zip(turns, shifts, strict=True)
    ]
    residuals = [
        view.pixels - _projected(view, camera, *place)[0] for view, place in zip(views, places, strict=True)
    ]
    return LensFit(camera, tuple(r for r, _ in places), tuple(t for _, t in places), tuple(residuals))


def _projected(view: BoardView, camera: Camera, turn: Array, shift: Array) -> tuple[Array, Array]:
    """Pixels (n,2) of a view's points, and their derivatives (2n, 6 + 9): pose, then `parameters`."""
    pixels, slope = cv2.projectPoints(view.points, turn, shift, camera.matrix, camera.distortion)
    return (np.asarray(pixels, dtype=np.float64).reshape(-1, 2), np.asarray(slope, dtype=np.float64)[:, :15])


def centred(view: BoardView, camera: Camera) -> BoardView:
    """The view with each circle's centre where the centre of its outline lies on the board."""
    if not view.outlines:
        return view
    board = fit_homography(view.points[:, :2], camera.undistort(view.pixels))
    together = to_plane(board[None], camera.undistort(np.concatenate(view.outlines))[None])[0]
    outlines = np.split(together, np.cumsum([len(outline) for outline in view.outlines])[:-1])
    middle = np.array([[*centroid(outline), 1.0] for outline in outlines])
    return BoardView(view.points, camera.distort(project(board, middle.T)), view.outlines)


def covariance(fit: LensFit, views: Sequence[BoardView]) -> tuple[Array, float]:
    """Covariance (9,9) of the camera's `parameters`, and by what the pictures' own spread enlarges its sds.

    Gauss-Newton normal matrix of all corners with the boards' poses eliminated, times the variance of the
    residual. Corners of one picture share errors (a board that is not flat, light, blur): the sum of the
    pictures' gradients tells by how much they scatter more than independent corners would; where they do,
    the covariance is enlarged by that (one number, from pictures as clusters, doi 10.1093/biomet/73.1.13).
    """
    free = np.array([0, 1, 2, 3, *(4 + DISTORTION.index(name) for name in fit.camera.model)])
    parts = [_reduced(fit, view, i, free) for i, view in enumerate(views)]
    error = np.concatenate([r.ravel() for r in fit.residuals])
    variance = float(error @ error) / (error.size - len(free) - 6 * len(views))
    inverse = np.linalg.inv(sum(normal for normal, _ in parts))
    seen = sum(float(gradient @ inverse @ gradient) for _, gradient in parts) / variance
    shares = [inverse @ normal for normal, _ in parts]
    expected = len(free) - sum(float(np.trace(share @ share)) for share in shares)
    enlarged = max(seen / expected, 1.0)
    full = np.zeros((9, 9))
    full[np.ix_(free, free)] = variance * enlarged * inverse
    return full, float(np.sqrt(enlarged))


def _reduced(fit: LensFit, view: BoardView, index: int, free: np.ndarray) -> tuple[Array, Array]:
    """Normal matrix (k,k) and gradient (k,) of one view's corners, its pose eliminated."""
    _, slope = _projected(view, fit.camera, fit.turns[index], fit.shifts[index])
    pose, lens = slope[:, :6], slope[:, 6:][:, free]
    lens = lens - pose @ np.linalg.lstsq(pose, lens, rcond=None)[0]
    return lens.T @ lens, lens.T @ fit.residuals[index].ravel()


def view_misfit(camera: Camera, then: Array, now: Array, *, defines: NDArray[np.bool_]) -> float:
    """Rms distance in px of the markers of a flat rig from where the camera would see them.

    then, now: their centres (m,2) in the two films, raw px, in one order.   defines: (m,) which of them
    define the view, 4 or more; the others are tested, 1 or more.

    A pinhole camera sees a plane from two places in pictures that a homography maps onto each other exactly.
    With the wrong lens (another focus or zoom) something is left, and so it is where a marker was moved.
    """
    a, b = camera.undistort(then), camera.undistort(now)
    if defines.sum() < 4 or defines.all():
        raise ValueError(
            f"{int(defines.sum())} of {len(defines)} markers define the view; wanted 4 or more of them, and "
            "others to test it by"
        )
    foretold = camera.distort(_mapped(fit_homography(a[defines], b[defines]), a[~defines]))
    return float(np.sqrt(((foretold - now[~defines]) ** 2).sum(axis=1).mean()))


def _mapped(homography: Array, points: Array) -> Array:
    """Points (m,2) under a homography (3,3)."""
    out = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return np.asarray(out[:, :2] / out[:, 2:])
