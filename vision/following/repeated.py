"""Markers of one id that a picture shows several times: which of them is the one that is meant."""

from collections.abc import Sequence

import numpy as np

from vision.camera import Array, Camera, Image
from vision.following.registration import project
from vision.marks import Mark, codes_of, corner_warp, detect_all
from vision.plane import MIN_VISIBLE, fit_homography

NEAR = 1.5  # sides of the marker: how far it may be from where the frame marks put it
CLEAR = 2.0  # times as far must all others of its id be


def told_apart(
    image: Image, camera: Camera, marks: Sequence[Mark], dictionary: str, seed: Array
) -> dict[int, Array]:
    """Warps (3,3) by row of marks that are missing because the picture shows several of their id.

    seed: (p,3,3) warps of the marks that are found, NaN for the others. The one that lies where the frame
    marks put its stated place is taken, if all others of its id lie clearly elsewhere, as on a second sheet.
    """
    frame = [p for p, mark in enumerate(marks) if mark.role == "frame" and np.isfinite(seed[p, 0, 0])]
    missing = {p: code for p, code in codes_of(marks).items() if np.isnan(seed[p, 0, 0])}
    if len(frame) < MIN_VISIBLE or not missing:
        return {}
    nominal = np.array([mark.position for mark in marks])[:, [0, 2]]
    homography = fit_homography(nominal[frame], seed[frame, :2, 2])
    seen, found = detect_all(image, dictionary), {}
    for p, code in missing.items():
        quads = [camera.undistort(quad) for name, quad in seen if name == code]
        side = marks[p].size_mm
        corners = np.column_stack([nominal[p] + [(0.0, 0.0), (side, 0.0)], np.ones(2)]).T
        place, beside = project(homography, corners)
        away = np.array([np.hypot(*(quad.mean(axis=0) - place)) for quad in quads])
        order = np.argsort(away)
        reach = NEAR * float(np.hypot(*(beside - place)))
        if len(quads) > 1 and away[order[0]] < reach and away[order[1]] > CLEAR * max(away[order[0]], reach):
            found[p] = corner_warp(quads[order[0]])
    return found
