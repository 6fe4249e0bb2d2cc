"""Where the edge of a body crosses lines that are drawn through it, in one picture."""

import numpy as np
import scipy

from vision.camera import Array

HALF = 4.0  # px on either side of the steepest place, from which the grey of body and ground is taken
CONTRAST = 0.5  # of the usual step of grey, which a place must have
LIKE = 0.35  # of the usual step, by which body and ground may differ from those beside them
BESIDE = 41  # places that are beside each other


def edge_places(grey: Array, step_px: float, sign: float) -> Array:
    """Places (k,) of the edge along lines, in steps from their first point; NaN where it is not clear.

    grey: (k,m) along lines from inside to outside.   step_px: px from point to point.   sign: 1 where the
    ground is lighter than the body, else -1.

    The edge is where the grey passes the middle between both sides of the steepest place. It is not clear
    where the step is small, where body or ground are not as beside, as at a tag, or at the end of the line.
    """
    half = max(round(HALF / step_px), 1)
    slope = sign * (grey[:, half:] - grey[:, :-half])  # over half a window: no single pixel decides
    steep = slope.argmax(axis=1) + half // 2
    rows = np.arange(len(grey))
    low, high = steep - half, steep + half
    inside = (low >= 0) & (high < grey.shape[1])
    low, high = np.clip(low, 0, grey.shape[1] - 1), np.clip(high, 0, grey.shape[1] - 1)
    inner, outer = grey[rows, low], grey[rows, high]
    usual = max(float(np.median((sign * (outer - inner))[inside])) if inside.any() else 0.0, 1e-9)
    clear = inside & (sign * (outer - inner) > CONTRAST * usual)
    for side in (inner, outer):
        clear &= np.abs(side - scipy.ndimage.median_filter(side, BESIDE, mode="wrap")) < LIKE * usual
    middle = 0.5 * (inner + outer)
    place = np.full(len(grey), np.nan)
    for k in np.flatnonzero(clear):
        line = sign * (grey[k, low[k] : high[k] + 1] - middle[k])
        crossed = np.flatnonzero((line[:-1] < 0) & (line[1:] >= 0))
        if len(crossed) == 1:
            c = crossed[0]
            place[k] = low[k] + c - line[c] / (line[c + 1] - line[c])
    return place
