"""A sheet of coded markers round a window for the finger, with two rulers; mm from its top left corner."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.targets import Array

SPACING = 55.0  # mm from one marker to the next, at most
GAP = 8.0  # mm between markers and window, for the lines that say where the finger goes
INSET = 12.0  # mm from the window's edge to the clamp's front, x = 0
ABOVE, BEYOND = 8.0, 10.0  # mm free above the finger's crests and beyond its tip


@dataclass(frozen=True)
class FramePaper:
    """Where everything is on the sheet; x to the right and y down."""

    places: Array  # (n,2) centres of the markers, clockwise from the top left corner
    fixed: NDArray[np.bool_]  # (n,) role "fixed", the others are "frame"
    window: tuple[float, float, float, float]  # left, top, right, bottom
    level: float  # y of the finger's bottom, z = 0
    clamp: float  # x from the middle to the clamp's front

    @property
    def middle(self) -> float:
        """The x of the window's middle."""
        return 0.5 * (self.window[0] + self.window[2])

    @property
    def up(self) -> Array:
        """Centres (n,2) mm to the right and up, from the middle of the window and z = 0."""
        return (self.places - (self.middle, self.level)) * (1.0, -1.0)


def frame_paper(
    free: tuple[float, float, float, float], *, side: float, length: float, height: float
) -> FramePaper:
    """Markers round a window; ValueError where the finger does not fit into that.

    free: left, top, right and bottom of what may be printed on.   side: of a marker with its clear border.
    length, height: of the finger, which may point to either side and bends down.
    """
    left, top, right, bottom = (v + s * side / 2 for v, s in zip(free, (1, 1, -1, -1), strict=True))
    edge = side / 2 + GAP
    window = (left + edge, top + edge, right - edge, bottom - edge)
    level, clamp = window[1] + height + ABOVE, 0.5 * (window[2] - window[0]) - INSET
    wanted = INSET + length + BEYOND, height + ABOVE + 0.5 * length
    room = window[2] - window[0], window[3] - window[1]
    if wanted[0] > room[0] or wanted[1] > room[1]:
        raise ValueError(
            f"the window of this paper is {room[0]:.0f} x {room[1]:.0f} mm, and a finger {length:g} mm long "
            f"and {height:g} mm high that bends wants {wanted[0]:.0f} x {wanted[1]:.0f} mm"
        )
    across, down = (
        np.linspace(a, b, math.ceil((b - a) / SPACING) + 1) for a, b in ((left, right), (top, bottom))
    )
    places = [(x, top) for x in across] + [(right, y) for y in down[1:]]
    places += [(x, bottom) for x in across[-2::-1]] + [(left, y) for y in down[-2:0:-1]]
    corners = {(x, y) for x in (left, right) for y in (top, bottom)}
    fixed = _every_other([place not in corners for place in places])
    return FramePaper(np.array(places), fixed, window, level, clamp)


def _every_other(inner: Sequence[bool]) -> NDArray[np.bool_]:
    """Mask (n,) of every other of those that are not at a corner, on which the axes rest best."""
    rank = np.cumsum(inner)
    return np.asarray(np.array(inner) & (rank % 2 == 1))
