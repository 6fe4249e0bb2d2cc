"""Synchronise film and pressure log by the first rise of the displacements."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.gauge.pressurelog import Log
from twin.gauge.synchrony import Join, Motion
from twin.targets import Array

if TYPE_CHECKING:
    from vision import Video

REACHED = 0.6  # of the largest motion: the first rise ends there
MOVES = 30.0  # times its noise that the motion must reach
RIVAL = 4.0  # times the best fit's squares: another time whose fit is better than that is a rival
MOST_SHIFTS = 2000
RISING = 8  # places within the first rise that a polynomial and its scatter want


@dataclass(frozen=True)
class ByOnset:
    """Synchronised by the film's first rise, which is known once the film is measured."""

    def join(self, film: "Video", log: Log, motion: Callable[[], Motion]) -> Join:
        """The start of the film at which its first rise fits the pressure best."""
        return onset_join(motion(), log)


def onset_join(motion: Motion, log: Log) -> Join:
    """The join by the film's first rise: the shift at which motion is best a smooth function of pressure.

    motion = a p + b p^2 + c p^3 is fitted for every shift of the log; sd from the curvature of the squares,
    with the residual's lag-1 correlation, and from what the shift changes without c. A lag of the finger
    itself cannot be told from one of the clock. Raises ValueError where nothing moves, where too few places
    are within the rise, and where the log fits at two times.
    """
    t, m = _first_rise(motion)
    shifts = _shifts(log, t, motion.time)
    squares = np.array([_squares(t, m, log, s, 3) for s in shifts])
    best = int(np.argmin(squares))
    _check_rivals(shifts, squares, best, log)
    shift, sd = _refined(t, m, log, shifts, best, 3)
    other, _ = _refined(t, m, log, shifts, best, 2)
    sd = float(np.hypot(sd, shift - other))
    shift = float(np.clip(shift, log.time[0], log.time[-1] - motion.time[-1]))
    return Join(
        shift,
        sd,
        f"The film starts at {shift:.4f} +- {sd:.4f} s of the log: there its first rise fits the pressure "
        "best. A lag of the finger itself cannot be told from one of the clock.",
    )


def _first_rise(motion: Motion) -> tuple[Array, Array]:
    """Times (t,) s and motion (t,) mm up to the end of the first rise. ValueError where it is too little."""
    seen = np.isfinite(motion.mm)
    peak = float(np.max(motion.mm[seen])) if seen.any() else 0.0
    if peak < MOVES * motion.noise_mm:
        raise ValueError(
            f"pressure.join = 'onset': the finger moves by {peak:.3f} mm in the film, wanted {MOVES:g} times "
            f"the noise of {motion.noise_mm:.4f} mm; use join = 'stamps' or 'flash'"
        )
    end = int(np.argmax(np.where(seen, motion.mm, 0.0) > REACHED * peak)) + 1
    t, m = motion.time[:end][seen[:end]], motion.mm[:end][seen[:end]]
    rising = int(np.count_nonzero(m > MOVES * motion.noise_mm))
    if rising < RISING:
        raise ValueError(
            f"pressure.join = 'onset': {rising} steps lie within the film's first rise, wanted {RISING}: "
            "raise [measure] steps, film at a higher rate, or use join = 'stamps' or 'flash'"
        )
    return t, m


def _shifts(log: Log, t: Array, time: Array) -> Array:
    """Shifts (k,) s at which the log covers the whole film."""
    first, last = float(log.time[0]), float(log.time[-1] - time[-1])
    if last <= first:
        raise ValueError(
            f"{log.path.name} covers {log.time[-1] - log.time[0]:.3f} s, the film {time[-1]:.3f} s: "
            "wanted a log that covers all of it"
        )
    step = max(0.5 * float(np.median(np.diff(t))), (last - first) / MOST_SHIFTS)
    return np.arange(first, last, step)


def _squares(t: Array, m: Array, log: Log, shift: float, degree: int) -> float:
    return float(np.sum(_residual(t, m, log, shift, degree) ** 2))


def _residual(t: Array, m: Array, log: Log, shift: float, degree: int) -> Array:
    """What a polynomial of the pressure, 0 at the log's rest, leaves of the motion."""
    p, span = log.at(t + shift), max(float(np.abs(log.pressure).max()), 1e-12)
    p = (p - p[0]) / span
    powers = p[:, None] ** np.arange(1, degree + 1)
    found, *_ = np.linalg.lstsq(powers, m, rcond=None)
    return np.asarray(m - powers @ found)


def _check_rivals(shifts: Array, squares: Array, best: int, log: Log) -> None:
    """Raise ValueError where another valley of the squares is nearly as deep."""
    inner = squares[1:-1]
    valleys = 1 + np.flatnonzero((inner < squares[:-2]) & (inner <= squares[2:]))
    far = [k for k in valleys if k != best and abs(k - best) > 2 and squares[k] < RIVAL * squares[best]]
    if far:
        raise ValueError(
            f"pressure.join = 'onset': the film's first rise fits {log.path.name} at {shifts[best]:.2f} s "
            f"and at {shifts[far[0]]:.2f} s; cut the log to one test, or use join = 'stamps' or 'flash'"
        )


def _refined(t: Array, m: Array, log: Log, shifts: Array, best: int, degree: int) -> tuple[float, float]:
    """Minimum of the squares near a shift, by ever narrower parabolas, and its sd.

    The last reaches a quarter of a frame interval to each side: the log's noise makes the squares rough from
    shift to shift, and kinks of the pressure make wide parabolas lopsided.
    """
    shift, width = float(shifts[best]), float(np.median(np.diff(t)))
    curvature = 0.0
    for share in (1.0, 0.5, 0.25, 0.25):
        near = share * np.linspace(-width, width, 11)
        bend, slope, _ = np.polyfit(near, [_squares(t, m, log, shift + x, degree) for x in near], 2)
        curvature = 2.0 * float(bend)
        if curvature > 0:
            shift += float(np.clip(-slope / curvature, -width, width))
    left = _residual(t, m, log, shift, degree)
    power = float(left @ left)
    rho = float(np.clip(left[1:] @ left[:-1] / max(power, 1e-30), 0.0, 0.95))
    # The log's noise moves the prediction within the rise only, which alone tells the shift.
    rise = left[m > 0.05 * m.max()]
    scatter = max(power / max(len(left) - degree - 1, 1), float(rise @ rise) / max(len(rise) - degree - 1, 1))
    variance = scatter * (1.0 + rho) / (1.0 - rho)
    sd = np.sqrt(2.0 * variance / curvature) if curvature > 0 else width
    return shift, float(sd)
