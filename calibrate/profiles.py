"""Likelihood profiles: how far a parameter, or a sum or a share of two, may go before the fit is worse than
chance allows.

The deviance of a value is the lowest chi2 with it held and all else fitted anew, less that of the best fit
(A. Raue et al. 2009, doi:10.1093/bioinformatics/btp358). An interval ends where it reaches a quantile of chi2
with one degree of freedom. A covariance knows the slope at the best fit alone; a profile knows bounds and
curved valleys too. Derivatives at the best fit say where an end should lie; there the model is solved and all
else is fitted. The root of the deviance, which grows by 1 a standard deviation, says where next.

Where errors depend on the parameters, a value is tested under those that it would have itself, where the
derivatives see the others: both chi2 are whitened by them, that of the best fit too. Errors held as at the
best fit make an interval too narrow where they hide a parameter there and not beside it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from calibrate.fit import AT_BOUND, DAMPING, Jacobian, Residual, bounded_step, inside, least_squares
from calibrate.parameters import Array, Parameter, bounds

LEVELS = (1.0, 3.84)  # deviance at the ends of the 68 % and of the 95 % interval
MISSED = 0.02  # of a deviance, by which a found end may miss its level: 0.01 and 0.005 sd
TOLERANCE = 0.03  # sd, to which the others are fitted
EVALUATIONS = 25  # of one fit of the others
REACH = 2.5  # typical steps of a value that a search goes at first; twice as far every further time
MARGIN = 0.05  # of what is left between two ends that a search keeps from both
CLOSE = 0.1  # typical steps: as near as this a limit of what can be solved is looked for
MOST = 30  # values that a search tries

Pair = tuple[Array, Array]
Around = Callable[[Array], tuple[Residual, Jacobian]]
Limit = Literal["", "bound", "unsolvable", "search"]
IDENTIFIED, ONE_SIDED, NOT_IDENTIFIED = "identified", "one-sided", "not identified"


@dataclass(frozen=True, eq=False)
class Slice:
    """What is left to vary where a value is held: theta = point (d,) + directions (d, k) y, with y (k,) from
    low (k,) to high (k,)."""

    point: Array
    directions: Array
    low: Array
    high: Array

    def theta(self, y: Array) -> Array:
        """Parameters (d,) at y (k,)."""
        return np.asarray(self.point + self.directions @ y)

    def nearest(self, theta: Array) -> Array:
        """The y (k,) within its bounds that comes near theta (d,)."""
        size = (self.directions**2).sum(axis=0)
        return np.clip(self.directions.T @ (theta - self.point) / size, self.low, self.high)


@dataclass(frozen=True, eq=False)
class Held:
    """What a profile holds: a parameter, or the sum a + b or the share b / (a + b) of two.

    low, high: its ends within the bounds of the parameters. typical: a change of it that is felt. rows: which
    parameters it is made of. value: theta (d,) -> its value. line: value -> where these parameters may lie
    then, a point (1 or 2,) and a direction (1 or 2,) from it, 0 for one alone. slope: theta (d,) -> the
    derivative (d,) of its value.
    """

    name: str
    unit: str
    low: float
    high: float
    typical: float
    parameters: tuple[Parameter, ...]
    rows: tuple[int, ...]
    value: Callable[[Array], float]
    line: Callable[[float], Pair]
    slope: Callable[[Array], Array]

    @staticmethod
    def parameter(parameters: Sequence[Parameter], name: str) -> "Held":
        """One parameter. Raises ValueError for a name that none has."""
        names = [p.name for p in parameters]
        if name not in names:
            raise ValueError(f"profile of {name!r}: not a parameter, wanted one of {', '.join(names)}")
        k = names.index(name)
        p = parameters[k]
        return Held(
            name, p.unit, p.low, p.high, p.step, tuple(parameters), (k,),
            lambda theta: float(theta[k]), lambda v: (np.array([v]), np.zeros(1)),
            lambda theta: np.eye(len(names))[k],
        )  # fmt: skip

    @staticmethod
    def total(parameters: Sequence[Parameter], a: str, b: str) -> "Held":
        """The sum of two parameters."""
        i, j, p, q = _two(parameters, a, b)
        return Held(
            f"{a}+{b}", p.unit, p.low + q.low, p.high + q.high, max(p.step, q.step), tuple(parameters),
            (i, j), lambda theta: float(theta[i] + theta[j]),
            lambda v: (np.array([v, 0.0]), np.array([-1.0, 1.0])),
            lambda theta: np.eye(len(theta))[i] + np.eye(len(theta))[j],
        )  # fmt: skip

    @staticmethod
    def share(parameters: Sequence[Parameter], a: str, b: str, *, least: float) -> "Held":
        """The share b / (a + b) of two parameters, a above 0; least: the lowest that it may have where the
        bounds leave the sum no lowest value above 0."""
        i, j, p, q = _two(parameters, a, b)
        low = q.low / (p.high + q.low) if q.low >= 0 else least
        if q.low < 0 < p.low + q.low:
            low = max(q.low / (p.low + q.low), least)
        return Held(
            "share", "", low, q.high / (p.low + q.high), 0.1, tuple(parameters), (i, j),
            lambda theta: float(theta[j] / (theta[i] + theta[j])),
            lambda v: (np.zeros(2), np.array([1.0 - v, v])),
            lambda theta: (theta[i] * np.eye(len(theta))[j] - theta[j] * np.eye(len(theta))[i])
            / (theta[i] + theta[j]) ** 2,
        )  # fmt: skip

    def slice(self, value: float) -> Slice:
        """What is left to vary at a value."""
        low, high = bounds(self.parameters)
        own, along = self.line(value)
        others = np.setdiff1d(np.arange(len(low)), self.rows)
        point = np.zeros(len(low))
        point[list(self.rows)] = own
        directions = [np.eye(len(low))[k] for k in others]
        ends = [(low[k], high[k]) for k in others]
        if along.any():
            moving = along != 0
            to = np.array([low, high])[:, list(self.rows)][:, moving] - own[moving]
            to = np.sort(to / along[moving], axis=0)
            first, last = float(to[0].max()), float(to[1].min())
            way = np.zeros(len(low))
            way[list(self.rows)] = along
            if last - first > AT_BOUND * float(np.ptp(to)):
                directions.append(way)
                ends.append((first, last))
            else:  # in a corner of the bounds
                point += way * (first + last) / 2
        left = np.reshape(ends, (-1, 2)).T
        return Slice(point, np.reshape(directions, (-1, len(low))).T, left[0], left[1])


def _two(parameters: Sequence[Parameter], a: str, b: str) -> tuple[int, int, Parameter, Parameter]:
    first, second = (Held.parameter(parameters, name).rows[0] for name in (a, b))
    return first, second, parameters[first], parameters[second]


@dataclass(frozen=True, eq=False)
class ProfilePoint:
    """A value that was solved: its deviance, with all else, theta (d,), fitted anew."""

    value: float
    deviance: float
    theta: Array


@dataclass(frozen=True)
class End:
    """Where the deviance reaches a level. limit: "" where it does; else what ends the search at this value: a
    bound of the parameters, that nothing beyond can be solved, or that the search has not settled."""

    level: float
    value: float
    limit: Limit = ""


@dataclass(frozen=True, eq=False)
class Profile:
    """The profile of one value: the best, the points that were solved, by value, the ends of its intervals,
    (lower, upper) for each of LEVELS; evaluations: how many solves it took."""

    name: str
    unit: str
    best: float
    points: tuple[ProfilePoint, ...]
    ends: tuple[tuple[End, End], ...]
    evaluations: int

    @property
    def known(self) -> str:
        """Whether the data hold it on both sides, on one, or on none, at the last of LEVELS."""
        found = sum(not end.limit for end in self.ends[-1])
        return (NOT_IDENTIFIED, ONE_SIDED, IDENTIFIED)[found]

    @property
    def least(self) -> float:
        """The lowest deviance: below 0 where a better fit than the best was found."""
        return min(point.deviance for point in self.points)


def profile_likelihood(
    around: Around,
    *,
    held: Held,
    theta: ArrayLike,
    step: Callable[[], None] = lambda: None,
) -> Profile:
    """The profile of what is held, with both ends at each of LEVELS.

    around: theta (d,) -> residual and Jacobian as in `least_squares`, whitened by the errors of theta. theta
    (d,): the best fit, to which deviances are relative. step: called after each of the 2 x 2 ends. Raises
    ValueError where the model cannot be solved at theta.
    """
    start = inside(np.atleast_2d(np.asarray(theta, float)), held.parameters)[0]
    task = _Task(around, held, start)
    with np.errstate(under="ignore"):
        best = task.begin()
        sides = []
        for side in (-1, 1):
            known, ends = [best], []
            for level in LEVELS:
                ends.append(task.end(known, side, level))
                step()
            sides.append(ends)
    low, high = sides
    points = tuple(sorted(task.points, key=lambda point: point.value))
    return Profile(
        held.name, held.unit, best.value, points, tuple(zip(low, high, strict=True)), len(task.seen)
    )


class _Solves:
    """Residual and Jacobian, each theta once; seen: every theta of a profile."""

    def __init__(self, residual: Residual, jacobian: Jacobian, seen: set[bytes]) -> None:
        self._residual, self._jacobian, self._seen = residual, jacobian, seen
        self._r: dict[bytes, Array | None] = {}
        self._j: dict[bytes, Array] = {}

    def residual(self, theta: Array) -> Array | None:
        key = theta.tobytes()
        self._seen.add(key)
        if key not in self._r:
            r = self._residual(theta.copy())
            self._r[key] = None if r is None or not np.all(np.isfinite(r)) else r
        return self._r[key]

    def jacobian(self, theta: Array) -> Array:
        key = theta.tobytes()
        if key not in self._j:
            self._j[key] = self._jacobian(theta.copy())
        return self._j[key]


@dataclass(eq=False)
class _Task:
    """One profile: what it asks for, the theta that were solved, and the points that it has."""

    around: Around
    held: Held
    best: Array
    seen: set[bytes] = field(default_factory=set)
    points: list[ProfilePoint] = field(default_factory=list)
    _slope: Pair = field(init=False)  # residual and derivatives at the best fit

    def begin(self) -> ProfilePoint:
        """The best fit."""
        solves = self._solves(self.best)
        rows = _rows(solves, self.best)
        if rows is None:
            raise ValueError(f"profile of {self.held.name}: the model cannot be solved at the best fit")
        self._slope = rows
        return self._point(self.held.value(self.best), 0.0, self.best)

    def end(self, known: list[ProfilePoint], side: int, level: float) -> End:
        """Where the deviance reaches a level on one side. known: the points there, the best first, to which
        it adds."""
        held = self.held
        near = max((x for x in known if x.deviance < level), key=lambda x: side * x.value)
        outside = min((side * x.value for x in known if x.deviance >= level), default=math.nan) * side
        wall = False  # whether nothing can be solved outside
        bound = held.high if side > 0 else held.low
        reach = REACH * held.typical
        for _ in range(MOST):
            if abs(near.value - bound) <= AT_BOUND * (held.high - held.low):
                return End(level, bound, "bound")
            if wall and abs(outside - near.value) < CLOSE * held.typical:
                return End(level, near.value, "unsolvable")
            if wall:
                value = (near.value + outside) / 2
            else:
                far = side * min(side * (near.value + side * reach), side * bound)
                value = self._next(known, near.value, far, outside, level)
            at = self._solved(value, known)
            if at is None:
                outside, wall = value, True
                continue
            known.append(at)
            if abs(at.deviance - level) <= MISSED:
                return End(level, at.value)
            if at.deviance < level:
                near, reach = at, 2 * reach
            else:
                outside, wall = value, False
        return End(level, near.value, "search")

    def _next(
        self, known: Sequence[ProfilePoint], near: float, far: float, outside: float, level: float
    ) -> float:
        """The value at which the level is expected, between one before it and one beyond it."""
        beyond = far if math.isnan(outside) else outside
        value = self._by_slope(level, near, beyond) if len(known) == 1 else _by_roots(known, level, beyond)
        first, last = sorted((near, beyond))
        margin = 0.0 if math.isnan(outside) else MARGIN * (last - first)
        return float(np.clip(value, first + margin, last - margin))

    def _by_slope(self, level: float, near: float, far: float) -> float:
        """Where the derivatives at the best fit see the level."""

        def over(value: float) -> float:
            return self._foretold(self.held.slice(value))[0] - level

        return far if over(far) <= 0 else float(brentq(over, near, far, xtol=1e-9 * abs(far - near)))

    def _foretold(self, slice_: Slice) -> tuple[float, Array]:
        """The deviance of a slice, as the derivatives at the best fit say, and where (d,) it lies."""
        (r, jac), y = self._slope, slice_.nearest(self.best)
        left = r + jac @ (slice_.theta(y) - self.best)
        deviance = float(left @ left - r @ r)
        if not len(y):
            return deviance, slice_.theta(y)
        step = bounded_step(jac @ slice_.directions, left, slice_.low - y, slice_.high - y, DAMPING[1])
        return deviance - step.gain, slice_.theta(y + step.move)

    def _solved(self, value: float, known: Sequence[ProfilePoint]) -> ProfilePoint | None:
        """The others fitted at a value, under its own errors; None where nothing can be solved."""
        slice_ = self.held.slice(value)
        foretold = self._clipped(self._foretold(slice_)[1])
        solves = self._solves(foretold)  # and not where the fit ends: the deviance would not be smooth
        y = slice_.nearest(foretold if len(known) == 1 else _on_the_way(known, value))
        theta = self._clipped(slice_.theta(y))
        if len(y):
            names = (f"direction {k}" for k in range(len(y)))
            fit = least_squares(
                lambda y: solves.residual(self._clipped(slice_.theta(y))),
                lambda y: solves.jacobian(self._clipped(slice_.theta(y))) @ slice_.directions,
                [Parameter(*row) for row in zip(names, slice_.low, slice_.high, strict=True)],
                start=y, max_evaluations=EVALUATIONS, tolerance=TOLERANCE,
            )  # fmt: skip
            theta = self._clipped(slice_.theta(fit.theta))
        own, best = solves.residual(theta), _rows(solves, self.best)
        if own is None or best is None:
            return None
        low, high = bounds(self.held.parameters)
        free = bounded_step(best[1], best[0], low - self.best, high - self.best, DAMPING[1])
        return self._point(value, float(own @ own - best[0] @ best[0]) + free.gain, theta)

    def _point(self, value: float, deviance: float, theta: Array) -> ProfilePoint:
        self.points.append(ProfilePoint(value, deviance, theta))
        return self.points[-1]

    def _solves(self, theta: Array) -> _Solves:
        return _Solves(*self.around(theta), self.seen)

    def _clipped(self, theta: Array) -> Array:
        """Theta (d,) where rounding has left a bound."""
        return np.clip(theta, *bounds(self.held.parameters))


def _by_roots(known: Sequence[ProfilePoint], level: float, beyond: float) -> float:
    """Where the line through the roots of the two deviances nearest to a level meets it; `beyond` where they
    do not grow."""
    wanted = math.sqrt(level)
    roots = [(abs(root - wanted), root, x.value) for x in known for root in [math.sqrt(max(x.deviance, 0.0))]]
    (_, a, x), (_, b, y) = sorted(roots)[:2]
    if (b - a) * (y - x) * (beyond - known[0].value) <= 0:
        return beyond
    return x + (wanted - a) * (y - x) / (b - a)


def _on_the_way(known: Sequence[ProfilePoint], value: float) -> Array:
    """Where theta (d,) should be at a value: on the line through that of the two points nearest to it."""
    x, y = sorted(known, key=lambda point: abs(point.value - value))[:2]
    return x.theta + (value - x.value) / (y.value - x.value) * (y.theta - x.theta)


def _rows(solves: _Solves, theta: Array) -> Pair | None:
    """Residual (d + 1,) and derivatives (d + 1, d) at theta (d,), turned into few rows; None where there are
    none."""
    r = solves.residual(theta)
    if r is None or not np.all(np.isfinite(jac := solves.jacobian(theta))):
        return None
    small: Array = np.linalg.qr(np.column_stack([jac, r])).R
    return small[:, -1], small[:, :-1]
