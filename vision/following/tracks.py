"""Tracks of marks in a film, and the method that placed each: the records that everything later reads."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.marks import Mark, frame_places, rows_of
from vision.plane import homographies


class Method(IntEnum):
    """Ways to place a mark; stored arrays hold their numbers."""

    LOST = 0
    REGISTERED = 1  # from where it was in the last frame
    FOUND_AGAIN = 2  # registered from where its code was read
    DOT = 3  # the contour of a plain dot
    ECC = 4  # smoothed correlation, where registration fails
    CORNERS = 5  # its four corners, where that fails too
    BY_HAND = 6  # where a person says that it is
    ADJUSTED = 7  # registered, with its blur and the slope of its light fitted beside the place


FIRM = (Method.REGISTERED, Method.FOUND_AGAIN, Method.ADJUSTED)
COARSE = (Method.ECC, Method.CORNERS, Method.BY_HAND)  # less certain than registration, and stated so


@dataclass(frozen=True, kw_only=True)
class Tracks:
    """Place of every mark in every frame of the film; NaN where it is lost."""

    time: Array  # (t,) s
    names: tuple[str, ...]  # (p,) all marks, those of the frame too
    position: Array  # (t,p,2) px in the raw frame
    covariance: Array  # (t,p,2,2) px2 from the fit's residual
    rotation: Array  # (t,p) rad in the x-z plane, from x towards z, against the reference; NaN for dots
    method: NDArray[np.int8]  # (t,p) of `Method`


OF_MARKS = ("warp", "ideal", "covariance", "method", "growth")  # arrays (t,p,...) of `Followed`


@dataclass(frozen=True, kw_only=True)
class Followed:
    """One film, followed."""

    time: Array  # (t,) s
    warp: Array  # (t,p,3,3) local to ideal px; NaN when lost
    ideal: Array  # (t,p,2) px, centres, undistorted
    covariance: Array  # (t,p,2,2) px2
    method: NDArray[np.int8]  # (t,p) of `Method`
    growth: Array  # (t,p) of the variance by a blur that was fitted; 1 without
    reference: NDArray[np.intp]  # (r,) frames of the reference
    said: tuple[str, ...] = ()  # what else is to be said of lost marks, in sentences for the user
    noted: tuple[str, ...] = ()  # what was left out without asking anything of the user

    def homography(self, marks: Sequence[Mark]) -> Array:
        """Homography (t,3,3) from the frame marks' plane (x, z, 1) mm to ideal px in every frame."""
        return homographies(frame_places(marks), self.ideal[:, rows_of(marks)[0]])


def thinned(followed: Followed, steps: NDArray[np.intp]) -> Followed:
    """The tracks in some frames, which hold the reference."""
    if len(steps) == len(followed.time):
        return followed
    chosen = {name: getattr(followed, name)[steps] for name in ("time", *OF_MARKS)}
    return replace(followed, **chosen, reference=np.searchsorted(steps, followed.reference))
