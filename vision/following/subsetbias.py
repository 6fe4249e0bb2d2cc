"""Bias of an affine subset where strain has a gradient, and its correction.

In a field whose second derivative is u'' a subset of side s is found u'' s^2 / 24 off its centre, where its
texture is even: doi 10.1117/1.1314593. What its own texture makes of it follows from the steps of the
registration, and u'' from the subsets round it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.following.registration import Templates

ROUND = 8  # subsets round each that tell its second derivatives
HIGHER = 0.1  # of what is taken off: third derivatives, and what the linear rule misses


@dataclass(frozen=True)
class Curvature:
    """Second derivatives of each subset's field from its neighbours, and what they do to its centre."""

    near: NDArray[np.intp]  # (p,n) itself and the subsets round it
    second: Array  # (p,3,n) places in px to their second derivatives (xx, xy, yy), px per local unit squared
    effect: Array  # (p,2,6) shift in local units for second derivatives of both components, local units

    def shift(self, place: Array, linear: Array) -> Array:
        """Bias (p,2) px of subsets, from the places (p,2) px of all; NaN if one is lost.

        linear: (p,2,2) px per local unit.
        """
        second = np.einsum("pkn,pni->pik", self.second, place[self.near])
        local = np.linalg.solve(np.where(np.isfinite(linear), linear, np.eye(2)), second)
        return np.asarray(
            np.einsum("pij,pj->pi", linear, np.einsum("pcm,pm->pc", self.effect, local.reshape(-1, 6)))
        )

    def noise(self) -> Array:
        """Variance (p,) that white noise of unit variance in every place adds to a centre."""
        mixed = np.einsum("pcik,pkn->pcin", self.effect.reshape(-1, 2, 2, 3), self.second)
        mixed[..., 0] -= np.eye(2)  # the subset's own place, from which it is taken
        return np.asarray(0.5 * (mixed**2).sum(axis=(1, 2, 3)) - 1.0)


def curvature_of(centre: Array, half: float, patch: Array, templates: Templates) -> Curvature:
    """Curvature of subsets with centres (p,2) in the plane in which they are even.

    half: local unit in that plane.   patch: (p,3,n) grey levels and local slopes.   templates: made of it.
    """
    apart = np.linalg.norm(centre[:, None] - centre[None], axis=2)
    near = np.argsort(apart, axis=1, kind="stable")[:, : ROUND + 1]
    x, y = np.moveaxis((centre[near] - centre[:, None]) / half, -1, 0)
    terms = np.stack([np.ones_like(x), x, y, 0.5 * x * x, x * y, 0.5 * y * y], axis=-1)
    # What subsets do not tell, as those of one row across it, is 0.
    return Curvature(near, np.linalg.pinv(terms, rcond=1e-6)[:, 3:], _effect(patch, templates))


def _effect(patch: Array, templates: Templates) -> Array:
    """Shift (p,2,6) of the fitted centre for fields x^2/2, x y, y^2/2 in either component, local units."""
    x, y, _ = templates.grid
    field = np.stack([0.5 * x * x, x * y, 0.5 * y * y])
    size = np.linalg.norm(patch[:, 0] - patch[:, 0].mean(axis=1, keepdims=True), axis=1)[:, None, None]
    moved = np.concatenate([patch[:, 1, None] * field, patch[:, 2, None] * field], axis=1) / size
    return np.asarray(np.einsum("pnc,pmn->pcm", templates.step[:, :, [2, 5]], moved))


def straightened(
    curvature: Curvature, place: Array, linear: Array, covariance: Array, rest: Array
) -> tuple[Array, Array]:
    """Places (p,2) px with the shift by curvature taken off, and their covariance (p,2,2) px2.

    rest: (p,2) px that the rule gives at rest, which is no curvature of the material.

    Where a neighbour is lost the shift is not known: it is stated as an error, as large as those that are.
    """
    off = curvature.shift(place, linear) - rest
    finite = np.isfinite(off[:, 0])
    usual = np.mean(off[finite] ** 2, axis=0) if finite.any() else np.zeros(2)
    variance = np.where(finite[:, None], (HIGHER * np.nan_to_num(off)) ** 2, usual)
    noise = 0.5 * np.trace(covariance, axis1=1, axis2=2) * curvature.noise()
    added = np.eye(2) * (variance + np.where(finite, noise, 0.0)[:, None])[..., None]
    return np.where(finite[:, None], place - np.nan_to_num(off), place), covariance + added
