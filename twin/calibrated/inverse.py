"""A wanted displacement -> the held pressure that gives it, and what is uncertain of that."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

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
        """Such as tip.U3=-40. ValueError where it is none."""
        found = re.fullmatch(r"\s*(.+)\.[uU]([123])\s*=\s*([-+]?[0-9.]+(?:e[-+]?\d+)?)\s*(?:mm)?\s*", text)
        try:
            assert found is not None
            return Wanted(found[1], int(found[2]) - 1, float(found[3]))
        except (AssertionError, ValueError):
            raise ValueError(
                f"--inverse {text!r}: wanted POINT.U1=MM, U2 or U3, such as tip.U3=-40 for 40 mm down"
            ) from None

    @property
    def words(self) -> str:
        """As it was asked for."""
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
        """Of 95 %, in MPa; none where the fit has none."""
        return interval(self.pressure, self.sd, self.prediction.why)


def pressure_for(
    problem: CalibrationProblem,
    record: FitRecord,
    wanted: Wanted,
    places: Mapping[str, Array],
    say: Say,
    held: Callable[[float], WantedCourse],
) -> Inverse:
    """The lowest held pressure that gives a wanted displacement of one of the places (3,) mm, by name; held:
    the course of a pressure in MPa.

    Displacements at RUNGS pressures, then Newton's method on what is predicted. ValueError where no pressure
    up to BEYOND times the tested one gives it.
    """
    own = {wanted.point: places[wanted.point]}
    tested, curve = float(problem.targets.log_pressure.max()), (np.zeros(1), np.zeros(1))
    begun = None
    for low, high in ((0.0, tested), (tested, BEYOND * tested)):
        more = np.linspace(low, high, RUNGS + 1)[1:]
        try:
            u = _reached(problem, record, wanted, own, [held(float(p)) for p in more], say)
        except Unsolvable:
            break
        curve = np.append(curve[0], more), np.append(curve[1], u)
        begun = first_crossing(*curve, wanted.value)
        if begun is not None:
            break
    if begun is None:
        raise ValueError(
            f"--inverse {wanted.words}: {wanted.point} moves by {curve[1].min():.4g} to "
            f"{curve[1].max():.4g} mm in U{wanted.axis + 1} up to {1e3 * curve[0][-1]:.4g} kPa; wanted a "
            "displacement between these"
        )
    pressure, slope = begun
    for _ in range(TURNS):
        course = held(pressure)
        (found,) = predicted(problem, record, [course], places, say)
        k = found.names.index(wanted.point)
        sd = float(found.sd[0, k, wanted.axis])
        off = wanted.value - float(found.u[0, k, wanted.axis])
        if abs(off) < max(NEAR_MM, NEAR * sd):
            break
        pressure = float(np.clip(pressure + off / slope, 1e-6, BEYOND * tested))
    return Inverse(wanted, pressure, sd / abs(slope), found, course)


def _reached(
    problem: CalibrationProblem,
    record: FitRecord,
    wanted: Wanted,
    places: Mapping[str, Array],
    courses: list[WantedCourse],
    say: Say,
) -> Array:
    """The wanted point's displacement (k,) mm at the end of each course."""
    targets, model = followed(problem, record, courses, places, say)
    u = model.predict(record.fit.theta)[:, targets.names.index(wanted.point), wanted.axis]
    return np.asarray(u[len(problem.targets.time) :][1::2])  # each after its rest


def first_crossing(pressure: Array, u: Array, value: float) -> tuple[float, float] | None:
    """The lowest pressure at which displacements u (k,) mm at increasing pressures (k,) MPa are a value, and
    the slope there in mm/MPa; None where they never are."""
    curve = PchipInterpolator(pressure, u - value)
    roots = [float(x) for x in curve.roots(extrapolate=False) if np.isfinite(x) and x > 0]
    roots = [x for x in roots if abs(float(curve(x, 1))) > 0]
    return (min(roots), float(curve(min(roots), 1))) if roots else None
