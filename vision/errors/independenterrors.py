"""The independent variance of every place, source by source."""

from dataclasses import dataclass

import numpy as np

from vision.camera import Array
from vision.errors.staticnoise import REST, NoiseModel, states, with_y
from vision.following.markrotations import mean_seen
from vision.following.tracks import COARSE, Followed, Method
from vision.plane import MIN_VISIBLE, Plane, place_noise, shared_noise

# Where these numbers come from: docs/records/error-numbers.md
OWN = 0.1  # least share of a mark's static variance that is its own and not the frame marks'
CLEARLY = 3.0  # times the usual residual variance
LEAST_MOVING = 0.25  # quantile of the residual variances of marks that move: less is not usual in any mark


@dataclass(frozen=True)
class Rest:
    """Noise of the static film, by its origin."""

    noise: NoiseModel
    frame_variance: float  # mm2, noise of one frame mark's centre in each axis
    pixel_variance: float  # px2, the same in the picture
    homography: Array  # (p,2) mm2, what the frame marks' noise adds to every place at rest
    common: Array  # (2,) mm2, what all marks share beyond that: shake that the frame marks do not show, light


def at_rest(noise: NoiseModel, plane: Plane, place: Array) -> Rest:
    """The static film's noise split into the marks' own and the homography's.

    place: (t,p,2) mm in the static film.

    The scatter of f frame marks about their own homography has 2 f - 8 degrees of freedom in every frame.
    """
    scatter = plane.residual - mean_seen(plane.residual)
    count = plane.seen.sum(axis=1)
    # Every mark's mean place is fitted too, the homography's own part of it not.
    free = np.sum(2 * count[count > MIN_VISIBLE] - 8) - (2 * np.count_nonzero(plane.seen.any(axis=0)) - 8)
    variance = float(np.nansum(scatter**2) / max(free, 1))  # mm2
    unit = mean_seen(np.diagonal(place_noise(plane, place), axis1=2, axis2=3))
    pixel_variance = variance * _px2_per_mm2(plane)
    # A mark that the static film hides takes the largest of the others, as its noise does.
    unit = np.where(np.isnan(unit), np.nanmax(unit, axis=0), unit)
    mean = mean_seen(place)
    shared = pixel_variance * shared_noise(plane, mean[np.isfinite(mean[:, 0])])
    together = noise.common_sd[[0, 2]] ** 2 - shared
    most = np.maximum(noise.sd[:, [0, 2]] ** 2 - pixel_variance * unit, 0.0).min(axis=0)
    return Rest(noise, variance, pixel_variance, pixel_variance * unit, np.clip(together, 0.0, most))


def _px2_per_mm2(plane: Plane) -> float:
    """Mean area scale of the homographies at the frame marks."""
    finite = plane.homography[np.isfinite(plane.homography[:, 0, 0])]
    x = np.column_stack([plane.nominal, np.ones(len(plane.nominal))])
    depth = np.einsum("tj,fj->tf", finite[:, 2], x)
    return float(np.mean(np.abs(np.linalg.det(finite))[:, None] / np.abs(depth) ** 3))


def independent(
    rest: Rest, plane: Plane, place: Array, worse: Array, frame: list[int], points: list[int]
) -> dict[str, Array]:
    """Variance (s,p,3) mm2 of every place by its source, without coding; y is NaN.

    place: (s,p,2) mm.   worse: (s,m) from `misfit`, rows frame and points of it.

    The static noise holds the homography's as it was at rest; what that is more or less now, where the mark
    is and with the frame marks that are seen, is a part of its own.
    """
    seen = plane.seen
    share = np.where(seen, worse[:, frame], 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    unit = np.diagonal(place_noise(plane, np.nan_to_num(place)), axis1=2, axis2=3)
    static = rest.noise.sd[:, [0, 2]] ** 2
    of_mark = np.maximum(static - rest.homography, OWN * static)
    now = rest.pixel_variance * share[:, None, None] * unit
    parts = {
        "static": np.broadcast_to(static - rest.common, now.shape),
        "jitter": np.broadcast_to(rest.common, now.shape),
        "homography": np.maximum(now - rest.homography, of_mark - static),
        "blur": (worse[:, points, None] - 1.0) * of_mark,
    }
    return {source: with_y(np.asarray(part)) for source, part in parts.items()}


def by_hand(parts: dict[str, Array], film: Followed, plane: Plane, points: list[int]) -> dict[str, Array]:
    """The variances with a part for places clicked by a person, mm2: their sd in px in the usual scale of the
    plane, in place of the misfit that such a place has none of."""
    clicked = (film.method[:, points] == Method.BY_HAND)[..., None]
    if not clicked.any():
        return parts
    size = 0.5 * np.trace(film.covariance[:, points], axis1=2, axis2=3) / _px2_per_mm2(plane)
    variance = np.where(clicked, size[..., None], 0.0) * (1.0, np.nan, 1.0)
    blur = np.where(clicked & np.isfinite(variance), 0.0, parts["blur"])
    return {**parts, "blur": blur, "by_hand": variance}


def misfit(followed: Followed) -> Array:
    """Ratio (t,m) of a patch's residual variance to its median over the film; 1 where it is normal.

    Blur, glare and what covers a part of a mark leave a residual. Usual is the median over the film: coding
    leaves two to three times more in some frames than in others, which the codec's term has. ECC and corners
    are never usual: a mark without plain registration takes the median of the others. Where coding repeats a
    picture nothing is left, so that what marks leave which move is usual too, the least quarter of it.
    A blur that was fitted has a variance of its own, which counts however little it is.
    """
    size = np.trace(followed.covariance, axis1=2, axis2=3) / followed.growth
    plain = np.isfinite(size) & ~np.isin(followed.method, COARSE)
    usual = np.array([np.median(x[s]) if s.any() else np.nan for x, s in zip(size.T, plain.T, strict=True)])
    moving = size[plain & (states(followed.ideal) != REST)]
    usual = np.fmax(usual, np.quantile(moving, LEAST_MOVING) if len(moving) else 0.0)
    finite = np.isfinite(usual) & (usual > 0.0)
    others = np.median(usual[finite]) if finite.any() else np.inf
    ratio = size / np.where(finite, usual, others)
    return np.where(ratio > CLEARLY, ratio, 1.0) * followed.growth
