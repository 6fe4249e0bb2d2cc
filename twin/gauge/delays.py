"""Delay of the finger behind the pressure at every corner of the pressure's course."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from twin.gauge.pressurelog import Log
from twin.gauge.synchrony import LagFit, Motion, parabola
from twin.targets import Array

WITHIN_S = 1.0  # a corner's delay is looked for so far to either side
MOVES_S, SPANS = 0.3, 100  # over which the pressure's slope is read, s; such spans in a long film
SLOPE, RAMP = 0.01, 0.15  # of the pressure's range: from which it moves in a span, and counts as a ramp
LONG = 8  # frames of a ramp of which both ends are looked at alone
DEGREES = (2, 3)  # of the motion over the pressure near a corner
MOST_SD_S, LEFT = 0.1, 0.015  # of a delay that is clear, s; share of the motion's range that it leaves
AWAY_S, RIVAL = 0.3, 3.0  # delays so far away leave more than so many times its squares
JUMP = 2.5  # times any other step of the film: frames may be missing there


@dataclass(frozen=True)
class Corner:
    """The film about a corner of the pressure, and the delay of the finger there with its sd, s."""

    fit: LagFit  # on the film's clock: its shift is minus the delay
    late_s: float = 0.0
    sd_s: float = np.inf

    @property
    def at_s(self) -> float:
        """Time of the corner in the film, s."""
        return float(self.fit.time.mean())

    def squares(self, late: float, pressure: Array | None = None) -> float:
        """Sum of squares, mm2, of the motion at a delay, s, behind the log's pressure or another (t,) MPa."""
        return (self.fit if pressure is None else replace(self.fit, pressure=pressure)).squares(-late)


def corners(motion: Motion, log: Log, start_s: float) -> list[Corner]:
    """The corners at which the delay of the finger is clear, in the order of time.

    Each delay is looked for about the one before, as clocks of two rates drift apart.   start_s: time of the
    film's first frame on the log's clock.
    """
    seen = np.isfinite(motion.mm)
    time, mm, clock = motion.time[seen], motion.mm[seen], log.time - start_s
    delays: list[Corner] = []
    if len(time) < 2 * LONG:
        return delays
    for begin, end in _windows(time, mm, clock, log.pressure):
        about = delays[-1].late_s if delays else 0.0
        window = slice(*np.searchsorted(time, [begin + about, end + about]))
        corner = _measured(LagFit(time[window], mm[window], clock, log.pressure, creep=True), about)
        delays += [corner] if corner.sd_s < MOST_SD_S else []
    return delays


def _windows(time: Array, mm: Array, clock: Array, pressure: Array) -> Iterator[tuple[float, float]]:
    """Begin and end in s about every corner: both ends of a long ramp, cut in the middle or where the film
    jumps, and all of a short one."""
    frame = float(np.median(np.diff(time)))
    span = max(MOVES_S, float(np.ptp(time)) / SPANS, frame)
    ramps = _ramps(np.arange(time[0], time[-1], span / 4), clock, pressure, span)
    edges = [time[0], *(t for ramp in ramps for t in ramp), time[-1]]
    for k, (a, b) in enumerate(ramps):
        least = 0.3 * (b - a)  # into a ramp that follows without a hold
        begin = a - min(max(a - edges[2 * k], least), WITHIN_S) - 0.5 * frame
        end = b + min(max(edges[2 * k + 3] - b, least), WITHIN_S) + 0.5 * frame
        cut = _jump(time, mm, begin, end) or 0.5 * (a + b)
        yield from [(begin, cut), (cut, end)] if b - a > LONG * frame else [(begin, end)]


def _ramps(fine: Array, clock: Array, pressure: Array, span: float) -> list[tuple[float, float]]:
    """Begin and end of every ramp of the pressure, s of the film.   fine: times a quarter of a span apart."""
    p = np.interp(fine, clock, pressure)
    span_MPa, slope = float(np.ptp(p)), p[4:] - p[:-4]  # about fine[2:-2]
    sign = np.sign(slope) * (np.abs(slope) > SLOPE * span_MPa)
    ramps = []
    for a, b in pairwise(np.r_[0, 1 + np.flatnonzero(np.diff(sign)), len(sign)]):
        begin, end = fine[a + 2] + 0.4 * span, fine[b + 1] - 0.4 * span  # a span sees a corner early
        if sign[a] and abs(p[min(b + 3, len(p) - 1)] - p[a]) > RAMP * span_MPa:
            ramps.append((float(begin), float(max(begin, end))))
    return ramps


def _jump(time: Array, mm: Array, begin: float, end: float) -> float:
    """Time of a jump of the film between two times, s; 0 without one."""
    window = np.flatnonzero((time >= begin) & (time <= end))
    step = np.abs(np.diff(mm[window]))
    if len(step) <= LONG or step[k := int(step.argmax())] <= JUMP * np.delete(step, k).max():
        return 0.0
    return float(time[window[k] : window[k] + 2].mean())


def _measured(fit: LagFit, about: float) -> Corner:
    """The corner with its delay; the sd is infinite where it has few frames, or other delays fit as well."""
    if len(fit.time) < max(DEGREES) + 6:
        return Corner(fit)
    (low, low_sd), (late, sd) = (_delay(replace(fit, degree=degree), about) for degree in DEGREES)
    return Corner(fit, late, float(np.hypot(max(low_sd, sd), late - low)))


def _delay(fit: LagFit, about: float) -> tuple[float, float]:
    """The delay of least squares and its sd, s, infinite where it is not clear."""
    step = max(0.25 * float(np.median(np.diff(fit.time))), WITHIN_S / 100)
    delays = about + np.arange(-WITHIN_S, WITHIN_S + step / 2, step)
    squares = np.array([fit.squares(-late) for late in delays])
    k = int(np.clip(squares.argmin(), 4, len(delays) - 5))
    late, curvature = parabola(delays[k - 4 : k + 5], squares[k - 4 : k + 5], 4 * step)
    if curvature <= 0 or k != squares.argmin():
        return float(delays[k]), np.inf
    least, rivals = fit.squares(-late), squares[np.abs(delays - late) > AWAY_S]
    if least > len(fit.mm) * (LEFT * float(np.ptp(fit.mm))) ** 2 or least * RIVAL > rivals.min():
        return late, np.inf
    return late, fit.sd(-late, curvature)
