"""Boards on real photographs: error over stated sd of what is located, against the plane it is printed on.

    python benchmarks/tracking/photos.py [--quick] [--json]

`photo_pulls` has one number a board; 1 is right, 0.7 to 1.4 is wanted. Each is the root of chi2 by degrees of
freedom of what a homography, weighted by the covariance, leaves.
`gboriginal.png`: centres of 35 markers on a sheet of paper, seen at 50 degrees by a camera that sharpens. How
far markers lie off their plane was chosen on it.
`left`, `right`: corners of a chessboard, two cameras. Lens, its covariance and the noise of a corner come
from three quarters of the 13 pictures, the others are tested.
`cam_0` to `cam_3`: centres of a board's markers in films of it, H.264. Lenses come from the frames that
`camera_of_film` chooses, the others are tested.
"""

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import SHARED
from benchmarks.commandline import whole

import cv2
import numpy as np
from scipy.linalg import null_space
from scipy.optimize import least_squares

from vision import Camera, Video, locate
from vision.boards.charuco import CharucoBoard
from vision.boards.chessboard import Chessboard
from vision.calibration.boardfilms import chosen, read_board_film
from vision.calibration.intrinsics import camera_from, read_picture
from vision.calibration.lens import covariance, fit_models
from vision.camera import Array, Image
from vision.following.markercentres import Located
from vision.plane import fit_homography

SURE = 0.8  # correlation
FOLDS, CAMERAS = 4, (0, 1, 2, 3)
BOARD = CharucoBoard(
    columns=4, rows=5, square_mm=54.0, marker_mm=40.5, dictionary="DICT_4X4_1000", inverted=True
)


def chi2(plane: Array, centre: Array, covariance: Array) -> tuple[float, int]:
    """Weighted squares that the best homography leaves, and the degrees of freedom."""
    weight = np.linalg.cholesky(np.linalg.inv(covariance))
    local = np.column_stack([(plane - plane.mean(axis=0)) / np.ptp(plane), np.ones(len(plane))])
    start = fit_homography(local[:, :2], centre).ravel()[:8]

    def residual(amplitude: Array) -> Array:
        seen = local @ np.append(amplitude, 1.0).reshape(3, 3).T
        return np.einsum("nij,ni->nj", weight, centre - seen[:, :2] / seen[:, 2:]).ravel()

    left = least_squares(residual, start, x_scale=np.maximum(np.abs(start), 1e-3)).fun
    return float(left @ left), len(left) - 8


def photograph(folder: Path) -> tuple[float, int, float, float]:
    """Chi2, degrees of freedom, rms error and rms stated sd (px) on the photograph."""
    picture = np.asarray(cv2.imread(str(folder / "gboriginal.png"), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    found = locate(picture, dictionary=str(folder / "tutorial_dict.yml"))
    plane = np.stack([found.ids % 5, found.ids // 5], axis=1) * 50.0
    flat = np.column_stack([plane, np.ones(len(plane))]) @ fit_homography(plane, found.centre).T
    error = found.centre - flat[:, :2] / flat[:, 2:]
    sd = np.sqrt(np.mean(np.trace(found.covariance, axis1=1, axis2=2)) / 2.0)
    return (*chi2(plane, found.centre, found.covariance), float(np.sqrt(np.mean(error**2))), float(sd))


def chessboard(folder: Path, side: str) -> tuple[float, int]:
    """Chi2 and degrees of freedom of corners in pictures that their lens was not calibrated on."""
    board = Chessboard(columns=9, rows=6, square_mm=25.0)
    pictures = [read_picture(path, board) for path in sorted(folder.glob(f"{side}*.jpg"))]
    views, size = [board.find(picture) for picture in pictures], pictures[0].shape[::-1]
    total, degrees = 0.0, 0
    for fold in range(FOLDS):
        kept = [view for k, view in enumerate(views) if k % FOLDS != fold]
        fit = fit_models(kept, size)[0]
        error = np.concatenate([r.ravel() for r in fit.residuals])
        noise = float(error @ error) / (error.size - 4 - len(fit.camera.model) - 6 * len(kept))
        lens = replace(fit.camera, covariance=covariance(fit, kept)[0])
        for view in views[fold::FOLDS]:
            told = _foretold(lens, noise, view.points[:, :2], view.pixels)
            total, degrees = total + told[0], degrees + told[1]
    return total, degrees


def _foretold(lens: Camera, noise: float, plane: Array, pixels: Array) -> tuple[float, int]:
    """Chi2 and degrees of freedom of corners (n,2) px with that variance px2, and an error of their lens."""
    ideal = lens.undistort(pixels)

    def flat(eight: Array) -> Array:
        seen = local @ np.append(eight, 1.0).reshape(3, 3).T
        return np.asarray((seen[:, :2] / seen[:, 2:] - ideal).ravel())

    local = np.column_stack([(plane - plane.mean(axis=0)) / np.ptp(plane), np.ones(len(plane))])
    fit = least_squares(flat, fit_homography(local[:, :2], ideal).ravel()[:8], x_scale="jac")
    power, turn = np.linalg.eigh(lens.covariance)
    modes = np.array([(lens.moved(change).undistort(pixels) - ideal).ravel()
                      for change in (np.sqrt(np.maximum(power, 0.0)) * turn).T])  # fmt: skip
    free = null_space(fit.jac.T)
    left, shared = free.T @ fit.fun, modes @ free
    return float(left @ np.linalg.solve(noise * np.eye(len(left)) + shared.T @ shared, left)), len(left)


def board_film(folder: Path, camera: int, every: int) -> tuple[float, int]:
    """Chi2 and degrees of freedom on every n-th picture of the board that did not calibrate the lens."""
    film = Video(folder / f"cam_{camera}.mp4")
    taken = chosen(read_board_film(film, BOARD))
    pictures = {i: picture for i, _, picture in film.frames()}
    lens = camera_from([BOARD.black_on_white(pictures[i]) for i in taken], [str(i) for i in taken], BOARD)
    printed = BOARD.opencv
    corners = zip(np.ravel(printed.getIds()), printed.getObjPoints(), strict=True)
    place = {int(i): np.asarray(four).reshape(4, 3).mean(axis=0)[:2] for i, four in corners}
    total, degrees = 0.0, 0
    for index in [i for i in pictures if i not in taken][::every]:
        seen = _on_board(pictures[index], place, lens)
        if seen is not None:
            told = chi2(
                np.array([place[int(i)] for i in seen.ids]), lens.undistort(seen.centre), seen.covariance
            )
            total, degrees = total + told[0], degrees + told[1]
    return total, degrees


def _on_board(picture: Image, place: dict[int, Array], lens: Camera) -> Located | None:
    """The board's markers where at least seven are seen."""
    found = locate(BOARD.black_on_white(picture), dictionary=BOARD.dictionary, camera=lens)
    kept = np.isin(found.ids, list(place)) & (found.correlation > SURE)
    if kept.sum() < 7:
        return None
    names = ("ids", "centre", "covariance")
    return replace(found, **{name: getattr(found, name)[kept] for name in names})


def figures(quick: bool) -> dict[str, Any]:
    """`photo_pulls` {board: pull}, of the boards whose pictures are there, and `photo_pull` of the first."""
    pulls, told = dict[str, float](), dict[str, Any]()
    if (SHARED / "opencv_boards").is_dir():
        value, degrees, rms, sd = photograph(SHARED / "opencv_boards")
        pulls["gboriginal"] = _pull(value, degrees)
        told |= {"photo_rms_px": round(rms, 4), "photo_sd_px": round(sd, 4)}
        pulls |= {side: _pull(*chessboard(SHARED / "opencv_boards", side)) for side in ("left", "right")}
    if (SHARED / "charuco_4cam").is_dir():
        films = {f"cam_{c}": board_film(SHARED / "charuco_4cam", c, 2 if quick else 1) for c in CAMERAS}
        pulls |= {name: _pull(*found) for name, found in films.items()}
    return {"photo_pull": pulls.get("gboriginal"), "photo_pulls": pulls or None, **told}


def _pull(value: float, degrees: int) -> float:
    return round(float(np.sqrt(value / degrees)), 3)


if __name__ == "__main__":
    sys.exit(whole(__doc__, figures, quick="half of the pictures of the films"))
