"""Markers on real photographs: error over stated sd of their centres, against the plane they are glued on.

    python benchmarks/tracking/photos.py [--quick] [--json]

`gboriginal.png`: 35 markers on a sheet of paper, seen at 50 degrees by a camera that sharpens.
`charuco_4cam`: markers of a board that is moved by hand, H.264, two cameras; lenses as that recording stores
them (their boards fit to 0.4 and 0.5 px), so that the pull has their error too. A homography is fitted to the
centres, weighted by their covariance; the pull is the root of chi2 by degrees of freedom. 1 is right.
"""

import os
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import SHARED
from benchmarks.commandline import whole

import cv2
import numpy as np
from scipy.optimize import least_squares

from vision import Camera, Video, locate
from vision.boards.charuco import CharucoBoard
from vision.camera import Array, Image
from vision.following.markercentres import Located
from vision.plane import fit_homography

SURE = 0.8  # correlation
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


def board_film(folder: Path, camera: int, every: int) -> tuple[float, int]:
    """Chi2 and degrees of freedom on every n-th picture of the moving board."""
    stored = tomllib.loads((folder / "camera_array.toml").read_text())["cameras"][str(camera)]
    lens = Camera(np.array(stored["matrix"]), np.array(stored["distortions"]), tuple(stored["size"]))
    printed = BOARD.opencv
    corners = zip(np.ravel(printed.getIds()), printed.getObjPoints(), strict=True)
    place = {int(i): np.asarray(four).reshape(4, 3).mean(axis=0)[:2] for i, four in corners}
    total, degrees = 0.0, 0
    for index, _, picture in Video(folder / f"cam_{camera}.mp4").frames():
        seen = _on_board(picture, place, lens) if index % every == 0 else None
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
    """`photo_pull` of the photograph, `photo_film_pull` of the films; None where the data is absent."""
    told: dict[str, Any] = {"photo_pull": None, "photo_film_pull": None}
    if (SHARED / "opencv_boards").is_dir():
        value, degrees, rms, sd = photograph(SHARED / "opencv_boards")
        told["photo_pull"] = round(float(np.sqrt(value / degrees)), 3)
        told |= {"photo_rms_px": round(rms, 4), "photo_sd_px": round(sd, 4)}
    if (SHARED / "charuco_4cam").is_dir():
        films = [board_film(SHARED / "charuco_4cam", c, 12 if quick else 3) for c in (0, 1)]
        told["photo_film_pull"] = round(
            float(np.sqrt(sum(a for a, _ in films) / sum(b for _, b in films))), 3
        )
    return told


if __name__ == "__main__":
    sys.exit(whole(__doc__, figures, quick="a quarter of the pictures of the films"))
