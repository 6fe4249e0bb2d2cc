"""Uncertainty of places in space: variances of each value, and errors shared by many."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vision.calibration.rig import Rig
from vision.camera import Array
from vision.errors.sharederrors import Named
from vision.errors.staticnoise import NoiseModel
from vision.following.markrotations import mean_seen
from vision.placing.clocks import Track, joined
from vision.placing.planeerrors import principal, uncorrelated
from vision.placing.triangulation import Places, Sight, places_of


def displacement(places: Places, reference: NDArray[np.intp]) -> Array:
    """Places (t,p,3) mm minus their mean over the reference."""
    return np.asarray(places.place - mean_seen(places.place[reference]))


def variances(noise: NoiseModel, rest: Places, now: Places, sight: Sight, blur: Array) -> dict[str, Array]:
    """Variance (t,p,3) mm2 of every place by its source, without coding.

    rest: of the static film, whose noise it is; it grows as the rays' geometry says.
    blur: (c,t,p) px2 more than the usual variance of a centre in each camera.
    """
    usual = np.nanmean(np.diagonal(rest.spread, axis1=2, axis2=3), axis=0)
    grown = np.diagonal(now.spread, axis1=2, axis2=3) / usual
    parts = {
        "static": np.maximum(noise.sd**2 - noise.common_sd**2, 0.0) * grown,
        "jitter": np.minimum(noise.common_sd, noise.sd) ** 2 * grown,
        "blur": through(now, sight, blur),
    }
    return {source: np.asarray(part) for source, part in parts.items()}


def through(places: Places, sight: Sight, more: Array) -> Array:
    """Variance (t,p,3) mm2 of the places from variance (c,t,p) px2 of the pixels, in each axis alike."""
    place = np.nan_to_num(places.place, nan=0.0)
    mapped = np.einsum("ctij,tpj->ctpi", places.matrices[..., :3], place) + places.matrices[..., None, :, 3]
    seen = mapped[..., :2] / mapped[..., 2:]
    slope = places.matrices[:, :, None, :2, :3] - seen[..., None] * places.matrices[:, :, None, 2:, :3]
    slope = slope / mapped[..., 2:, None]
    weight = 1.0 / sight.variance[:, None, list(sight.points)]
    inner = np.nansum(np.swapaxes(slope, -1, -2) @ slope * (more * weight**2)[..., None, None], axis=0)
    return np.asarray(np.diagonal(places.spread @ inner @ places.spread, axis1=2, axis2=3))


def px_per_mm(places: Places, rig: Rig) -> Array:
    """Pixels per mm (c,t,p) at the places."""
    depth = np.einsum("ctj,tpj->ctp", places.matrices[..., 2, :3], places.place)
    depth = depth + places.matrices[..., 2, 3][..., None]
    focal = np.array([c.matrix[0, 0] for c in rig.cameras])
    return np.asarray(focal[:, None, None] / depth)


def tilt(value: Array, nominal: Array, sd: float) -> Named:
    """The frame turned against the world: frame marks (f,3) mm are sd mm off their nominal places.

    Three independent turns, covariance sd^2 (sum [x]' [x])^-1 of a rigid fit; u errs by turn x u.
    """
    x = nominal - nominal.mean(axis=0)
    power, axes = np.linalg.eigh((x**2).sum() * np.eye(3) - x.T @ x)
    turns = (axes * sd / np.sqrt(power)).T
    return {f"frame:{k + 1}": np.cross(turn, value) for k, turn in enumerate(turns)}


def clock_modes(
    rig: Rig, sight: Sight, tracks: Sequence[Track], when: Array, lag: Array, sd: Array, value: Array
) -> Named:
    """Errors of displacements (t,p,3) mm that remain of the lags of the cameras, sd (c,) s."""
    modes = {}
    for k in np.flatnonzero(sd > 0):
        moved = places_of(rig, joined(sight, tracks, when, lag + sd * np.eye(len(sd))[k]))
        modes[f"camera_clock:{k + 1}"] = np.nan_to_num(displacement(moved, sight.reference) - value)
    return modes


def calibration(rig: Rig, sight: Sight, value: Array) -> Named:
    """Errors from the rig's parameters: each principal direction of their covariance moves it by 1 sd, and
    the same pixels are placed anew.

    The modes are turned to be uncorrelated over the film; those that add nothing are dropped.
    """
    if not rig.covariance.any():
        return {}
    errors = [
        np.nan_to_num(displacement(places_of(rig.moved(step), sight), sight.reference) - value)
        for step in principal(rig.covariance)
    ]
    turned = uncorrelated(np.array(errors))
    return {f"calibration:{k + 1}": mode for k, mode in enumerate(turned)}
