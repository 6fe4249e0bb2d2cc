"""Board pictures that do not fit the others: which are left out, by which rule, and why."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vision.boards.board import BoardView
from vision.camera import Array

# A picture is left out where its corners' rms is above so many times the median of all pictures, the worst
# first, and the camera is fitted again. Noise alone reaches 1.7 times with the fewest corners, 8.
WORSE = 2.5
LEAST_PX = 0.05  # below which a picture is good, however good the others are
MIN_LEFT = 10  # pictures that must be left,
SHARE = 0.3  # of all, the most that are left out
COVERS = 0.65  # and of the area that all covered, what the rest must cover
BLURRED = 1.5  # times the usual width of edges

Fitted = Callable[[Sequence[BoardView]], Array]  # rms distance (v,) px of each view's corners


@dataclass(frozen=True)
class Outlying:
    """Which views were left out."""

    kept: tuple[int, ...]  # rows of the views
    dropped: tuple[int, ...]  # worst first
    rms: tuple[float, ...]  # px, of the dropped
    usual: float  # px, median rms of all views in the last fit
    stays: int | None = None  # a view that does not fit but is kept, because too few others would be left


def without_outlying(views: Sequence[BoardView], fitted: Fitted) -> Outlying:
    """The views without those that do not fit.

    fitted: fits a camera to some views and says how well it fits each.
    """
    kept = list(range(len(views)))
    dropped: list[int] = []
    said: list[float] = []
    while True:
        rms = fitted([views[i] for i in kept])
        worst, usual = int(np.argmax(rms)), float(np.median(rms))
        if rms[worst] <= max(WORSE * usual, LEAST_PX):
            return Outlying(tuple(kept), tuple(dropped), tuple(said), usual)
        left = [i for i in kept if i != kept[worst]]
        if not _enough(left, views):
            return Outlying(tuple(kept), tuple(dropped), tuple(said), usual, kept[worst])
        said.append(float(rms[worst]))
        dropped.append(kept[worst])
        kept = left


def _enough(left: list[int], views: Sequence[BoardView]) -> bool:
    """Whether the views that are left are many, and cover the picture as all did."""
    if len(left) < max(MIN_LEFT, (1.0 - SHARE) * len(views)):
        return False
    return area([views[i] for i in left]) >= COVERS * area(views)


def area(views: Sequence[BoardView]) -> float:
    """Area in px2 inside the hull of all corners."""
    hull = cv2.convexHull(np.concatenate([view.pixels for view in views]).astype(np.float32))
    return float(cv2.contourArea(hull))


def why(blur: Array, row: int) -> str:
    """What is wrong with a picture that does not fit, from the widths of edges (n,) px of all pictures."""
    usual = float(np.median(blur))
    if blur[row] > BLURRED * usual:
        return f"it is blurred, its edges are {blur[row] / usual:.1f} times as wide as usual"
    return "it is as sharp as the others, so the board was bent or moved, or something covered a part of it"


def empty_corners(views: Sequence[BoardView], size: tuple[int, int]) -> list[str]:
    """Names of the corners of the picture into which no board reaches, to a quarter of its sides."""
    pixels = np.concatenate([view.pixels for view in views]) / size
    names = {(0, 0): "top left", (1, 0): "top right", (0, 1): "bottom left", (1, 1): "bottom right"}
    return [
        name
        for (right, down), name in names.items()
        if not np.any(np.all(np.abs(pixels - (right, down)) < 0.25, axis=1))
    ]
