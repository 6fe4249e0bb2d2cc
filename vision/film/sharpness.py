"""Why a picture may show no marker: dark, overexposed, without contrast, or blurred."""

import cv2
import numpy as np

from vision.camera import Image

DARK, FLAT, BURNT = 70.0, 40.0, 0.3  # grey level, grey levels, share of the picture
BLURRED_PX = 2.5  # sd of a blurred edge: a marker of 25 px has cells of 4 px


def picture_trouble(picture: Image) -> str:
    """What is wrong with a grey picture (h,w), as one clause; "" where nothing is."""
    low, high = np.percentile(picture, (1.0, 99.0))
    if high < DARK:
        return (f"the picture is dark: its brightest hundredth has the grey level {high:.0f} of 255; use "
                "more light or a longer exposure")  # fmt: skip
    if np.mean(picture >= 252) > BURNT:
        return (f"the picture is overexposed: {100 * np.mean(picture >= 252):.0f} % of it is white; expose "
                "shorter")  # fmt: skip
    if high - low < FLAT:
        return f"the picture has hardly any contrast: {high - low:.0f} grey levels; check light and lens"
    blur = edge_sd(picture)
    if blur > BLURRED_PX:
        return (f"the picture is blurred: its sharpest edges are {2.0 * blur:.0f} px wide; focus, or expose "
                "shorter")  # fmt: skip
    return ""


def edge_sd(picture: Image) -> float:
    """Sd in px of the sharpest edges: a blurred step of c grey levels has the slope c / (sd sqrt(2 pi))."""
    calm = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 1.0)  # noise has slopes too
    slope = np.hypot(cv2.Sobel(calm, cv2.CV_32F, 1, 0) / 8.0, cv2.Sobel(calm, cv2.CV_32F, 0, 1) / 8.0)
    low, high = np.percentile(calm, (1.0, 99.0))
    sharpest = float(np.percentile(slope, 99.9))
    wide = float(high - low) / (max(sharpest, 1e-6) * np.sqrt(2.0 * np.pi))
    return float(np.sqrt(max(wide**2 - 1.0, 0.0)))
