"""Why a picture may show no marker: dark, overexposed, without contrast, or blurred."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Image

DARK, FLAT, BURNT = 70.0, 40.0, 0.3  # grey level, grey levels, share of the picture
NOISE_PX, MORE_PX = 1.0, 3.0
BLURRED_PX = 2.5  # sd of a blurred edge: a marker of 25 px has cells of 4 px


def picture_trouble(picture: Image) -> str:
    """What is wrong with a grey picture (h,w), as one clause; "" where nothing is."""
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
    whole = MORE_PX * falls / np.sqrt(1.0 - falls**2)
    return float(np.sqrt(max(whole**2 - NOISE_PX**2, 0.0)))


def _steepest(grey: NDArray[np.float32]) -> float:
    slope = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    return float(np.percentile(slope, 99.5))
