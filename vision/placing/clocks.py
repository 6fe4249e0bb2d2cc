"""Tracks at common times of cameras that run on their own clocks, and how far the clocks are apart."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.calibration.rig import Rig
from vision.camera import Array
from vision.following.markrotations import mean_seen
from vision.placing.triangulation import Sight, places_of

SAME = 1e-3  # of a frame: nearer than that, nothing is interpolated
GAP = 2.5  # usual steps beyond which nothing is interpolated
EDGE = 0.1  # of a frame beyond the first and the last that is still given
STEP = 0.05  # of a frame, to difference by
# What all marks alike may be off the lines by where they move: registration's own error as they turn. A lag
# that is not clearly more is not believed.
FLOOR_PX = 0.005
BELIEVED = 3.0  # sds
ROUNDS = 3


@dataclass(frozen=True)
class Track:
    """Pixels of the marks in one camera, at its own times."""

    time: Array  # (t,) s, increasing
    raw: Array  # (t,m,2) raw px; NaN where lost

    @property
    def period(self) -> float:
        """Usual time s between frames."""
        return float(np.median(np.diff(self.time)))

    def at(self, when: Array) -> Array:
        """Raw pixels (s,m,2) at other times (s,) s: a cubic through four frames, where one of them is lost a
        line, NaN in gaps and beyond the ends.

        >>> track = Track(np.arange(6.0), np.arange(6.0)[:, None, None] ** 2 * [[[1.0, 2.0]]])
        >>> track.at(np.array([2.5]))
        array([[[ 6.25, 12.5 ]]])
        """
        last = len(self.time) - 1
        k = np.clip(np.searchsorted(self.time, when) - 1, 0, last - 1)
        step = self.time[k + 1] - self.time[k]
        share = (when - self.time[k]) / step
        line = _mixed(self.raw, [k, k + 1], [1.0 - share, share])
        four = [np.clip(k + j, 0, last) for j in (-1, 0, 1, 2)]
        curve = _mixed(self.raw, four, _lagrange([self.time[i] for i in four], when))
        inner = (k > 0) & (k < last - 1) & (self.time[four[3]] - self.time[four[0]] < 3 * GAP * self.period)
        value = np.where(np.isfinite(curve) & inner[:, None, None], curve, line)
        value[(share < -EDGE) | (share > 1.0 + EDGE) | (step > GAP * self.period)] = np.nan
        for near, frame in ((np.abs(share) < SAME, k), (np.abs(share - 1.0) < SAME, k + 1)):
            value[near] = self.raw[frame[near]]
        return np.asarray(value)

    def nearest(self, when: Array) -> NDArray[np.intp]:
        """Frames (s,) nearest to times (s,) s."""
        k = np.clip(np.searchsorted(self.time, when), 1, len(self.time) - 1)
        return np.asarray(k - (when - self.time[k - 1] < self.time[k] - when))


def _mixed(raw: Array, frames: Sequence[NDArray[np.intp]], shares: Sequence[Array]) -> Array:
    parts = [share[:, None, None] * raw[k] for k, share in zip(frames, shares, strict=True)]
    return np.asarray(sum(parts[1:], parts[0]))


def _lagrange(times: Sequence[Array], when: Array) -> list[Array]:
    """Weights of values at four times for the cubic's value; meaningless where two times are equal."""
    weights = []
    for i, t_i in enumerate(times):
        weight = np.ones(len(when))
        for j, t_j in enumerate(times):
            if j != i:
                apart = t_i - t_j
                weight = weight * (when - t_j) / np.where(apart == 0.0, 1.0, apart)
        weights.append(weight)
    return weights


def joined(sight: Sight, tracks: Sequence[Track], when: Array, lag: Array) -> Sight:
    """Sightings at times (s,) s of the first camera, the others read `lag` (c,) s later."""
    return replace(sight, raw=np.array([t.at(when + d) for t, d in zip(tracks, lag, strict=True)]))


def lags(rig: Rig, sight: Sight, tracks: Sequence[Track], when: Array) -> tuple[Array, Array]:
    """Lag (c,) in s of each camera behind its time stamps, 0 for the first, and its sd (c,) s.

    A camera that is late moves a mark off the epipolar line by its speed times the lag. Least squares of what
    the distances from the lines change by since the reference; the sd from how the marks' own lags scatter
    (at least what the pixels' noise and FLOOR_PX give), never above that of a lag anywhere within a frame.
    A lag below 3 of its sds is taken as 0.
    """
    c = len(tracks)
    lag, sd = np.zeros(c), np.zeros(c)
    for k in range(1, c):
        step = STEP * tracks[k].period * np.eye(c)[k]
        widest = tracks[k].period / np.sqrt(12.0)
        for _ in range(ROUNDS):
            now, ahead = (_off_lines(rig, joined(sight, tracks, when, lag + d)) for d in (0.0 * step, step))
            slope = (ahead - now) / step[k]
            finite = np.isfinite(slope) & np.isfinite(now)
            slope, error = np.where(finite, slope, 0.0), np.where(finite, now, 0.0)
            each = (slope * error).sum(axis=(0, 1, 3))  # of a mark
            power = float((slope**2).sum()) + 1.0 / widest**2
            change = -float(each.sum()) / power
            lag[k] += change
            if abs(change) < 1e-6 * tracks[k].period:
                break
        each = each + change * (slope**2).sum(axis=(0, 1, 3))
        marks = max(int((slope != 0).any(axis=(0, 1, 3)).sum()), 2)
        scatter = np.sqrt(np.sum(each**2) * marks / (marks - 1)) / power
        fast = np.sqrt((slope**4).sum() / max(float((slope**2).sum()), 1e-300))  # sds per s, while it moves
        floor = FLOOR_PX / np.sqrt(np.nanmean(sight.variance[k])) / max(float(fast), 1e-300)
        sd[k] = min(max(scatter, power**-0.5, floor), widest)
        lag[k] *= abs(lag[k]) > BELIEVED * sd[k]
    return lag, sd


def _off_lines(rig: Rig, sight: Sight) -> Array:
    """Residual (c,t,p,2) of what the cameras see, in sds, minus its mean over the reference."""
    residual = places_of(rig, sight).residual
    sds = np.sqrt(sight.variance[:, list(sight.points)])[:, None, :, None]
    rest = np.array([mean_seen(of_camera[sight.reference]) for of_camera in residual])
    return np.asarray((residual - rest[:, None]) / sds)
