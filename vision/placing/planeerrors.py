"""Errors that one camera cannot see: heights off the plane, motion towards it, and its calibration."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Camera
from vision.errors.sharederrors import of_places, with_zero_y
from vision.marks import Mark, with_role
from vision.perspective import MOST_FRAMES, Viewpoint, to_own_plane, viewpoint
from vision.plane import fit_homography, to_plane

FAR_SHARE = 0.03  # of the picture's longer side, beyond the outermost corners: one square of a board or so
NEGLIGIBLE = 1e-4  # share of the calibration's variance that is left out of its modes
ALARM_SD = 5.0  # sds beyond which a change of apparent size is reported: once in 2 million values
# Interpolation and blur change the apparent size of a tag that turns by up to this much (drawn film).
SIZE_FLOOR = 3e-4
ON_RIG, AT_ONCE = 2, 0.5  # markers that are fixed and look changed, at least; and such a share of them


def height_modes(
    value: Array, place: Array, slope: Array, marks: Sequence[Mark], view: Viewpoint, *, sd_mm: float
) -> dict[str, Array]:
    """Errors (s,p,3) mm from the marks' heights, known to sd_mm: each is off by u dh / distance, and the
    places (p,2) mm by r dh / distance, r from the foot, where they are measured.   slope: (s,p,2,2) of
    these."""
    modes: dict[str, Array] = {}
    moved = np.nan_to_num(value) + with_zero_y(of_places(slope, np.nan_to_num(place - view.foot)))
    for p in with_role(marks, "finger"):
        mode = modes.setdefault(f"height:{marks[p].owner}", np.zeros(value.shape))
        mode[:, p] = moved[:, p] * sd_mm / view.distance
    return modes


def out_of_plane_modes(
    value: Array, place: Array, marks: Sequence[Mark], view: Viewpoint, *, sd_mm: float
) -> dict[str, Array]:
    """Errors (s,p,3) mm from motion towards the camera: it looks like one away from its foot.

    The mode is r dy / distance, r (mm) from the foot.
    value: (s,p,3) mm displacements.   place: (s,p,2) mm in the plane.   sd_mm: sd of dy at the largest
    displacement; it grows as `bulge` says.
    """
    modes: dict[str, Array] = {}
    share = bulge(value)
    for p in with_role(marks, "finger"):
        mode = modes.setdefault(f"out_of_plane:{marks[p].owner}", np.zeros(value.shape))
        mode[:, p, ::2] = np.nan_to_num(
            (place[:, p] - view.foot) * (share[:, p] * sd_mm / view.distance)[:, None]
        )
    return modes


def bulge(value: Array) -> Array:
    """Share (s,p) of the largest motion towards the camera that is there at displacements (s,p,3) mm.

    At rest there is none; between, it grows as the square root of the displacement, as the bulge of a
    finger's side face does (half of it is there at 0.3 of the displacement).

    >>> bulge(np.array([[[0.0, 0, 0]], [[0.0, 0, -2.5]], [[0.0, 0, -10.0]]])).ravel()
    array([0. , 0.5, 1. ])
    """
    size = np.hypot(value[..., 0], value[..., 2])
    top = np.nanmax(size, axis=0, initial=0.0)
    return np.asarray(np.sqrt(size / np.where(top > 0.0, top, 1.0)))


def calibration_modes(
    camera: Camera,
    ideal: Array,
    homography: Array,
    *,
    plane: Array,
    frame: Sequence[int],
    points: Sequence[int],
    height: Array,
    reference: NDArray[np.intp],
    slope: Array,
) -> dict[str, Array]:
    """Errors (s,p,3) mm from the camera's parameters, as far as the frame marks do not take them up.

    ideal: (s,m,2) px of all marks.   homography: (s,3,3).   plane: (f,2) mm places of the marks `frame`.
    points: the p rows that are given out.   height: (p,) mm.   reference: (r,) frames.
    slope: (s,p,2,2) of measured places.

    Each principal direction of the parameters' covariance moves the camera by 1 sd; the film's raw pixels
    are measured with it anew, the difference is a mode. The modes are then turned to be uncorrelated over
    the film and those that add nothing are dropped.
    """
    if not camera.covariance.any():
        return {}
    raw = camera.distort(ideal)

    def value(changed: Camera) -> tuple[Array, Array]:
        seen = to_plane(homography, changed.undistort(raw))
        rest = seen[reference][:, frame]
        visible = np.isfinite(rest[..., 0]).any(axis=0)
        moved = fit_homography(plane[visible], np.nanmean(rest[:, visible], axis=0))
        place = to_plane(np.tile(moved, (len(seen), 1, 1)), seen[:, points])
        place = to_own_plane(place, height, viewpoint(changed, homography[reference] @ moved))
        start = place[reference]
        count = np.maximum(np.isfinite(start).sum(axis=0), 1)
        rest = np.nan_to_num(start).sum(axis=0) / count
        return np.nan_to_num(place - rest), rest

    moves, rest = value(camera)
    changed = [value(camera.moved(step)) for step in principal(camera.covariance)]
    errors = np.array([u - moves + of_places(slope, place - rest) for u, place in changed])
    turned = uncorrelated(errors)
    modes = np.stack([turned[..., 0], np.zeros(turned.shape[:-1]), turned[..., 1]], axis=-1)
    return {f"calibration:{k + 1}": mode for k, mode in enumerate(modes)}


def principal(covariance: Array) -> Array:
    """Principal directions (k,n) of a covariance (n,n), 1 sd each: covariance = sum of their squares.

    >>> covariance = np.array([[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])  # the third is not fitted
    >>> steps = principal(covariance)
    >>> (steps.T @ steps).round(6)
    array([[4., 1., 0.],
           [1., 1., 0.],
           [0., 0., 0.]])
    """
    sd = np.sqrt(np.diag(covariance))
    fitted = sd > 0
    scale = sd[fitted]
    power, direction = np.linalg.eigh(covariance[np.ix_(fitted, fitted)] / np.outer(scale, scale))
    steps = np.zeros((len(scale), len(sd)))
    steps[:, fitted] = (direction * np.sqrt(np.maximum(power, 0.0))).T * scale
    return steps[::-1]


def uncorrelated(errors: Array) -> Array:
    """Modes (l,...) with the covariance of errors (k,...), largest first, none that adds nothing."""
    flat = errors.reshape(len(errors), -1)
    power, turn = np.linalg.eigh(flat @ flat.T)
    order = np.argsort(power)[::-1]
    remainder = 1.0 - np.cumsum(power[order]) / max(float(power.sum()), 1e-300)
    largest = order[: int(np.count_nonzero(remainder > NEGLIGIBLE)) + 1]
    return np.asarray((turn[:, largest].T @ flat).reshape(-1, *errors.shape[1:]))


def alarms(
    time: Array, size: Array, size_sd: Array, marks: Sequence[Mark], view: Viewpoint, *, sd_mm: float
) -> tuple[str, ...]:
    """One sentence for each mark whose apparent size says that it left the plane by more than is stated; one
    for all where marks of the rig, which cannot move, say so too.

    time: (s,) s.   size: (s,p) side against the reference's.   size_sd: (s,p) its sd.
    sd_mm: what is stated as out of plane. A mark nearer by dy looks larger by distance / (distance - dy); a
    tilted one looks smaller, so a smaller one may be either.
    """
    distance = abs(view.distance)  # larger is nearer, on whichever side the camera stands
    alarmed: dict[int, tuple[int, float, float]] = {}  # row of the mark: step, mm, sd
    for p, mark in enumerate(marks):
        # Skin stretches: that a part of a face grows says nothing of how far away it is.
        if mark.kind.stretches or not np.isfinite(size[:, p]).any():
            continue
        shift = distance * (1.0 - 1.0 / size[:, p])
        sd = distance * np.hypot(size_sd[:, p], SIZE_FLOOR)
        score = np.nan_to_num(np.abs(shift) / np.hypot(sd, sd_mm))
        worst = int(np.argmax(score))
        if score[worst] > ALARM_SD:
            alarmed[p] = worst, float(shift[worst]), float(sd[worst])
    rig = with_role(marks, "fixed")
    if len(of_rig := [p for p in rig if p in alarmed]) >= max(ON_RIG, AT_ONCE * len(rig)):
        return (_changed(alarmed, of_rig, time),)
    return tuple(_alarm(marks[p].name, float(time[k]), mm, sd, sd_mm) for p, (k, mm, sd) in alarmed.items())


def _changed(alarmed: dict[int, tuple[int, float, float]], rig: Sequence[int], time: Array) -> str:
    larger = sum(shift > 0 for _, shift, _ in alarmed.values()) > 0.5 * len(alarmed)
    start = min(float(time[alarmed[p][0]]) for p in rig)
    return (
        f"{len(alarmed)} markers look {'larger' if larger else 'smaller'} than at rest, as at {start:.3f} s, "
        f"and {len(rig)} of them are fixed to the rig, which does not move: the light or the camera changed. "
        "The stated errors do not cover that. Film again with exposure, focus and zoom locked, the "
        "stabiliser off, and steady light."
    )


def _alarm(name: str, time: float, shift: float, sd: float, sd_mm: float) -> str:
    larger = shift > 0
    where = "towards the camera" if larger else "away from the camera, tilted, or out of focus"
    return (
        f"Marker {name!r} looks {'larger' if larger else 'smaller'} at {time:.3f} s than at rest, as if it "
        f"moved {abs(shift):.1f} +- {sd:.1f} mm {where}. out_of_plane_sd_mm = {sd_mm:g} does not cover that: "
        "raise it, keep the finger from twisting, or add a second camera."
    )


def extrapolated(camera: Camera, ideal: Array, names: Sequence[str]) -> tuple[str, ...]:
    """One sentence where marks (t,m,2) ideal px come to where no board was seen in the calibration."""
    if not len(camera.covered):
        return ()
    hull = camera.covered.astype(np.float32)
    raw = camera.distort(ideal[:: max(len(ideal) // MOST_FRAMES, 1)])
    beyond = {}
    for p, name in enumerate(names):
        places = raw[np.isfinite(raw[:, p, 0]), p]
        distance = [-cv2.pointPolygonTest(hull, (float(x), float(y)), True) for x, y in places]
        if max(distance, default=0.0) > FAR_SHARE * max(camera.size):
            beyond[name] = max(distance)
    if not beyond:
        return ()
    far = max(beyond, key=lambda name: beyond[name])
    return (
        f"{len(beyond)} markers move to where no board was photographed, {far!r} by {beyond[far]:.0f} px. "
        "The lens is extrapolated there: photograph the board there too.",
    )
