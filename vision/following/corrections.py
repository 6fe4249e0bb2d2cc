"""Tracks mended by hand: a mark lost or exchanged in some frames, or placed where a person sees it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Camera
from vision.following.tracks import Followed, Method

DOES = ("lost", "swap", "place")
SD_PX = 0.5  # of a place that a person clicks
TICK = 1e-6  # s, below every time base


@dataclass(frozen=True)
class Correction:
    """A person's correction of one mark."""

    mark: str
    does: str  # "lost": not seen there; "swap": it and `other` were exchanged; "place": it is at `place`
    start: float  # s of the film
    end: float  # s, the last frame; for a place the same as start
    other: str = ""
    place: tuple[float, float] = (np.nan, np.nan)  # raw px
    sd_px: float = SD_PX  # of the place, in each axis


def corrected(
    film: Followed, names: Sequence[str], corrections: Sequence[Correction], camera: Camera
) -> Followed:
    """The tracks with the corrections done in their order.

    names: (p,) of the marks.   camera: whose raw pixels the places are in.

    A placed mark has the covariance of its sd, and turns as it does in the frames before and after it.
    Raises ValueError for a mark or a time that the film does not have.
    """
    if not corrections:
        return film
    warp, ideal, covariance = film.warp.copy(), film.ideal.copy(), film.covariance.copy()
    method, growth = film.method.copy(), film.growth.copy()
    for correction in corrections:
        p, frames = _row(correction.mark, names), _frames(correction, film.time)
        if correction.does == "swap":
            q = _row(correction.other, names)
            for array in (warp, ideal, covariance, method, growth):
                array[frames[:, None], [p, q]] = array[frames[:, None], [q, p]]
        elif correction.does == "lost":
            warp[frames, p], ideal[frames, p], covariance[frames, p] = np.nan, np.nan, np.nan
            method[frames, p] = Method.LOST
        else:
            ideal[frames, p] = camera.undistort(np.array(correction.place))
            covariance[frames, p], method[frames, p] = correction.sd_px**2 * np.eye(2), Method.BY_HAND
            warp[frames, p] = _turned(warp[:, p], int(frames[0]), ideal[frames[0], p])
    note = (f"{len(corrections)} corrections by hand were made to the tracks.",)
    growth[method != Method.ADJUSTED] = 1.0
    return replace(
        film, warp=warp, ideal=ideal, covariance=covariance, method=method, growth=growth,
        noted=(*film.noted, *note),
    )  # fmt: skip


def _row(name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise ValueError(f"correction of marker {name!r}: wanted one of {', '.join(names)}")
    return list(names).index(name)


def _frames(correction: Correction, time: Array) -> NDArray[np.intp]:
    """Frames (k,) that a correction is about: of a place the nearest one."""
    usual = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if correction.does == "place":
        nearest = int(np.argmin(np.abs(time - correction.start)))
        near = abs(time[nearest] - correction.start) <= 0.5 * usual + TICK
        frames = np.array([nearest]) if near else np.empty(0, dtype=np.intp)
    else:
        frames = np.flatnonzero((time >= correction.start - TICK) & (time <= correction.end + TICK))
    if not len(frames):
        raise ValueError(
            f"correction of marker {correction.mark!r} from {correction.start:g} to {correction.end:g} s: "
            f"the film has no frame there; wanted times of the film, {time[0]:.3f} to {time[-1]:.3f} s, one "
            f"every {usual:.4f} s"
        )
    return np.asarray(frames, dtype=np.intp)


def _turned(warp: Array, frame: int, centre: Array) -> Array:
    """Warp (3,3) of a mark at its centre (2,), turned and sized as between the frames that show it."""
    seen = np.flatnonzero(np.isfinite(warp[:, 0, 0]))
    seen = seen[seen != frame]
    if not len(seen):
        return np.full((3, 3), np.nan)
    linear = np.array([np.interp(frame, seen, part) for part in warp[seen, :2, :2].reshape(-1, 4).T])
    out = np.eye(3)
    out[:2, :2], out[:2, 2] = linear.reshape(2, 2), centre
    return out
