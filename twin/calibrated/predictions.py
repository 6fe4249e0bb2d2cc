"""A calibrated model and courses of pressure -> displacements that nobody has measured, and their errors.

The courses follow the film in one test of one model, so that what is uncertain is the same in both, and what
the film tells of it is carried over (`leftopen`). Beyond the tested pressure the silicone may stiffen in a
way that the film could not show: C20 is uncertain then, as far as the film leaves it open.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from twin.calibrated.predictionerrors import Uncertain, told_by_film
from twin.calibrated.problem import CalibrationProblem
from twin.gauge.pressureunits import in_MPa, unit_of
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.model.prediction import Model
from twin.targets import Array, Load, PointKind, TargetPoint, Targets, as_position

GAP = 60.0  # s at rest before every course: what creeps has nearly come back
TOO_MUCH = 1.0  # MPa: no soft finger has it
SAME = 1.001  # of the tested pressure: a gauge does not tell more
NORMAL = 1.96  # sds of a 95 % interval
LOW, HIGH = "end, low", "end, high"  # two points of the end face, whose turn is the tip's angle


@dataclass(frozen=True)
class WantedCourse:
    """Pressure (t,) MPa over time (t,) s, from 0 s on, the times (s,) s that are wanted, and the direction of
    gravity (3,), None: that of the film's first block. shares: what of the pressure surfaces carry; none: as
    there. loads: what hangs on the finger, of whatever block; None: as there."""

    time: Array
    pressure: Array
    output: Array
    gravity: Array | None = None
    shares: Mapping[str, float] = field(default_factory=dict)
    loads: tuple[Load, ...] | None = None

    @staticmethod
    def held(
        pressure: float,
        *,
        ramp_s: float,
        hold_s: float,
        gravity: Array | None = None,
        shares: Mapping[str, float] | None = None,
        loads: tuple[Load, ...] | None = None,
    ) -> "WantedCourse":
        """A ramp to a pressure in MPa, which is then held; wanted is its end."""
        time = np.cumsum([0.0, ramp_s, hold_s])
        course = np.array([0.0, pressure, pressure])
        return WantedCourse(time, course, time[-1:], gravity, shares or {}, loads)

    @staticmethod
    def logged(time: Array, pressure: Array, *, most: int) -> "WantedCourse":
        """The course of a log, times (t,) s and pressures (t,) MPa; most: number of its even output times."""
        rows = np.unique(np.linspace(0, len(time) - 1, min(len(time), most)).round().astype(int))
        return WantedCourse(time - time[0], pressure, (time - time[0])[rows])


@dataclass(frozen=True)
class Prediction:
    """Displacements u (s, p, 3) mm of named points relative to the finger at rest, at times (s,) s and
    pressures (s,) MPa.

    factors (q, s, p, 3) mm: independent errors of 1 sd each. beyond (s,): whether the pressure is above the
    tested one. angle (s,) degrees, by which the end face turns about y, from z to x, with its sd (s,); why:
    why there is no interval, "" where there is one. shape (s, n, 3) mm: displacements of all nodes, as the
    model has them. beside: what came to statics (s, p, 3) mm, which are u else; None where nothing did.
    """

    time: Array
    pressure: Array
    names: tuple[str, ...]
    u: Array
    factors: Array
    beyond: NDArray[np.bool_]
    angle: Array
    angle_sd: Array
    shape: Array
    why: str = ""
    beside: "Beside | None" = None
    statics: Array | None = None

    @property
    def sd(self) -> Array:
        """The sd (s, p, 3) mm of every displacement."""
        return np.asarray(np.sqrt((self.factors**2).sum(axis=0)))


@dataclass(frozen=True, kw_only=True)
class Beside:
    """What comes to statics along one course: u (s, p, 3) mm in all steps of a model, 0 before the course,
    its independent errors factors (q, s, p, 3) mm, and shape (k, n, 3) mm of all nodes in the course."""

    u: Array
    factors: Array
    shape: Array


def predicted(
    problem: CalibrationProblem,
    record: FitRecord,
    courses: Sequence[WantedCourse],
    places: Mapping[str, Array],
    say: Say,
    *,
    beside: Callable[[Model, Array, slice, Array, Array], Beside | None] | None = None,
) -> list[Prediction]:
    """Predictions of a fitted model, one for each course, at places (3,) mm by name.

    beside: what comes to statics, None for nothing, from the model, theta, the steps of a course, and u (s,
    p, 3) mm and factors (q, s, p, 3) mm of statics in all steps. Raises Unsolvable where there is no
    equilibrium.
    """
    targets = problem.targets
    extended, model = followed(problem, record, courses, places, say)
    fit = record.fit
    tested = SAME * float(targets.log_pressure.max())
    beyond = any(course.pressure.max() > tested for course in courses)
    u, factors = with_errors(model, record, targets, extended, beyond=beyond)
    starts = len(targets.time) + np.cumsum([0, *(1 + len(course.output) for course in courses)])
    steps = [slice(int(a) + 1, int(b)) for a, b in pairwise(starts)]  # the first is the rest before them
    statics = u
    came = [beside(model, fit.theta, rows, u, factors) if beside else None for rows in steps]
    for more in filter(None, came):
        u, factors = u + more.u, np.concatenate([factors, more.factors])
    angle, turns = turned(extended.names, u, factors, np.array(ends(problem)))
    columns, solution = [extended.names.index(name) for name in places], model.solution(fit.theta)
    node_count = len(problem.case.nodes)  # of a whole made of a half, the half comes first
    out = []
    for course, rows, added in zip(courses, steps, came, strict=True):
        pressure = np.interp(course.output, course.time, course.pressure)
        # what hangs on it has pulled the rest before it already, unless it is released there
        own = course.loads is None or extended.rests.any()
        before = [rows.start - 1] if own else targets.reference.tolist()
        shape = _shape(solution.fields, rows, before)[:, :node_count]
        out.append(Prediction(
            time=course.output,
            pressure=pressure,
            names=tuple(places),
            u=u[rows][:, columns],
            factors=factors[:, rows][:, :, columns],
            beyond=pressure > tested,
            angle=angle[rows],
            angle_sd=np.sqrt((turns[:, rows] ** 2).sum(axis=0)),
            shape=shape + added.shape[:, :node_count] if added else shape,
            why=why_none(record),
            beside=added,
            statics=statics[rows][:, columns] if added else None,
        ))  # fmt: skip
    return out


def _shape(fields: Callable[[list[int]], Array], rows: slice, rest: list[int]) -> Array:
    """Displacements (s, n, 3) mm of all nodes in these rows, relative to those at rest."""
    return np.asarray(fields(list(range(rows.start, rows.stop))) - fields(rest).mean(axis=0))


def interval(value: float, sd: float, why: str) -> tuple[float, float] | None:
    """The 95 % interval of a value with an sd; None where `why` says that there is none.

    >>> interval(0.5, 0.25, ""), interval(0.5, 0.25, "it does not fit")
    ((0.010000000000000009, 0.99), None)
    """
    return None if why else (value - NORMAL * sd, value + NORMAL * sd)


def with_errors(
    model: Model, record: FitRecord, targets: Targets, extended: Targets, *, beyond: bool
) -> tuple[Array, Array]:
    """Displacements (s, p, 3) mm of a fitted model, and their independent errors (k, s, p, 3) mm of 1 sd.

    targets: what it was fitted to. own: the same with what is to be predicted after it, which the model
    answers for. beyond: whether some of that lies above the tested pressure.
    """
    theta = record.fit.theta
    uncertain = Uncertain.of(model, theta, record, extended, beyond=beyond)
    change, factors = told_by_film(targets, model, theta, uncertain)
    u = model.predict(theta)
    return (u + change if record.adequate else u), factors  # else it would be what the model lacks


def followed(
    problem: CalibrationProblem,
    record: FitRecord,
    courses: Sequence[WantedCourse],
    places: Mapping[str, Array],
    say: Say,
) -> tuple[Targets, Model]:
    """The targets of a project with films that were not made (`after`), and its model of all of them."""
    low, high = ends(problem)
    extended = replace(problem, targets=after(problem.targets, courses, {**places, LOW: low, HIGH: high}))
    return extended.targets, extended.on_mesh(extended.model(), record.fit.theta, say)


def ends(problem: CalibrationProblem) -> tuple[Array, Array]:
    """The lowest and the highest place (3,) mm of the finger's end face."""
    x = problem.case.nodes[np.unique(problem.structure.outside)]
    face = x[x[:, 0] > x[:, 0].max() - 1e-6]
    return face[face[:, 2].argmin()], face[face[:, 2].argmax()]


def why_none(record: FitRecord) -> str:
    """The reason why a fit has no intervals; "" where it has."""
    if record.adequate:
        return ""
    notes = [row.note.partition("no interval: ")[2] for row in record.intervals.values()]
    return next(filter(None, notes), "the model does not fit its own film")


def after(
    targets: Targets, courses: Sequence[WantedCourse], places: Mapping[str, Array]
) -> Targets:
    """The targets with films that were not made, each a block of its own after GAP at rest, by default in the
    first orientation; and with more places (3,) mm by name, at which nothing is measured."""
    new = [TargetPoint(n, PointKind.PLACE, None, as_position(x)) for n, x in places.items()]
    points = [*targets.points, *(p for p in new if p.name not in targets.names)]
    s, p, last = len(targets.time), len(points), int(targets.block[-1])
    value = np.full((s, p, 3), np.nan)
    value[:, : len(targets.points)] = targets.value
    end, log = targets.log_time[-1], [(targets.log_time, targets.log_pressure)]
    step = [(targets.time, targets.pressure, targets.block)]
    for k, course in enumerate(courses):
        start = end + GAP
        rest = np.array([end + 1.0, start - 1.0])
        log.append((np.append(rest, start + course.time), np.append([0.0, 0.0], course.pressure)))
        pressure = np.interp(course.output, course.time, course.pressure)
        number = np.full(1 + len(course.output), last + 1 + k)
        step.append((np.append(start - 1.0, start + course.output), np.append(0.0, pressure), number))
        end = start + course.time[-1]
    time, pressure, block = (np.concatenate(x) for x in zip(*step, strict=True))
    more, n = len(time) - s, len(courses)
    first_steps = np.searchsorted(block, np.arange(last + 1, last + 1 + n))
    again = tuple(load for load in targets.loads if load.block == 0)
    hung = [again if course.loads is None else course.loads for course in courses]
    gravity = targets.gravity
    if gravity is not None:
        ways = [gravity[0] if course.gravity is None else course.gravity for course in courses]
        gravity = np.concatenate([gravity, np.reshape(ways, (n, 3))])

    shares = {
        name: np.append(first_steps, [course.shares.get(name, first_steps[0]) for course in courses])
        for name, first_steps in targets.shares.items()
    }

    def longer(x: Array, fill: float = np.nan) -> Array:
        return np.concatenate([x, np.full((more, *x.shape[1:]), fill)])

    shape = (len(time), p)
    return replace(
        targets,
        time=time, pressure=pressure, block=block, points=tuple(points), value=longer(value),
        covariance=np.full((*shape, 3, 3), np.nan), valid=np.zeros((*shape, 3), bool),
        held_out=np.append(targets.held_out, np.zeros(more, bool)),
        modes=np.zeros((0, *shape, 3)), mode_names=(),
        log_time=np.concatenate([t for t, _ in log]), log_pressure=np.concatenate([x for _, x in log]),
        reference=np.append(targets.reference, first_steps) if targets.rests.any() else targets.reference,
        pressure_sd=longer(targets.pressure_sd, 0.0),
        gravity=gravity, shares=shares,
        noises=(*targets.noises, *targets.noises[:1] * n),
        released=(*targets.released, *(range(last + 1, last + 1 + n) if 0 in targets.released else ())),
        loads=(*targets.loads, *(replace(load, block=last + 1 + k) for k in range(n) for load in hung[k])),
    )  # fmt: skip


def turned(names: tuple[str, ...], u: Array, factors: Array, face: Array) -> tuple[Array, Array]:
    """The turn (s,) of the end face about y in degrees, and its errors (q, s).

    u (s, p, 3) mm: displacements of all points, names (p,). factors (q, s, p, 3) mm: their errors.
    face (2, 3) mm: the lowest and the highest place of the end face.
    """
    low, high = names.index(LOW), names.index(HIGH)
    before, change = face[1] - face[0], u[:, high] - u[:, low]
    x, z = (before + change)[:, 0], (before + change)[:, 2]
    error = factors[:, :, high] - factors[:, :, low]
    turn = np.arctan2(x, z) - np.arctan2(before[0], before[2])
    return np.degrees(turn), np.degrees((z * error[..., 0] - x * error[..., 2]) / (x**2 + z**2))


def pressure_of(text: str, *, argument: str = "--pressure") -> float:
    """A pressure in MPa of a text with its unit, such as 20kPa. ValueError, which names the argument, where
    it is none.

    >>> pressure_of("20kPa"), pressure_of("0.2 bar")
    (0.02, 0.02)
    """
    match = re.fullmatch(r"\s*([-+]?[0-9.]+(?:e[-+]?\d+)?)\s*([A-Za-z()]+)\s*", text)
    what = f"{argument} {text!r}"
    if match is None:
        raise ValueError(f"{what}: wanted a number with its unit, such as 20kPa or 0.2bar")
    unit = unit_of(match[2], what=what)
    try:
        value = float(in_MPa(np.array([float(match[1])]), unit, line=None)[0])
    except (ValueError, AssertionError):
        raise ValueError(f"{what}: wanted a number with its unit, such as 20kPa or 0.2bar") from None
    if not 0 < value < TOO_MUCH:
        raise ValueError(f"{what} is {value:g} MPa: wanted above 0 and below {TOO_MUCH:g} MPa")
    return value
