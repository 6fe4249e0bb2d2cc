"""Synchronise film and pressure log by the displacements: all corners decide where, the first rise when."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from twin.gauge.pressurelog import Log
from twin.gauge.synchrony import Join, LagFit, Motion, parabola
from twin.targets import Array

if TYPE_CHECKING:
    from vision import Video

REACHED = 0.6  # of the largest motion: the first rise ends there
MOVES = 30.0  # times its noise that the motion must reach
RIVAL = 4.0  # times the best fit's squares: another time whose fit is better than that is a rival
MOST_SHIFTS, STEP_S = 2000, 0.05  # shifts that are tried, the widest step between them
RISING = 8  # places within the first rise that a polynomial and its scatter want


@dataclass(frozen=True)
class ByOnset:
    """Synchronised by the finger's motion, which is known once the film is measured."""

    def join(self, film: "Video", log: Log, motion: Callable[[], Motion]) -> Join:
        """The start of the film at which its motion fits the pressure best."""
        return onset_join(motion(), log)


def onset_join(motion: Motion, log: Log) -> Join:
    """The join by the finger's motion: the shift at which it is best a smooth function of pressure.

    All corners of the film decide which stretch of the log it shows. There motion = a p + b p^2 + c p^3 of
    the first rise alone is fitted for every shift, as nothing has crept yet; sd from the curvature of the
    squares, with the residual's lag-1 correlation, and from what the shift changes without c. A lag of the
    finger itself cannot be told from one of the clock. Raises ValueError where nothing moves, where too few
    places are within the rise, and where the log fits at two times.
    """
    _check_moves(motion)
    start = whole_film(motion, log)
    fit = LagFit.of(*_first_rise(motion), log, constant=False)
    shift, sd = _refined(fit, start)
    quadratic, _ = _refined(replace(fit, degree=2), start)
    sd = float(np.hypot(sd, shift - quadratic))
    shift = float(np.clip(shift, log.time[0], log.time[-1] - motion.time[-1]))
    return Join(
        shift,
        sd,
        f"The film starts at {shift:.4f} +- {sd:.4f} s of the log: there its motion fits the pressure "
        "best. A lag of the finger itself cannot be told from one of the clock.",
    )


def whole_film(motion: Motion, log: Log) -> float:
    """The shift in s, to half a frame, at which all of the motion is best a smooth function of the pressure
    and its integral. Raises ValueError where nothing moves, and where the log fits at two times."""
    _check_moves(motion)
    seen = np.isfinite(motion.mm)
    fit = LagFit(motion.time[seen], motion.mm[seen], log.time, log.pressure, creep=True)
    shifts = _shifts(log, fit.time, motion.time)
    squares = np.array([fit.squares(shift) for shift in shifts])
    best = int(np.argmin(squares))
    _check_rivals(shifts, squares, best, log)
    return float(shifts[best])


def _check_moves(motion: Motion) -> None:
    """Raise ValueError where the motion hardly stands out of its noise."""
    peak = float(np.nanmax(motion.mm, initial=0.0))
    if peak < MOVES * motion.noise_mm:
        raise ValueError(
            f"pressure.join = 'onset': the finger moves by {peak:.3f} mm in the film, wanted {MOVES:g} times "
            f"the noise of {motion.noise_mm:.4f} mm; use join = 'stamps' or 'flash'"
        )


def _first_rise(motion: Motion) -> tuple[Array, Array]:
    """Times (t,) s and motion (t,) mm up to the end of the first rise. ValueError where it is too little."""
    seen = np.isfinite(motion.mm)
    peak = float(np.max(motion.mm[seen]))
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
    earliest, latest = float(log.time[0]), float(log.time[-1] - time[-1])
    if latest <= earliest:
        raise ValueError(
            f"{log.path.name} covers {log.time[-1] - log.time[0]:.3f} s, the film {time[-1]:.3f} s: "
            "wanted a log that covers all of it"
        )
    step = max(min(0.5 * float(np.median(np.diff(t))), STEP_S), (latest - earliest) / MOST_SHIFTS)
    return np.arange(earliest, latest, step)


def _check_rivals(shifts: Array, squares: Array, best: int, log: Log) -> None:
    """Raise ValueError where another valley of the squares is nearly as deep."""
    inner = squares[1:-1]
    valleys = 1 + np.flatnonzero((inner < squares[:-2]) & (inner <= squares[2:]))
    far = [k for k in valleys if k != best and abs(k - best) > 2 and squares[k] < RIVAL * squares[best]]
    if far:
        raise ValueError(
            f"pressure.join = 'onset': the finger's motion fits {log.path.name} at {shifts[best]:.2f} s "
            f"and at {shifts[far[0]]:.2f} s; cut the log to one test, or use join = 'stamps' or 'flash'"
        )


def _refined(fit: LagFit, shift: float) -> tuple[float, float]:
    """Minimum of the squares near a shift, by ever narrower parabolas, and its sd.

    The last reaches a quarter of a frame interval to each side: the log's noise makes the squares rough from
    shift to shift, and kinks of the pressure make wide parabolas lopsided.
    """
    width, curvature = float(np.median(np.diff(fit.time))), 0.0
    for share in (1.0, 0.5, 0.25, 0.25):
        near = shift + share * np.linspace(-width, width, 11)
        shift, curvature = parabola(near, np.array([fit.squares(x) for x in near]), width)
    # The log's noise moves the prediction within the rise only, which alone tells the shift.
    rise = fit.mm > 0.05 * fit.mm.max()
    return shift, fit.sd(shift, curvature, mask=rise) if curvature > 0 else width
