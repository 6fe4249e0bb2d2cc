"""The interface of the ways to synchronise film and pressure log, and the estimator of the lag between
pressure and motion.

At each shift a polynomial of the pressure is fitted to the motion by least squares, so that neither scale
nor law of the finger matters. The sum of squares over the shifts has its minimum at the lag; its curvature
and the scatter give the sd, sqrt(2 variance / curvature). The variance of the residual is widened by its
lag-one correlation rho by (1 + rho) / (1 - rho) (Bartlett 1946, doi 10.2307/2983611).

"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from twin.gauge.pressurelog import Log
from twin.targets import Array

if TYPE_CHECKING:  # vision takes a second to import: only the stages that measure pay for it
    from vision import Video


@dataclass(frozen=True)
class Join:
    """When the film's first frame was taken on the log's clock, how well that is known, and what to say."""

    start_s: float
    sd_s: float
    remark: str  # one sentence or none


@dataclass(frozen=True)
class Motion:
    """Distance of the finger from its rest at evenly spaced times of the film."""

    time: Array  # (s,) s from the first frame
    mm: Array  # (s,) NaN where nothing is seen
    noise_mm: float  # its sd


class Joining(Protocol):
    """A way to synchronise film and pressure log: one class for each `join` of twin.toml."""

    def join(self, film: "Video", log: Log, motion: Callable[[], Motion]) -> Join:
        """When the film's first frame was taken on the log's clock.

        motion: measures the film, which takes long: a way that needs no displacements does not call it.
        """


@dataclass(frozen=True)
class LagFit:
    """A stretch of motion (n,) mm at times (n,) s of the film, beside pressures (t,) MPa at log_time (t,) s.

    degree: of the polynomial; constant: with a constant term, else 0 at the first pressure; creep: with the
    integral of the pressure.

    >>> log_time = np.linspace(0, 20, 201)
    >>> pressure = 0.03 * np.clip((log_time - 5) / 4, 0, 1)
    >>> time = np.linspace(0, 8, 81)
    >>> motion = 40 * np.interp(time + 2.5, log_time, pressure)
    >>> fit = LagFit(time, motion, log_time, pressure, degree=1)
    >>> shifts = np.arange(1.0, 4.0, 0.5)
    >>> float(shifts[np.argmin([fit.squares(shift) for shift in shifts])])
    2.5
    >>> round(fit.explained(2.5), 6), fit.explained(1.0) < 0.95
    (1.0, True)
    """

    time: Array
    mm: Array
    log_time: Array
    pressure: Array
    degree: int = 3
    constant: bool = True
    creep: bool = False

    @staticmethod
    def of(time: Array, mm: Array, log: Log, *, constant: bool = True) -> "LagFit":
        """The fit beside a pressure log; shifts are times of the film's first frame on the log's clock."""
        return LagFit(time, mm, log.time, log.pressure, constant=constant)

    def residual(self, shift: float, rate: float = 1.0) -> Array:
        """Motion (n,) mm less the best polynomial of the pressure at `rate` time + `shift`."""
        p = np.interp(rate * self.time + shift, self.log_time, self.pressure)
        p = (p - (p.mean() if self.constant else p[0])) / max(float(np.abs(self.pressure).max()), 1e-12)
        columns = p[:, None] ** np.arange(0 if self.constant else 1, self.degree + 1)
        if self.creep:
            integral = np.r_[0.0, np.cumsum(0.5 * (p[1:] + p[:-1]) * np.diff(self.time))]
            columns = np.column_stack([columns, integral])
        return np.asarray(self.mm - columns @ np.linalg.lstsq(columns, self.mm, rcond=None)[0])

    def squares(self, shift: float, rate: float = 1.0) -> float:
        """Sum of squares of the residual, mm2."""
        residual = self.residual(shift, rate)
        return float(residual @ residual)

    def explained(self, shift: float, rate: float = 1.0) -> float:
        """Share of the motion's variance that the pressure explains, 0 to 1."""
        total = float(np.sum((self.mm - self.mm.mean()) ** 2))
        return max(1.0 - self.squares(shift, rate) / max(total, 1e-30), 0.0)

    def sd(self, shift: float, curvature: float, *, mask: Array | None = None) -> float:
        """The sd of the best shift, s, from the curvature of the squares in mm2/s2.

        mask (n,): where the scatter is at least as telling; the larger of the two scatters counts.
        """
        residual, fitted = self.residual(shift), self.degree + self.constant + self.creep
        power = float(residual @ residual)
        rho = float(np.clip(residual[1:] @ residual[:-1] / max(power, 1e-30), 0.0, 0.95))
        parts = [residual] if mask is None else [residual, residual[mask]]
        scatter = max(float(part @ part) / max(len(part) - fitted - 1, 1) for part in parts)
        return float(np.sqrt(2.0 * scatter * (1.0 + rho) / (1.0 - rho) / curvature))


def parabola(shifts: Array, squares: Array, limit: float) -> tuple[float, float]:
    """Minimum and curvature of the parabola through squares at shifts; the minimum lies at most `limit` from
    the middle shift.

    >>> shifts = np.linspace(-1, 1, 9)
    >>> minimum, curvature = parabola(shifts, 3 * (shifts - 0.2) ** 2 + 1, limit=0.5)
    >>> round(minimum, 9), round(curvature, 9)
    (0.2, 6.0)
    """
    middle = float(shifts[len(shifts) // 2])
    bend, slope, _ = np.polyfit(shifts - middle, squares, 2)
    if bend <= 0:
        return middle, 2.0 * float(bend)
    return middle + float(np.clip(-slope / (2.0 * bend), -limit, limit)), 2.0 * float(bend)
