"""How late the finger moves at every corner of the pressure's course."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from twin.gauge.pressurelog import Log
from twin.gauge.synchrony import Motion
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
    """The film about one corner of the pressure, and how late the finger moves there."""

    time: Array  # (n,) s of the film
    mm: Array  # (n,) motion
    late_s: float = 0.0
    sd_s: float = np.inf

    @property
    def at_s(self) -> float:
        """Its time in the film, s."""
        return float(self.time.mean())

    def left(self, time: Array, pressure: Array, late: float, *, degree: int = DEGREES[-1]) -> Array:
        """What the pressures (t,) MPa at times (t,) s of the film, `late` s before, leave of the motion (n,)
        mm: a polynomial, and their integral for creep. Scale and law of the finger do not matter."""
        p = np.interp(self.time - late, time, pressure)
        p = (p - p.mean()) / max(float(np.ptp(pressure)), 1e-12)
        crept = np.r_[0.0, np.cumsum(0.5 * (p[1:] + p[:-1]) * np.diff(self.time))]
        columns = np.column_stack([*(p**n for n in range(degree + 1)), crept])
        return np.asarray(self.mm - columns @ np.linalg.lstsq(columns, self.mm, rcond=None)[0])

    def squares(self, time: Array, pressure: Array, late: float, *, degree: int = DEGREES[-1]) -> float:
        """The sum of its squares, mm2."""
        left = self.left(time, pressure, late, degree=degree)
        return float(left @ left)


def corners(motion: Motion, log: Log, start_s: float) -> list[Corner]:
    """The corners at which the film tells how late the finger moves, in the order of time.

    Each delay is looked for about the one before, as clocks of two rates drift apart.   start_s: time of the
    film's first frame on the log's clock.
    """
    seen = np.isfinite(motion.mm)
    time, mm, clock = motion.time[seen], motion.mm[seen], log.time - start_s
    found: list[Corner] = []
    if len(time) < 2 * LONG:
        return found
    for low, high in _windows(time, mm, clock, log.pressure):
        about = found[-1].late_s if found else 0.0
        own = slice(*np.searchsorted(time, [low + about, high + about]))
        one = _measured(Corner(time[own], mm[own]), clock, log.pressure, about)
        found += [one] if one.sd_s < MOST_SD_S else []
    return found


def _windows(time: Array, mm: Array, clock: Array, pressure: Array) -> Iterator[tuple[float, float]]:
    """Begin and end in s about every corner: both ends of a long ramp, cut in the middle or where the film
    jumps, and all of a short one."""
    frame = float(np.median(np.diff(time)))
    span = max(MOVES_S, float(np.ptp(time)) / SPANS, frame)
    ramps = _ramps(np.arange(time[0], time[-1], span / 4), clock, pressure, span)
    edges = [time[0], *(t for ramp in ramps for t in ramp), time[-1]]
    for k, (a, b) in enumerate(ramps):
        least = 0.3 * (b - a)  # into a ramp that follows without a hold
        first = a - min(max(a - edges[2 * k], least), WITHIN_S) - 0.5 * frame
        last = b + min(max(edges[2 * k + 3] - b, least), WITHIN_S) + 0.5 * frame
        cut = _jump(time, mm, first, last) or 0.5 * (a + b)
        yield from [(first, cut), (cut, last)] if b - a > LONG * frame else [(first, last)]


def _ramps(fine: Array, clock: Array, pressure: Array, span: float) -> list[tuple[float, float]]:
    """Begin and end of every ramp of the pressure, s of the film.   fine: times a quarter of a span apart."""
    p = np.interp(fine, clock, pressure)
    whole, slope = float(np.ptp(p)), p[4:] - p[:-4]  # about fine[2:-2]
    sign = np.sign(slope) * (np.abs(slope) > SLOPE * whole)
    found = []
    for a, b in pairwise(np.r_[0, 1 + np.flatnonzero(np.diff(sign)), len(sign)]):
        begin, end = fine[a + 2] + 0.4 * span, fine[b + 1] - 0.4 * span  # a span sees a corner early
        if sign[a] and abs(p[min(b + 3, len(p) - 1)] - p[a]) > RAMP * whole:
            found.append((float(begin), float(max(begin, end))))
    return found


def _jump(time: Array, mm: Array, first: float, last: float) -> float:
    """Where the film jumps between two times, s; 0 where it does not."""
    own = np.flatnonzero((time >= first) & (time <= last))
    step = np.abs(np.diff(mm[own]))
    if len(step) <= LONG or step[k := int(step.argmax())] <= JUMP * np.delete(step, k).max():
        return 0.0
    return float(time[own[k] : own[k] + 2].mean())


def _measured(one: Corner, clock: Array, pressure: Array, about: float) -> Corner:
    """The corner with its delay; the sd is infinite where it has few frames, or other delays fit as well."""
    if len(one.time) < max(DEGREES) + 6:
        return one
    each = [_best(one, clock, pressure, about, degree) for degree in DEGREES]
    late = each[-1][0]
    sd = float(np.hypot(max(own[1] for own in each), late - each[0][0]))
    return Corner(one.time, one.mm, late, sd)


def _best(one: Corner, clock: Array, pressure: Array, about: float, degree: int) -> tuple[float, float]:
    """The delay of least squares and its sd, s, infinite where it is not clear."""
    step = max(0.25 * float(np.median(np.diff(one.time))), WITHIN_S / 100)
    shifts = about + np.arange(-WITHIN_S, WITHIN_S + step / 2, step)
    squares = np.array([one.squares(clock, pressure, s, degree=degree) for s in shifts])
    k = int(np.clip(squares.argmin(), 4, len(shifts) - 5))
    bend, slope, _ = np.polyfit(shifts[k - 4 : k + 5] - shifts[k], squares[k - 4 : k + 5], 2)
    if bend <= 0 or k != squares.argmin():
        return float(shifts[k]), np.inf
    late = float(shifts[k] - np.clip(slope / (2 * bend), -4 * step, 4 * step))
    left = one.left(clock, pressure, late, degree=degree)
    power = float(left @ left)
    rivals = squares[np.abs(shifts - late) > AWAY_S]
    if power > len(left) * (LEFT * float(np.ptp(one.mm))) ** 2 or power * RIVAL > rivals.min():
        return late, np.inf
    rho = float(np.clip(left[1:] @ left[:-1] / max(power, 1e-30), 0.0, 0.95))
    return late, float(np.sqrt(power / (len(left) - degree - 3) * (1 + rho) / (1 - rho) / bend))
