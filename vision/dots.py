"""A plain dot in a picture, its centre out: sub-pixel iso-contour and ellipse fit."""

import numpy as np
from numpy.typing import NDArray
from skimage.measure import EllipseModel, find_contours

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

MIN_CONTRAST = 20.0  # grey levels between dot and paper


def find_dot(image: Image, guess: Array, radius: float, *, search: float) -> Array | None:
    """Centre (2,) raw px of the dark dot nearest to the guess, or None when none of that size is there.

    image: (h,w) grey levels.   guess: (2,) px.   radius: px.
    search: px, how far the centre may be from the guess.

    The contour runs at half the grey step from dot to paper; its ellipse is fitted by least squares,
    doi 10.1109/34.765658. The centre of the ellipse is off the dot's by the square of its size over the
    distance (0.01 px for 20 px tilted by 15 degrees): keep dots below 15 px.
    """
    reach = search + 1.5 * radius + 2.0
    low = np.maximum(np.floor(guess - reach).astype(int), 0)
    high = np.minimum(np.ceil(guess + reach).astype(int) + 1, image.shape[::-1])
    if np.any(high - low < 5):
        return None
    part = image[low[1] : high[1], low[0] : high[0]].astype(np.float64)
    dark, light = np.percentile(part, 2.0), np.percentile(part, 90.0)
    if light - dark < MIN_CONTRAST:
        return None
    fits = [_ellipse(contour, radius) for contour in find_contours(part, 0.5 * (dark + light))]
    centres = [fit + low for fit in fits if fit is not None and np.hypot(*(fit + low - guess)) <= search]
    return min(centres, key=lambda c: float(np.hypot(*(c - guess)))) if centres else None


def _ellipse(contour: Array, radius: float) -> Array | None:
    """Centre (x, y) of the ellipse through a closed contour of about the radius, else None."""
    if len(contour) < 8 or np.any(contour[0] != contour[-1]):
        return None
    model = EllipseModel.from_estimate(contour[:-1, ::-1])
    if not model:
        return None
    axes = np.asarray(model.axis_lengths, dtype=np.float64)
    if np.any(np.abs(axes / radius - 1.0) > 0.35):
        return None
    return np.asarray(model.center, dtype=np.float64)
