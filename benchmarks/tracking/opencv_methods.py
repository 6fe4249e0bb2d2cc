"""Displacement errors of this package and its fallbacks beside OpenCV's own methods, on one drawn film.

    python benchmarks/tracking/opencv_methods.py [--quick] [--size PX ...]

The scene of markers.py: markers move by 8 px and turn by up to 90 degrees. Corners are detected in every
frame and their diagonals cut in undistorted px; ECC lays the mean reference picture on the frame by a
homography from the corners on; LK follows the centre alone. All displacements are against the mean of the
reference. The fallbacks place every marker from its detected corners on, as they do where registration fails;
only they and registration state an sd: a pull is error over it. CORNER_REFINE_APRILTAG returns corners half a
pixel off, which a displacement does not show.
"""

import os
import sys
import time
from collections.abc import Callable
from unittest.mock import patch

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.tracking.markers import REFERENCE, Frames, Scene, bound, displacement, film, scene, tracked

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.dictionaries import dictionary_of
from vision.following import fallback
from vision.following import tracks as methods
from vision.following.registration import centre_covariance, project
from vision.following.tracking import centres
from vision.marks import corner_warp, detect, linear_at_centre

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Method = Callable[[Scene, Frames], tuple[Array, Array | None]]  # ideal px (t,p,2), variance (t,p,2) if stated
ORIGIN = np.array([[0.0], [0.0], [1.0]])


def corners(picture: Image, mode: int) -> dict[int, Array]:
    """Corners (4,2) raw px by id."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = mode
    parameters.cornerRefinementWinSize = 3
    parameters.relativeCornerRefinmentWinSize = 1.0
    parameters.minMarkerPerimeterRate = 4.0 * 12.0 / max(picture.shape)
    found, ids, _ = cv2.aruco.ArucoDetector(dictionary_of("DICT_4X4_50"), parameters).detectMarkers(picture)
    off = 0.5 if mode == cv2.aruco.CORNER_REFINE_APRILTAG else 0.0
    names = [] if ids is None else np.asarray(ids).reshape(-1).tolist()
    return {n: np.asarray(c, dtype=np.float64).reshape(4, 2) - off for n, c in zip(names, found, strict=True)}


def homography(source: Array, target: Array) -> Array:
    shift = target.mean(axis=0)
    warp = cv2.getPerspectiveTransform(source.astype(np.float32), (target - shift).astype(np.float32))
    return np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1.0]]) @ warp


def by_corners(mode: int) -> Method:
    square = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])

    def track(s: Scene, pictures: Frames) -> tuple[Array, None]:
        place = np.full((*s.place.shape[:2], 2), np.nan)
        for t, picture in enumerate(pictures.pictures):
            for p, quad in corners(picture, mode).items():
                place[t, p] = project(homography(square, s.camera.undistort(quad)), ORIGIN)[0]
        return place, None

    return track


def by_fallback(code: methods.Method) -> Method:
    """ECC or corners of `vision.following.fallback`, on every marker."""

    def track(s: Scene, pictures: Frames) -> tuple[Array, Array]:
        follower, found = tracked(s, pictures)
        warp, match = np.full_like(found.warp, np.nan), np.zeros(found.method.shape)
        spread = np.full_like(found.covariance, np.nan)
        least = 2.0 if code == methods.Method.CORNERS else fallback.MIN_ECC  # no correlation is above 1
        with patch.object(fallback, "MIN_ECC", least):
            for t, picture in enumerate(pictures.pictures):
                seen = detect(picture, "DICT_4X4_50")[0]
                for p in seen.keys() & set(range(len(s.marks))):
                    quad = s.camera.undistort(seen[p])
                    corners = quad if code == methods.Method.CORNERS else None
                    warp[t, p], match[t, p], _, spread[t, p] = fallback.place(
                        picture, follower, p, corner_warp(quad), corners, found.warp[max(t - 1, 0), p]
                    )
        if code == methods.Method.ECC:
            plain = centre_covariance(follower.templates, linear_at_centre(warp), match)
            spread = fallback.ECC_SD**2 * plain
        return centres(warp, follower.centre), np.diagonal(spread, axis1=2, axis2=3)

    return track


def mean_picture(pictures: Frames) -> NDArray[np.float32]:
    return np.asarray(np.mean(pictures.pictures[:REFERENCE], axis=0), dtype=np.float32)


def by_ecc(s: Scene, pictures: Frames) -> tuple[Array, None]:
    """Raw centre of the reference, carried by the ECC homography."""
    reference, raw = mean_picture(pictures), s.camera.distort(s.ideal()[0])
    first = corners(pictures.pictures[0], cv2.aruco.CORNER_REFINE_SUBPIX)
    place = np.full((*s.place.shape[:2], 2), np.nan)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 60, 1e-7)
    for t, picture in enumerate(pictures.pictures):
        now = corners(picture, cv2.aruco.CORNER_REFINE_SUBPIX)
        for p in first.keys() & now.keys():
            (left, top), (right, bottom) = first[p].min(axis=0).astype(int) - 2, first[p].max(axis=0) + 4
            part = reference[top : int(bottom), left : int(right)]
            start = homography(first[p] - (left, top), now[p])
            try:
                _, warp = cv2.findTransformECC(
                    part,
                    picture.astype(np.float32),
                    (start / start[2, 2]).astype(np.float32),
                    cv2.MOTION_HOMOGRAPHY,
                    stop,
                    None,
                    3,
                )
            except cv2.error:
                continue
            centre = project(
                np.asarray(warp, dtype=np.float64), np.array([*(raw[p] - (left, top)), 1.0])[:, None]
            )
            place[t, p] = s.camera.undistort(centre[0])
    return place, None


def by_lk(s: Scene, pictures: Frames) -> tuple[Array, None]:
    """Pyramidal Lucas-Kanade from frame to frame of the reference picture's centres."""
    reference = np.clip(np.rint(mean_picture(pictures)), 0, 255).astype(np.uint8)
    raw = np.ascontiguousarray(s.camera.distort(s.ideal()[0])[:, None], dtype=np.float32)
    side = round(s.marks[0].size_mm * 4.0)
    place, guess = np.full((*s.place.shape[:2], 2), np.nan), raw.copy()
    for t, picture in enumerate(pictures.pictures):
        guess, good, _ = cv2.calcOpticalFlowPyrLK(
            reference, picture, raw, guess, winSize=(side, side), flags=cv2.OPTFLOW_USE_INITIAL_FLOW
        )
        guess = np.ascontiguousarray(guess)
        found = s.camera.undistort(guess[:, 0].astype(np.float64))
        place[t] = np.where(good == 1, found, np.nan)
    return place, None


def ours(s: Scene, pictures: Frames) -> tuple[Array, Array]:
    found = tracked(s, pictures)[1]
    return found.ideal, np.diagonal(found.covariance, axis1=2, axis2=3)


METHODS: dict[str, Method] = {
    "this package": ours,
    "its fallback, ECC": by_fallback(methods.Method.ECC),
    "its fallback, corners": by_fallback(methods.Method.CORNERS),
    "ECC homography": by_ecc,
    "corners CONTOUR": by_corners(cv2.aruco.CORNER_REFINE_CONTOUR),
    "corners SUBPIX 3": by_corners(cv2.aruco.CORNER_REFINE_SUBPIX),
    "corners APRILTAG - 0.5": by_corners(cv2.aruco.CORNER_REFINE_APRILTAG),
    "corners NONE": by_corners(cv2.aruco.CORNER_REFINE_NONE),
    "LK": by_lk,
}


def main() -> int:
    """Print a table for each marker size."""
    typed = options(__doc__, {"--size": {"type": float, "nargs": "+", "default": [20.0, 40.0]}},
                    quick="8 moving frames instead of 40")  # fmt: skip
    for size in typed.size:
        s = scene(size, 8 if typed.quick else 40, int(size))
        pictures = film(s, int(size))
        truth = displacement(s.ideal())
        limit = bound(s, np.array([REFERENCE])) + bound(s, np.array([0])) / REFERENCE
        floor = float(np.sqrt(np.mean(np.diagonal(limit, axis1=2, axis2=3))))
        head = "rms / px | over the bound | stated / px | pull | lost | CPU ms/frame"
        print(f"\n| {size:g} px, bound {floor:.4f} px | {head} |\n|---|---|---|---|---|---|---|")
        for name, method in METHODS.items():
            began = time.process_time()
            place, variance = method(s, pictures)
            error = displacement(place) - truth
            each = 1e3 * (time.process_time() - began) / len(s.place)
            rms = float(np.sqrt(np.nanmean(error**2)))
            lost = 100 * float(np.isnan(error[..., 0]).mean())
            stated, pull = "", ""
            if variance is not None:
                whole = variance[REFERENCE:] + np.nanmean(variance[:REFERENCE], axis=0) / REFERENCE
                stated = f"{np.sqrt(np.nanmean(whole)):.4f}"
                pull = f"{np.sqrt(np.nanmean(error**2 / whole)):.2f}"
            print(
                f"| {name} | {rms:.4f} | {rms / floor:.1f} | {stated} | {pull} | {lost:.0f} % | {each:.0f} |",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
