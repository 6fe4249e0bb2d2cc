"""Registration of subsets on pictures of the DIC Challenge, sample 5, whose shifts are commanded.

    python benchmarks/tracking/dic.py [--quick] [--json]

Subsets of 41x41 px side by side over the whole picture. `dic_bias_px` is the largest distance between mean
and commanded shift, `dic_sd_px` the largest sd, over both axes and both pictures. Data:
$SOFTTWIN_DATA/dic_challenge_5.

`dic_pull_strained`: rms of error over stated sd on drawn speckles whose strain has a gradient, so large that
an affine subset of 35 px is 0.055 px off its place; 1 is right.

Subsets are registered, and grow from neighbour to neighbour, as those of a face do in a film
(`vision.measuring.face`): the second picture is looked at again until no more of them are found.
"""

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import SHARED
from benchmarks.commandline import whole

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from vision.camera import Array, Image
from vision.following import registration
from vision.following.registration import NO_LENS, Templates
from vision.following.subsetbias import curvature_of, straightened
from vision.measuring.face import BLUR_PX, NEIGHBOURS, find_subsets, smooth

DATA = SHARED / "dic_challenge_5"
PICTURES = {
    0.0: "Sample5-000_X0.00_Y0.00_N2_C75_R10.tif",
    0.1: "Sample5-001_X0.10_Y0.10_N2_C100_R20.tif",
}  # commanded shift px in x and y
SEED, SIDE, SUBSET, AFFINE_PX = 5, 260, 35, 0.055
BLOB_PX, NOISE_GREY = 1.6, 2.0
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


def drawn(gradient: float, size: int, seed: int) -> Any:
    """Picture (size, size) of Gaussian blobs on a material with u_x = gradient x^2 / 2, in closed form."""
    blobs = np.random.default_rng(SEED).uniform(-60, size + 60, (round(0.05 * (size + 120) ** 2), 2))
    middle = size / 2
    x = blobs[:, 0] - middle
    columns = np.arange(size) - middle
    material = columns if gradient == 0 else (np.sqrt(1.0 + 2.0 * gradient * columns) - 1.0) / gradient
    across = np.exp(-0.5 * ((material[:, None] - x[None]) / BLOB_PX) ** 2)
    down = np.exp(-0.5 * ((np.arange(size)[:, None] - blobs[None, :, 1]) / BLOB_PX) ** 2)
    picture = 200.0 - 150.0 * np.tanh(0.4 * (down @ across.T))
    picture = picture + NOISE_GREY * np.random.default_rng([SEED, seed]).standard_normal(picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def strained(pairs: int) -> dict[str, float]:
    """Pull of the displacements in a strain gradient, and what the affine subsets alone are off, px."""
    chi2, count, bias = 0.0, 0, []
    second = 24.0 * AFFINE_PX / SUBSET**2
    for pair in range(pairs):
        pictures = drawn(0.0, SIDE, 2 * pair), drawn(second, SIDE, 2 * pair + 1)
        found = field(*pictures, subset=SUBSET, step=SUBSET // 2)
        seen = np.isfinite(found.correlation)
        error = found.displacement[seen]
        error[:, 0] -= 0.5 * second * (found.centre[seen, 0] - SIDE / 2) ** 2
        stated = np.sqrt(np.diagonal(found.covariance[seen], axis1=1, axis2=2))
        chi2, count = chi2 + float(((error / stated) ** 2).sum()), count + error.size
        bias.append(float(np.median(error[:, 0])))
    return {"dic_pull_strained": float(np.sqrt(chi2 / count)), "dic_bias_strained_px": float(np.mean(bias))}


def figures(quick: bool) -> dict[str, Any]:
    """Bias and sd at 41x41, None where the pictures are absent; the pull in a strain gradient."""
    bent = strained(2 if quick else 10)
    if not DATA.is_dir():
        return {"dic_bias_px": None, "dic_sd_px": None, **bent}
    print(
        "| subset | shift px | found | mean x, y px | sd x, y px | pull |\n|---|---|---|---|---|---|",
        file=sys.stderr,
    )
    worst: dict[str, float] = {}
    for subset in (41,) if quick else (21, 31, 41, 61):
        for shift, found in trial(DATA, subset):
            seen = np.isfinite(found.correlation)
            moved = found.displacement[seen]
            mean, sd = moved.mean(axis=0), moved.std(axis=0, ddof=1)
            stated = np.sqrt(found.covariance[seen][:, [0, 1], [0, 1]])
            pull = np.sqrt(np.mean(((moved - mean) / stated) ** 2))
            print(
                f"| {subset} | {shift:.2f} | {seen.sum()} of {len(seen)} | {mean[0]:.4f}, {mean[1]:.4f} | "
                f"{sd[0]:.4f}, {sd[1]:.4f} | {pull:.2f} |",
                file=sys.stderr,
            )
            if subset == 41:
                bias = float(np.abs(mean - shift).max())
                worst["dic_bias_px"] = max(bias, worst.get("dic_bias_px", 0.0))
                worst["dic_sd_px"] = max(float(sd.max()), worst.get("dic_sd_px", 0.0))
                worst["dic_bias_se_px"] = worst["dic_sd_px"] / float(np.sqrt(seen.sum()))
                worst["dic_sd_se_px"] = worst["dic_bias_se_px"] / float(np.sqrt(2.0))
    return worst | bent


if __name__ == "__main__":
    sys.exit(whole(__doc__, figures, quick="subsets of 41 px alone, two strained pairs"))
