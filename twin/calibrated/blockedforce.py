"""The blocked force: the force of a finger under a held pressure whose end is kept at its height.

The force acts on the end face, grows with the pressure as it rises, and is the one at which the middle of the
end face has not moved in z when the pressure is reached: the blocked force of soft robotics. What the film
leaves open is carried over as in `predicting`: errors of the height, over the end's compliance, are errors of
the force.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from twin.calibrated.predictionerrors import Uncertain, told_by_film
from twin.calibrated.predictions import HIGH, LOW, SAME, WantedCourse, followed, interval, why_none
from twin.calibrated.problem import CalibrationProblem
from twin.effects.protocol import Unsolvable
from twin.effects.standinforces import OutsideForce
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.targets import Array, Targets

NEAR_MM = 1e-3  # of the height that is kept
TURNS = 12  # solves at most


@dataclass(frozen=True)
class Blocked:
    """The upward force in N that keeps the finger's end at its height, and its sd, at a pressure in MPa.

    beyond: whether the pressure is above the tested one. why: why there is no interval, "" where there is
    one.
    """

    pressure: float
    force: float
    sd: float
    beyond: bool
    why: str

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval in N; None where the fit has none."""
        return interval(self.force, self.sd, self.why)


def blocked_force(problem: CalibrationProblem, record: FitRecord, course: WantedCourse, say: Say) -> Blocked:
    """The force at the end of a course. ValueError where none is found that keeps the end at its height."""
    extended, model = followed(problem, record, [course], {}, say)
    theta, fitted = record.fit.theta, model.named(record.fit.theta)
    pressure = float(np.interp(course.output[-1], course.time, course.pressure))
    beyond = pressure > SAME * float(problem.targets.log_pressure.max())
    force_effect = OutsideForce(1.0, ("up",), growing=True)
    (name,) = (p.name for p in force_effect.parameters)
    bare = model.on_mesh(None)
    pushed = bare.with_effect(force_effect)
    # As much as at the free finger: a finer mesh changes what the pressure does more than the compliance.
    finer = _height(extended, model.predict(theta)) - _height(extended, bare.predict(theta))

    def at(rate: float) -> Array:
        return pushed.theta({**fitted, name: rate})

    def height(rate: float) -> tuple[float, float]:
        k = [p.name for p in pushed.parameters].index(name)
        u, slope = pushed.predict(at(rate)), pushed.jacobian(at(rate))[k]
        return _height(extended, u) + finer, _height(extended, slope)

    rate, slope = _kept(height, pressure)
    uncertain = Uncertain.of(model, theta, record, extended, beyond=beyond)
    columns, s = uncertain.columns.copy(), len(problem.targets.time)
    free = [p.name != name and p.name not in record.at_bound for p in pushed.parameters]
    columns[: sum(free), s:] = pushed.jacobian(at(rate))[free][:, s:]
    change, factors = told_by_film(problem.targets, model, theta, replace(uncertain, columns=columns))
    if record.adequate:  # what the film asks of mesh and laws moves the end, too
        rate -= _height(extended, change) / slope
    height_errors = np.array([_height(extended, factor) for factor in factors])
    return Blocked(
        pressure=pressure,
        force=pressure * rate,
        sd=pressure * float(np.linalg.norm(height_errors)) / abs(slope),
        beyond=beyond,
        why=why_none(record),
    )


def _height(targets: Targets, u: Array) -> float:
    """By how much the middle of the end face has moved in z, mm, at the last step of u (s, p, 3) mm."""
    ends = [targets.names.index(name) for name in (LOW, HIGH)]
    return float(u[-1, ends, 2].mean())


def _kept(height: Callable[[float], tuple[float, float]], pressure: float) -> tuple[float, float]:
    """The force in N per MPa at which the end has not moved, by Newton's method, and mm per N/MPa there.

    A step that cannot be solved is halved: a large force on a soft finger folds it.
    """
    rate, (u, slope) = 0.0, height(0.0)
    for _ in range(TURNS):
        if abs(u) < NEAR_MM:
            return rate, slope
        step = -u / slope
        for _ in range(4):
            try:
                u, slope = height(rate + step)
                rate += step
                break
            except Unsolvable:
                step /= 2
        else:
            break
    raise ValueError(
        f"no force was found that keeps the finger's end at its height under {1e3 * pressure:.4g} kPa: with "
        f"{pressure * rate:.3g} N it is still {u:+.2f} mm off, and with more the finger folds; wanted a "
        "lower pressure"
    )
