"""Places of a picture whose texture can be followed, best first."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Image

SD_PX = 0.05  # a worse place than this is none; the sd from the slopes and the noise, in the worse direction
ALONE = 0.85  # correlation that no place beside it may reach: else it may slip there
BESIDE = 1.0  # times its side: how far beside it is looked
SLOW = 0.5  # times its side: nearer places than this are the feature itself


@dataclass(frozen=True)
class Feature:
    """A square of texture in a picture."""

    centre: tuple[float, float]  # raw px
    sd_px: float  # how well one picture tells its place, in the worse direction


def find_textures(
    picture: Image, *, side_px: int, allowed: NDArray[np.bool_], most: int = 40
) -> tuple[Feature, ...]:
    """Squares of texture in a grey picture (h,w), none overlapping another by more than half, best first.

    side_px: of the squares.   allowed: (h,w) where their middles may lie.

    sd = noise / (sum of squared slopes in the worse direction)^1/2, the Cramer-Rao bound of a shift; squares
    that look like one beside them are left out.
    """
    grey = picture.astype(np.float32)
    sd = _noise(grey) / np.sqrt(np.maximum(_slopes(grey, side_px), 1e-12))
    half = side_px // 2 + 2
    inside = np.zeros(picture.shape, dtype=bool)
    inside[half:-half, half:-half] = True
    remaining = np.where(inside & allowed, sd, np.inf)
    features: list[Feature] = []
    while len(features) < most and remaining.min() < SD_PX:
        y, x = np.unravel_index(int(remaining.argmin()), remaining.shape)
        if _alone(picture, int(x), int(y), side_px):
            features.append(Feature((float(x), float(y)), float(remaining[y, x])))
            reach = side_px // 2
        else:
            reach = side_px // 4
        remaining[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1] = np.inf
    return tuple(features)


def _slopes(grey: NDArray[np.float32], side_px: int) -> Array:
    """Sum of the squared slopes (h,w) over a square round each pixel, in the direction of the least."""
    calm = cv2.GaussianBlur(grey, (0, 0), 1.0)
    right, down = (np.asarray(cv2.Sobel(calm, cv2.CV_64F, *axis), float) / 8.0 for axis in ((1, 0), (0, 1)))
    xx, yy, xy = (
        np.asarray(cv2.boxFilter(np.asarray(part), -1, (side_px, side_px), normalize=False), float)
        for part in (right * right, down * down, right * down)
    )
    return np.asarray(0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy**2))


def _noise(grey: NDArray[np.float32]) -> float:
    """Sd of the noise in grey levels, from second differences, which smooth pictures have none of."""
    second = grey[:, 2:] - 2.0 * grey[:, 1:-1] + grey[:, :-2]
    return max(float(np.median(np.abs(second))) / 0.6745 / np.sqrt(6.0), 0.3)


def _alone(picture: Image, x: int, y: int, side_px: int) -> bool:
    """True if no square beside this one looks like it."""
    half, reach = side_px // 2, round(BESIDE * side_px)
    patch = picture[y - half : y + half + 1, x - half : x + half + 1]
    y0, x0 = max(y - half - reach, 0), max(x - half - reach, 0)
    around = picture[y0 : y + half + reach + 1, x0 : x + half + reach + 1]
    alike = np.asarray(cv2.matchTemplate(around, patch, cv2.TM_CCOEFF_NORMED))
    v, u = np.mgrid[: alike.shape[0], : alike.shape[1]]
    far = np.hypot(u - (x - half - x0), v - (y - half - y0)) > SLOW * side_px
    return bool(not far.any() or alike[far].max() < ALONE)


def taken(shape: Sequence[int], centres: Array, reach_px: Array) -> NDArray[np.bool_]:
    """Mask (h,w) of the pixels within reach (k,) px of centres (k,2) px.

    >>> taken((3, 5), np.array([[1.0, 1.0]]), np.array([1.5])).astype(int)
    array([[1, 1, 1, 0, 0],
           [1, 1, 1, 0, 0],
           [1, 1, 1, 0, 0]])
    """
    y, x = np.mgrid[: shape[0], : shape[1]]
    out = np.zeros((shape[0], shape[1]), dtype=bool)
    for (u, v), reach in zip(centres, reach_px, strict=True):
        out |= (x - u) ** 2 + (y - v) ** 2 < reach**2
    return out
