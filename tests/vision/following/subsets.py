"""Registration of subsets on a pair of pictures, such as those of the DIC Challenge, sample 5.

Subsets are registered, and grow from neighbour to neighbour, as those of a face do in a film
(`vision.measuring.face`): the second picture is looked at again until no more of them are found.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from vision.camera import Array, Image
from vision.following import registration
from vision.following.registration import NO_LENS, Templates
from vision.following.subsetbias import curvature_of, straightened
from vision.measuring.face import BLUR_PX, NEIGHBOURS, find_subsets, smooth

PICTURES = {
    0.0: "Sample5-000_X0.00_Y0.00_N2_C75_R10.tif",
    0.1: "Sample5-001_X0.10_Y0.10_N2_C100_R20.tif",
}  # commanded shift px in x and y
LOOKS = 20  # at most, at one picture


@dataclass(frozen=True, kw_only=True)
class Field:
    """Displacements of subsets; NaN where one is lost."""

    centre: Array  # (p,2) px in the reference
    displacement: Array  # (p,2) px
    gradient: Array  # (p,2,2) du_i / dx_j
    covariance: Array  # (p,2,2) px2 of the displacement
    correlation: Array  # (p,)


def field(
    reference: Image, picture: Image, *, subset: int, step: int, rough: tuple[float, float] = (0.0, 0.0)
) -> Field:
    """Displacements from the reference (h,w) to a picture (h,w), of subsets `step` px apart.

    subset: px, side of a subset, odd.   rough: px, about how far some of them moved.
    """
    half = 0.5 * (subset - 1)
    x, y = np.meshgrid(*(np.arange(subset // 2, size - subset // 2, step) for size in reference.shape[::-1]))
    centre = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)
    rest = np.zeros((len(centre), 3, 3))
    rest[:, [0, 1], [0, 1]], rest[:, 2, 2], rest[:, :2, 2] = half, 1.0, centre
    grid = registration.local_grid(subset, 1.0)
    patch = registration.patches(smooth(reference), NO_LENS, rest, grid)
    templates = registration.affine_templates(patch, grid)
    near = [np.argsort(np.hypot(*(centre - c).T), kind="stable")[1 : NEIGHBOURS + 1] for c in centre]
    last, count = rest.copy(), -1
    last[:, :2, 2] += rough
    for _ in range(LOOKS):
        (warp, match), last = find_subsets(
            picture, last, lens=NO_LENS, templates=templates, rest=rest, near=near
        )
        before, count = count, int(np.isfinite(match).sum())
        if count == before:
            break
    linear = warp[:, :2, :2]
    own = centre_covariance(templates, half, match)
    place, covariance = straightened(
        curvature_of(centre, half, patch, templates), warp[:, :2, 2], linear,
        np.einsum("pij,pjk,plk->pil", linear, own, linear), np.zeros((len(centre), 2)),
    )  # fmt: skip
    return Field(
        centre=centre,
        displacement=place - centre,
        gradient=linear / half - np.eye(2),
        covariance=covariance,
        correlation=match,
    )


def centre_covariance(templates: Templates, half: float, correlation: Array) -> Array:
    """Covariance (...,p,2,2) of the subset's centre in local units, from what its fit leaves.

    half: px per local unit.   correlation: (...,p).
    White noise that went through the blur is correlated: its variance before the blur is what the fit
    leaves over the blur's energy, and each step sums it with the blurred weights.
    """
    side = round(float(np.sqrt(templates.grid.shape[1])))
    pitch = 2.0 / (side - 1) * half  # px between the patch points
    weights = templates.step[:, :, [2, 5]].transpose(0, 2, 1).reshape(-1, 2, side, side)
    impulse = np.zeros((41, 41))
    impulse[20, 20] = 1.0
    energy = float((gaussian_filter(impulse, BLUR_PX) ** 2).sum())
    blurred = np.pad(weights, ((0, 0), (0, 0), (4, 4), (4, 4)))
    blurred = gaussian_filter(blurred, (0, 0, BLUR_PX / pitch, BLUR_PX / pitch), mode="constant")
    each = np.einsum("pixy,pjxy->pij", blurred, blurred)
    left = (1.0 - np.minimum(correlation, 1.0) ** 2) / (templates.grid.shape[1] - 8)
    return np.asarray(each * (left / energy)[..., None, None])


def read(path: Path) -> Any:
    """A picture in grey."""
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert picture is not None, path
    return picture


def trial(folder: Path, subset: int) -> list[tuple[float, Field]]:
    """Commanded shift px and measured field for each picture."""
    reference = read(folder / "Sample5_Reference.tif")
    return [
        (shift, field(reference, read(folder / name), subset=subset, step=subset))
        for shift, name in PICTURES.items()
    ]
