"""Frames that repeat the picture before them while the finger moves, and so show it at a wrong time."""

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Image

EVERY = 8  # px: of a picture that is given twice every pixel is the same, so that some tell
MOVES_PX = 0.3  # between the pictures on either side; at rest a repeated picture is as good


def sample(image: Image) -> Image:
    """Pixels that two different pictures do not share: their noise differs, and their marks move."""
    return np.ascontiguousarray(image[::EVERY, ::EVERY])


def stale(same: NDArray[np.bool_], ideal: Array) -> NDArray[np.bool_]:
    """Frames (t,) whose picture is the one before it while marks move from that to the next new one.

    same: (t,) whether a frame's picture is the one before it.   ideal: (t,p,2) px, the marks; NaN for all of
    a frame that is not there, which is no new picture.
    """
    fresh = np.flatnonzero(~same & np.isfinite(ideal).any(axis=(1, 2)))
    if not len(fresh):
        return np.zeros(len(same), dtype=bool)
    later = np.searchsorted(fresh, np.arange(len(same)), side="right")
    own, after = fresh[np.maximum(later - 1, 0)], fresh[np.minimum(later, len(fresh) - 1)]
    step = np.nan_to_num(np.hypot(*np.moveaxis(ideal[after] - ideal[own], -1, 0)))
    return np.asarray(same & (step.max(axis=1) > MOVES_PX))
