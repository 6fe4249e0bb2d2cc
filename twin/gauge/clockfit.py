"""The clocks of film and pressure log: one clock, judged by the finger's delay at the pressure's corners."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from twin.effects.loads import first_order_lag
from twin.gauge.pressurelog import Log
from twin.gauge.synchrony import Join, LagFit, Motion, parabola
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
    (low, low_sd), (late, sd) = (_of_degree(replace(fit, degree=degree), about) for degree in DEGREES)
    return Corner(fit, late, float(np.hypot(max(low_sd, sd), late - low)))


def _of_degree(fit: LagFit, about: float) -> tuple[float, float]:
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


SDS, FLOOR_S = 4.0, 0.05  # from which a delay counts; a gauge's own filter takes some hundredths of a second
LAG_S = 0.4  # by which corners differ where a valve vents slower than it fills
DRIFT_S, LINE = 0.15, 0.25  # by which delays on a line differ, at least; share of that they lie off the line
# What may look like another clock: a line's lag, s, and friction, as shares of the pressure's range, where
# they leave at most so many times the squares of the best delay.
LAGS_S, FRICTION, AS_WELL = (0.0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6), (0.0, 0.02, 0.05, 0.1), 4.0
ORIGINAL = "use the original file, or pictures with times.csv"


def check_clock(motion: Motion, log: Log, join: Join, *, by: str) -> tuple[tuple[str, ...], str]:
    """A sentence where the finger moves later than the pressure by more than the clocks are stated to, which
    a pressure line can do; and one on what was measured, for the log of the run.

    Raises ValueError for what no finger and no pressure line does: it moves before the pressure, or its delay
    drifts or jumps.   by: `join` of twin.toml; one by the onset of motion takes the least delay as none.
    """
    delays = corners(motion, log, join.start_s)
    if not delays:
        return (), f"No corner of {log.path.name} tells how late the finger moves."
    late, time = np.array([c.late_s for c in delays]), np.array([c.at_s for c in delays])
    sd = np.hypot([c.sd_s for c in delays], 0.25 * (frame := float(np.median(np.diff(motion.time)))))
    if by == "onset":
        late = late - late.min()
    limit = np.maximum(SDS * np.hypot(sd, join.sd_s), max(frame, FLOOR_S))
    if fault := _fault(delays, late, limit, log, join, by):
        raise ValueError(fault)
    mean, least = float(np.average(late, weights=sd**-2)), float(np.sum(sd**-2) ** -0.5)
    note = (
        f"The finger moves {mean:.3f} +- {least:.3f} s later than {log.path.name}, by {len(delays)} corners "
        f"of the pressure ({late.min():.3f} to {late.max():.3f} s)."
    )
    if len(delays) > 2:
        rate, _, rate_sd = _line(time, late, sd)
        note += f" The film's times run {100 * rate:.2f} +- {100 * rate_sd:.2f} % fast."
    if by == "onset" or mean <= max(SDS * np.hypot(least, join.sd_s), frame, FLOOR_S):
        return (), note
    return (
        f"The finger moves {mean:.2f} s later than the pressure of {log.path.name} ({late.min():.2f} to "
        f"{late.max():.2f} s, by {len(delays)} of its corners), and the clocks are stated to {join.sd_s:.2g} "
        "s. Does the pressure line lag, or is film_start_s too late? `twin diagnose` tests both "
        "(pressure_lag, time_shift).",
    ), note


def _fault(delays: Sequence[Corner], late: Array, limit: Array, log: Log, join: Join, by: str) -> str:
    """Sentence on delays that no finger has, "" without one."""
    order, time = late.argsort(), np.array([c.at_s for c in delays])
    earliest, latest = order[[1, -2]] if len(late) > 4 else order[[0, -1]]  # of many, one corner may be wrong
    spread = float(late[latest] - late[earliest])
    apart = spread > float(np.hypot(limit[earliest], limit[latest]))
    rate, off, _ = _line(time, late, limit) if len(delays) > 3 else (0.0, np.inf, np.inf)
    before = [c for c, x, least in zip(delays, late, limit, strict=True) if -x > least]
    drifts = apart and spread > DRIFT_S and off < LINE * spread
    early = -late[earliest] > limit[earliest] and not _physics(before, log, join.start_s)
    wide = apart and spread > LAG_S and not _physics([delays[earliest], delays[latest]], log, join.start_s)
    if not (early or wide or drifts):
        return ""
    changes = float(np.ptp(late)) > float(np.hypot(limit[order[0]], limit[order[-1]]))
    a, b = sorted((order[0], order[-1])) if changes else (earliest, earliest)
    then = f", {_delay(late[b])} it at {time[b]:.1f} s" if changes else ""
    text = (
        f"film and {log.path.name} do not run on one clock: the finger moves {_delay(late[a])} the pressure "
        f"at {time[a]:.1f} s of the film{then}; no finger does so, and the clocks are stated to "
        f"{join.sd_s:.2g} s; "
    )
    if drifts:
        return f"{text}the film's times run {100 * abs(rate):.1f} % {_fast(rate)}: {ORIGINAL}"
    if changes:
        k = int(np.abs(np.diff(late)).argmax())
        where = f"between {time[k]:.1f} and {time[k + 1]:.1f} s"
        return f"{text}frames were lost {where}, or its frame rate was changed or made constant: {ORIGINAL}"
    if by != "stamps":
        return f"{text}did the lamp go on when the log says? Where frames were lost, {ORIGINAL}"
    start = join.start_s - float(np.average(late, weights=limit**-2))
    return (
        f"{text}correct film_start_s ({start:.2f} s would fit), or state in sync_sd_s how well it is known "
        f"(a gauge that filters reads late); where frames were lost, {ORIGINAL}"
    )


def _delay(late: float) -> str:
    return f"{abs(late):.2f} s {'after' if late > 0 else 'before'}"


def _fast(rate: float) -> str:
    return "fast" if rate > 0 else "slow"


def _line(time: Array, late: Array, sd: Array) -> tuple[float, float, float]:
    """Slope of the delays over the film's time, how far they lie off it (rms, s), and the slope's sd."""
    line, covariance = np.polyfit(time, late, 1, w=1 / sd, cov="unscaled")
    return float(line[0]), float(np.std(late - np.polyval(line, time))), float(np.sqrt(covariance[0, 0]))


def _physics(delays: Sequence[Corner], log: Log, start_s: float) -> bool:
    """True where one delay, one lag of the pressure line and friction explain the motion at these corners."""
    clock, log_range = log.time - start_s, float(np.ptp(log.pressure))
    best = [AS_WELL * c.squares(c.late_s) for c in delays]
    for share, tau in product(FRICTION, LAGS_S):
        pressure = first_order_lag(clock, _held(log.pressure, share * log_range), tau)
        for late in np.arange(0.0, WITHIN_S, FLOOR_S).tolist():
            if all(c.squares(late, pressure) <= most for c, most in zip(delays, best, strict=True)):
                return True
    return False


def _held(pressure: Array, by: float) -> Array:
    """Effective pressure (t,) MPa with friction, which holds it until the pressure has turned by twice `by`.

    >>> _held(np.array([0.0, 1.0, 0.9, 0.0]), 0.1).round(3).tolist()
    [0.0, 0.9, 0.9, 0.1]
    """
    out, now = np.empty_like(pressure), float(pressure[0])
    for k, p in enumerate(pressure.tolist()):
        out[k] = now = min(max(now, p - by), p + by)
    return out
