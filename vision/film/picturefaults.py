"""Faults of a picture: dark, overexposed, without contrast, blurred, interlaced, or repeated."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Image
from vision.plane import fit_homography

DARK, FLAT, BURNT = 70.0, 40.0, 0.3  # grey level, grey levels, share of the picture
NOISE_PX, MORE_PX = 1.0, 3.0
BLURRED_PX = 2.5  # sd of a blurred edge: a marker of 25 px has cells of 4 px
CALM_PX = 0.7  # sd of the Gaussian before slopes are taken: noise has slopes too
EDGES = 98.0  # percentile of the slopes inside a board that is an edge
SPARSE = 8  # px: of a picture that is given twice every pixel is the same, so that some tell
STRIPE, SPARSE_COMB = 20, 4  # grey levels between a comb's row and both beside it; px from column to column
PATTERN = 2.0  # times the stripes of a pattern along its columns, that may be there along its rows
MOVES_PX = 0.3  # between the pictures on either side; at rest a repeated picture is as good


def picture_trouble(picture: Image) -> str:
    """The fault of a grey picture (h,w), as one clause; "" where there is none.

    >>> picture_trouble(np.full((40, 60), 20, np.uint8)).partition(":")[0]
    'the picture is dark'
    """
    low, high = np.percentile(picture, (1.0, 99.0))
    if high < DARK:
        return (f"the picture is dark: its brightest hundredth has the grey level {high:.0f} of 255; use "
                "more light or a longer exposure")  # fmt: skip
    if np.mean(picture >= 252) > BURNT:
        return (f"the picture is overexposed: {100 * np.mean(picture >= 252):.0f} % of it is white; "
                "expose shorter")  # fmt: skip
    if high - low < FLAT:
        return f"the picture has hardly any contrast: {high - low:.0f} grey levels; check light and lens"
    blur = edge_sd(picture)
    if blur > BLURRED_PX:
        return (f"the picture is blurred: its sharpest edges are {2.0 * blur:.0f} px wide; focus, or "
                "expose shorter")  # fmt: skip
    return ""


def edge_sd(picture: Image) -> float:
    """Sd in px of the blur of the sharpest edges, from how much further blur flattens them.

    The steepest slope of an edge of sd s is as 1 / s: blurred by r more it falls to s / (s2 + r2)^1/2 of it.
    """
    grey = picture.astype(np.float32)
    calm = np.asarray(cv2.GaussianBlur(grey, (0, 0), NOISE_PX), np.float32)  # noise has slopes too
    again = np.asarray(cv2.GaussianBlur(calm, (0, 0), MORE_PX), np.float32)
    falls = min(_steepest(again) / max(_steepest(calm), 1e-6), 0.999)
    total = MORE_PX * falls / np.sqrt(1.0 - falls**2)
    return float(np.sqrt(max(total**2 - NOISE_PX**2, 0.0)))


def _steepest(grey: NDArray[np.float32]) -> float:
    slope = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    return float(np.percentile(slope, 99.5))


def board_edge_sd(picture: Image, points: Array, pixels: Array) -> float:
    """Sd in px of the edges of a board in a picture (h,w), of the worse of its two axes.

    points: (n,3) mm on the board.   pixels: (n,2) raw px, where they are seen.

    A step of c grey levels blurred with an sd of s has the slope c / (s sqrt(2 pi)). Motion blurs along one
    direction, which the worse axis shows.
    """
    low = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 1, picture.shape[::-1])
    part = np.asarray(picture[low[1] : high[1], low[0] : high[0]], dtype=np.float32)
    if min(part.shape) < 8:
        return np.inf
    calm = np.asarray(cv2.GaussianBlur(part, (0, 0), CALM_PX), dtype=np.float64)
    down, right = np.gradient(calm)
    dark, light = np.percentile(calm, (2.0, 98.0))
    homography = fit_homography(points[:, :2], pixels)
    middle = homography @ (*points[:, :2].mean(axis=0), 1.0)
    along = homography[:2, :2] / middle[2] - np.outer(middle[:2] / middle[2], homography[2, :2]) / middle[2]
    across = np.linalg.inv(along)  # its rows stand on the board's lines
    across = across / np.linalg.norm(across, axis=1, keepdims=True)
    steep = [float(np.percentile(np.abs(x * right + y * down), EDGES)) for x, y in across]
    wide = float(light - dark) / (max(min(steep), 1e-6) * np.sqrt(2.0 * np.pi))
    return float(np.sqrt(max(wide**2 - CALM_PX**2, 0.0)))


def combed(picture: Image) -> float:
    """Share of a picture's pixels that stripes along the rows take, less what as fine a pattern explains.

    What moves has the edges of a comb where odd and even rows show two moments; a pattern has stripes along
    its columns too.
    """
    grey = picture.astype(np.int16)
    return _stripes(grey[:, ::SPARSE_COMB]) - PATTERN * _stripes(grey[::SPARSE_COMB].T)


def _stripes(grey: NDArray[np.int16]) -> float:
    """Share of the pixels (h,w) that lie far off both rows beside them."""
    before, after = grey[1:-1] - grey[:-2], grey[1:-1] - grey[2:]
    off = np.minimum(np.abs(before), np.abs(after)) > STRIPE
    return float(np.mean(off & ((before > 0) == (after > 0))))


def sample(image: Image) -> Image:
    """Pixels that two different pictures do not share: their noise differs, and their marks move."""
    return np.ascontiguousarray(image[::SPARSE, ::SPARSE])


def stale(same: NDArray[np.bool_], ideal: Array) -> NDArray[np.bool_]:
    """Frames (t,) whose picture is the one before it while marks move from that to the next new one.

    same: (t,) whether a frame's picture is the one before it.   ideal: (t,p,2) px, the marks; NaN for all of
    a frame that is not there, which is no new picture.
    """
    fresh = np.flatnonzero(~same & np.isfinite(ideal).any(axis=(1, 2)))
    if not len(fresh):
        return np.zeros(len(same), dtype=bool)
    later = np.searchsorted(fresh, np.arange(len(same)), side="right")
    latest, after = fresh[np.maximum(later - 1, 0)], fresh[np.minimum(later, len(fresh) - 1)]
    step = np.nan_to_num(np.hypot(*np.moveaxis(ideal[after] - ideal[latest], -1, 0)))
    return np.asarray(same & (step.max(axis=1) > MOVES_PX))
