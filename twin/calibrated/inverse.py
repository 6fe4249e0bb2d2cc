"""Inverse prediction: the held pressure that gives a wanted displacement, and its uncertainty."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from twin.calibrated.predictions import Prediction, WantedCourse, followed, interval, predicted
from twin.calibrated.problem import CalibrationProblem
from twin.effects.protocol import Unsolvable
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.targets import Array

RUNGS, BEYOND = 8, 1.5  # pressures that are tried up to the tested one, and how far above it
NEAR = 0.1  # sds, or
NEAR_MM = 1e-3  # mm, of the wanted displacement
TURNS = 3  # times the pressure is corrected


@dataclass(frozen=True)
class Wanted:
    """A displacement in mm of a point along an axis (0, 1, 2)."""

    point: str
    axis: int
    value: float

    @staticmethod
    def of(text: str) -> "Wanted":
        """The displacement that a text such as tip.U3=-40 names. ValueError where it is none.

        >>> Wanted.of("tip.U3=-40")
        Wanted(point='tip', axis=2, value=-40.0)
        """
        match = re.fullmatch(r"\s*(.+)\.[uU]([123])\s*=\s*([-+]?[0-9.]+(?:e[-+]?\d+)?)\s*(?:mm)?\s*", text)
        try:
            assert match is not None
            return Wanted(match[1], int(match[2]) - 1, float(match[3]))
        except (AssertionError, ValueError):
            raise ValueError(
                f"--inverse {text!r}: wanted POINT.U1=MM, U2 or U3, such as tip.U3=-40 for 40 mm down"
            ) from None

    @property
    def words(self) -> str:
        """The text of the option, such as tip.U3=-40."""
        return f"{self.point}.U{self.axis + 1}={self.value:g}"


@dataclass(frozen=True)
class Inverse:
    """The pressure in MPa that gives a wanted displacement, its sd, and what is predicted in its course."""

    wanted: Wanted
    pressure: float
    sd: float
    prediction: Prediction
    course: WantedCourse

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval in MPa; None where the fit has none."""
        return interval(self.pressure, self.sd, self.prediction.why)


def pressure_for(
    problem: CalibrationProblem,
    record: FitRecord,
    target: Wanted,
    places: Mapping[str, Array],
    say: Say,
    held: Callable[[float], WantedCourse],
) -> Inverse:
    """The lowest held pressure that gives a wanted displacement.

    places: positions (3,) mm by name. held: function that makes the course of a pressure in MPa.
    Displacements at RUNGS pressures come first, then Newton's method on predictions. ValueError where no
    pressure up to BEYOND times the tested one gives it.
    """
    place = {target.point: places[target.point]}
    tested, curve = float(problem.targets.log_pressure.max()), (np.zeros(1), np.zeros(1))
    crossing = None
    for low, high in ((0.0, tested), (tested, BEYOND * tested)):
        more = np.linspace(low, high, RUNGS + 1)[1:]
        try:
            u = _reached(problem, record, target, place, [held(float(p)) for p in more], say)
        except Unsolvable:
            break
        curve = np.append(curve[0], more), np.append(curve[1], u)
        crossing = first_crossing(*curve, target.value)
        if crossing is not None:
            break
    if crossing is None:
        raise ValueError(
            f"--inverse {target.words}: {target.point} moves by {curve[1].min():.4g} to "
            f"{curve[1].max():.4g} mm in U{target.axis + 1} up to {1e3 * curve[0][-1]:.4g} kPa; wanted a "
            "displacement between these"
        )
    pressure, slope = crossing
    for _ in range(TURNS):
        course = held(pressure)
        (prediction,) = predicted(problem, record, [course], places, say)
        k = prediction.names.index(target.point)
        sd = float(prediction.sd[0, k, target.axis])
        residual = target.value - float(prediction.u[0, k, target.axis])
        if abs(residual) < max(NEAR_MM, NEAR * sd):
            break
        pressure = float(np.clip(pressure + residual / slope, 1e-6, BEYOND * tested))
    return Inverse(target, pressure, sd / abs(slope), prediction, course)


def _reached(
    problem: CalibrationProblem,
    record: FitRecord,
    target: Wanted,
    places: Mapping[str, Array],
    courses: list[WantedCourse],
    say: Say,
) -> Array:
    """The wanted point's displacement (k,) mm at the end of each course."""
    targets, model = followed(problem, record, courses, places, say)
    u = model.predict(record.fit.theta)[:, targets.names.index(target.point), target.axis]
    return np.asarray(u[len(problem.targets.time) :][1::2])  # each after its rest


def first_crossing(pressure: Array, u: Array, value: float) -> tuple[float, float] | None:
    """The lowest pressure at which displacements u (k,) mm at increasing pressures (k,) MPa are a value, and
    the slope there in mm/MPa; None where they never are.

    >>> first_crossing(np.array([0.0, 0.01, 0.02]), np.array([0.0, -5.0, -10.0]), -5.0)
    (0.01, -500.0)
    """
    curve = scipy.interpolate.PchipInterpolator(pressure, u - value)
    roots = [float(x) for x in curve.roots(extrapolate=False) if np.isfinite(x) and x > 0]
    roots = [x for x in roots if abs(float(curve(x, 1))) > 0]
    return (min(roots), float(curve(min(roots), 1))) if roots else None
