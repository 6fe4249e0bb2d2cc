"""The displacement field of a speckled surface between two pictures, from a grid of registered subsets.

Subsets are patches of `registration` (ZNSSD, cubic B-spline) with an affine warp. The search begins at
a seed and goes on from neighbour to neighbour, the best correlated first, doi 10.1364/AO.48.001535.
"""

import heapq
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from vision.camera import Array, Image
from vision.following import registration
from vision.following.curvature import Curvature, curvature_of, straightened
from vision.following.registration import NO_LENS, Templates

# Noise is smaller between pixels than on them, which pulls a match there: 0.003 px of bias at 0.1 px of shift
# without this blur, 0.0005 with it; doi 10.1007/s11340-013-9717-7.
BLUR_PX = 0.8
MIN_CORRELATION = 0.9
MIN_CONTRAST = 4.0  # grey levels, sd within a subset after the blur
SEARCH_PX = 30  # how far a seed is looked for
NEIGHBOURS = 8
SEEDS = 5  # subsets tried as seeds, the best textured first

Smooth = NDArray[np.float32]


@dataclass(frozen=True)
class Subsets:
    """Patches of the reference picture."""

    centre: Array  # (p,2) px
    side: int  # px
    templates: Templates
    curvature: Curvature
    refused: tuple[str, ...]  # (p,) why a subset cannot be used, "" where it can


@dataclass(frozen=True, kw_only=True)
class Field:
    """Displacements of subsets; NaN with a reason where one is lost."""

    centre: Array  # (p,2) px in the reference
    displacement: Array  # (p,2) px
    gradient: Array  # (p,2,2) du_i / dx_j
    covariance: Array  # (p,2,2) px2 of the displacement
    correlation: Array  # (p,)
    reason: tuple[str, ...]  # (p,) "" where it is found


def grid_of(mask: NDArray[np.bool_], *, subset: int, step: int) -> Array:
    """Centres (p,2) px, step px apart, of the subsets that lie wholly in the mask (h,w)."""
    if subset < 9 or subset % 2 == 0 or step < 1:
        raise ValueError(
            f"subset of {subset} px and step of {step} px: wanted an odd subset of at least 9 px, a step of 1"
        )
    half = subset // 2
    inside = cv2.erode(
        np.pad(mask.astype(np.uint8), 1), np.ones((subset, subset), np.uint8), borderType=cv2.BORDER_CONSTANT,
        borderValue=0,
    )[1:-1, 1:-1]  # fmt: skip
    rows, columns = np.arange(half, mask.shape[0] - half, step), np.arange(half, mask.shape[1] - half, step)
    y, x = np.meshgrid(rows, columns, indexing="ij")
    keep = inside[y, x] > 0
    return np.stack([x[keep], y[keep]], axis=1).astype(np.float64)


def smooth(image: Image | Smooth) -> Smooth:
    """The picture as it is matched: blurred by BLUR_PX."""
    return np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), BLUR_PX), dtype=np.float32)


def cut(reference: Smooth, centre: Array, *, subset: int) -> Subsets:
    """Subsets of a smoothed reference picture (h,w) round centres (p,2) px.

    subset: px, side of a subset, odd.
    """
    half = 0.5 * (subset - 1)
    warp = _at(centre, half)
    grid = registration.local_grid(subset, 1.0)
    patch = registration.patches(reference, NO_LENS, warp, grid)
    contrast = patch[:, 0].std(axis=1)
    limit = np.array(reference.shape[::-1]) - 1.0 - half
    inside = ((centre >= half) & (centre <= limit)).all(axis=1)
    refused = np.where(inside, np.where(contrast < MIN_CONTRAST, "no texture", ""), "outside the picture")
    flat = contrast < MIN_CONTRAST
    patch[flat, 0] += 0.1 * np.sin(9 * grid[0]) * np.sin(7 * grid[1])  # can be normalised, is never matched
    patch[flat, 1:] += np.stack([np.cos(9 * grid[0]), np.cos(7 * grid[1])])
    templates = affine_templates(patch, grid)
    curvature = curvature_of(centre, half, patch, templates)
    return Subsets(centre, subset, templates, curvature, tuple(map(str, refused)))


def affine_templates(patch: Array, grid: Array) -> Templates:
    """Templates as of `registration.templates` whose steps change the six affine parameters only.

    Laid by a homography, they stay on the plane that it belongs to: perspective is kept, not fitted.
    """
    full = registration.templates(patch, grid)
    information = np.linalg.inv(full.covariance)[:, :6, :6]
    covariance = np.linalg.inv(information)
    slope = np.linalg.solve(full.covariance, full.step.transpose(0, 2, 1))[:, :6]
    step = np.zeros(full.step.shape)
    step[:, :, :6] = (covariance @ slope).transpose(0, 2, 1)
    padded = np.zeros(full.covariance.shape)
    padded[:, :6, :6] = covariance
    return Templates(grid, full.grey, step, padded)


def field(subsets: Subsets, picture: Smooth) -> Field:
    """Displacements of the subsets from the reference to a smoothed picture (h,w)."""
    half, count = 0.5 * (subsets.side - 1), len(subsets.centre)
    usable = np.array([not why for why in subsets.refused])
    warp, match = np.full((count, 3, 3), np.nan), np.zeros(count)
    for seed in _seeds(subsets, usable):
        if match[seed] > MIN_CORRELATION:
            continue
        start = _looked_for(subsets, picture, seed)
        _grow(subsets, picture, seed, start, usable, warp, match)
    lost = f"nothing like it within reach (correlation above {MIN_CORRELATION:g})"
    reason = [why or ("" if match[p] > 0 else lost) for p, why in enumerate(subsets.refused)]
    good = np.array([not why for why in reason])
    match = np.where(good, match, np.nan)
    linear = warp[:, :2, :2]
    own = centre_covariance(subsets.templates, np.full(count, half), match)
    place, covariance = straightened(
        subsets.curvature, np.where(good[:, None], warp[:, :2, 2], np.nan), linear,
        np.einsum("pij,pjk,plk->pil", linear, own, linear), np.zeros((count, 2)),
    )  # fmt: skip
    gradient = linear / half - np.eye(2)
    return Field(
        centre=subsets.centre,
        displacement=place - subsets.centre,
        gradient=gradient,
        covariance=covariance,
        correlation=match,
        reason=tuple(reason),
    )


def centre_covariance(templates: Templates, scale: Array, correlation: Array) -> Array:
    """Covariance (...,p,2,2) of the subset's centre in local units, from what its fit leaves.

    scale: (p,) px per local unit.   correlation: (...,p).
    White noise that went through the blur is correlated: its variance before the blur is what the fit
    leaves over the blur's energy, and each step sums it with the blurred weights.
    """
    side = round(float(np.sqrt(templates.grid.shape[1])))
    pitch = 2.0 / (side - 1) * float(np.median(scale))  # px between the patch points
    weights = templates.step[:, :, [2, 5]].transpose(0, 2, 1).reshape(-1, 2, side, side)
    impulse = np.zeros((41, 41))
    impulse[20, 20] = 1.0
    energy = float((gaussian_filter(impulse, BLUR_PX) ** 2).sum())
    blurred = np.pad(weights, ((0, 0), (0, 0), (4, 4), (4, 4)))
    blurred = gaussian_filter(blurred, (0, 0, BLUR_PX / pitch, BLUR_PX / pitch), mode="constant")
    each = np.einsum("pixy,pjxy->pij", blurred, blurred)
    left = (1.0 - np.minimum(correlation, 1.0) ** 2) / (templates.grid.shape[1] - 8)
    return np.asarray(each * (left / energy)[..., None, None])


def _at(centre: Array, half: float) -> Array:
    warp = np.zeros((len(centre), 3, 3))
    warp[:, [0, 1], [0, 1]], warp[:, 2, 2], warp[:, :2, 2] = half, 1.0, centre
    return warp


def _seeds(subsets: Subsets, usable: NDArray[np.bool_]) -> list[int]:
    """Usable subsets to begin at: the surest to be placed first, spread over the list."""
    sure = np.trace(subsets.templates.covariance[:, [[2], [5]], [[2, 5]]], axis1=1, axis2=2)
    order = [int(p) for p in np.argsort(sure) if usable[p]]
    return order[: SEEDS * 4 : 4] + order[:: max(len(order) // SEEDS, 1)]


def _looked_for(subsets: Subsets, picture: Smooth, seed: int) -> Array:
    """Start (3,3) of a seed: the best whole-pixel match within SEARCH_PX."""
    half, reach = subsets.side // 2, SEARCH_PX
    patch = subsets.templates.grey[seed].reshape(subsets.side, subsets.side).astype(np.float32)
    x, y = np.round(subsets.centre[seed]).astype(int)
    left, top = max(x - half - reach, 0), max(y - half - reach, 0)
    region = picture[top : y + half + reach + 1, left : x + half + reach + 1]
    score = cv2.matchTemplate(np.ascontiguousarray(region), patch, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    return _at(np.array([[left + column + half, top + row + half]], dtype=np.float64), float(half))[0]


def _grow(
    subsets: Subsets,
    picture: Smooth,
    seed: int,
    start: Array,
    usable: NDArray[np.bool_],
    warp: Array,
    match: Array,
) -> None:
    """Register the seed and, from neighbour to neighbour, all that hangs together with it, in place."""
    half = 0.5 * (subsets.side - 1)
    waiting, pushed = [(0.0, 0, seed, start)], 0
    while waiting:
        _, _, p, guess = heapq.heappop(waiting)
        if match[p] > MIN_CORRELATION:
            continue
        laid, correlation = registration.register(
            picture, NO_LENS, subsets.templates, guess[None], np.array([half]), np.array([p])
        )
        if not correlation[0] > MIN_CORRELATION:
            continue  # another neighbour may bring a better start
        warp[p], match[p] = laid[0], correlation[0]
        near = np.argsort(np.hypot(*(subsets.centre - subsets.centre[p]).T), kind="stable")[
            1 : NEIGHBOURS + 1
        ]
        for q in near[usable[near] & (match[near] <= MIN_CORRELATION)]:
            moved = laid[0].copy()
            moved[:2, 2] += laid[0][:2, :2] @ (subsets.centre[q] - subsets.centre[p]) / half
            pushed += 1
            heapq.heappush(waiting, (-float(correlation[0]), pushed, int(q), moved))
