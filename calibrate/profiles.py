"""Likelihood profiles: how far a parameter, or a sum or a share of two, may go before the fit is worse than
chance allows.

The deviance of a value is the lowest chi2 with it held and all else fitted anew, less that of the best fit
(A. Raue et al. 2009, doi:10.1093/bioinformatics/btp358). An interval ends where it reaches a quantile of chi2
with one degree of freedom. A covariance knows the slope at the best fit alone; a profile knows bounds and
curved valleys too. Derivatives say where an end should lie; there the model is solved, all else is fitted,
and the derivatives there say where next (after D. J. Venzon & S. H. Moolgavkar 1988, doi:10.2307/2347496).
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
    then, a point (1 or 2,) and a direction (1 or 2,) from it, 0 for one alone.
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
        )  # fmt: skip

    @staticmethod
    def total(parameters: Sequence[Parameter], a: str, b: str) -> "Held":
        """The sum of two parameters."""
        i, j, p, q = _two(parameters, a, b)
        return Held(
            f"{a}+{b}", p.unit, p.low + q.low, p.high + q.high, max(p.step, q.step), tuple(parameters),
            (i, j), lambda theta: float(theta[i] + theta[j]),
            lambda v: (np.array([v, 0.0]), np.array([-1.0, 1.0])),
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
    """A value that was solved: its deviance, with all else, theta (d,), fitted anew. off: how far the
    derivatives that foretold this deviance were off, or those here promise to lower it still."""

    value: float
    deviance: float
    theta: Array
    off: float = 0.0


@dataclass(frozen=True)
class End:
    """Where the deviance reaches a level, and how far off derivatives were there. limit: "" where it does;
    else what ends the search at this value: a bound of the parameters, that nothing beyond can be solved, or
    that the search has not settled."""

    level: float
    value: float
    off: float
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
    def off(self) -> float:
        """The largest difference in deviance between derivatives and solve at the ends that were found."""
        return max((end.off for pair in self.ends for end in pair if not end.limit), default=0.0)

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
    residual: Residual,
    jacobian: Jacobian,
    *,
    held: Held,
    theta: ArrayLike,
    step: Callable[[], None] = lambda: None,
) -> Profile:
    """The profile of what is held, with both ends at each of LEVELS.

    residual, jacobian: as in `least_squares`. theta (d,): the best fit, to which deviances are relative.
    step: called after each of the 2 x 2 ends. Raises ValueError where the model cannot be solved at theta.
    """
    start = inside(np.atleast_2d(np.asarray(theta, float)), held.parameters)[0]
    task = _Task(_Solves(residual, jacobian), held)
    with np.errstate(under="ignore"):
        best = task.begin(start)
        sides = []
        for side in (-1, 1):
            at, ends = best, []
            for level in LEVELS:
                end, at = task.end(at, side, level, best)
                ends.append(end)
                step()
            sides.append(ends)
    low, high = sides
    points = tuple(sorted(task.points, key=lambda point: point.value))
    return Profile(
        held.name, held.unit, best.value, points, tuple(zip(low, high, strict=True)), task.solves.count
    )


class _Solves:
    """Residual and Jacobian, each theta once, counted."""

    def __init__(self, residual: Residual, jacobian: Jacobian) -> None:
        self._residual, self._jacobian = residual, jacobian
        self._r: dict[bytes, Array | None] = {}
        self._j: dict[bytes, Array] = {}

    @property
    def count(self) -> int:
        return len(self._r)

    def residual(self, theta: Array) -> Array | None:
        key = theta.tobytes()
        if key not in self._r:
            self._r[key] = self._residual(theta.copy())
        return self._r[key]

    def jacobian(self, theta: Array) -> Array:
        key = theta.tobytes()
        if key not in self._j:
            self._j[key] = self._jacobian(theta.copy())
        return self._j[key]


@dataclass(frozen=True, eq=False)
class _At:
    """A solved value: theta (d,), and residual (d + 1,) with derivatives (d + 1, d), turned into few rows."""

    value: float
    theta: Array
    r: Array
    jac: Array

    @property
    def chi2(self) -> float:
        return float(self.r @ self.r)

    def foretold(self, slice_: Slice) -> tuple[float, Array]:
        """The lowest chi2 on a slice, as the derivatives here say, and where (k,)."""
        y = slice_.nearest(self.theta)
        r = self.r + self.jac @ (slice_.theta(y) - self.theta)
        if not len(y):
            return float(r @ r), y
        move = bounded_step(self.jac @ slice_.directions, r, slice_.low - y, slice_.high - y, DAMPING[1])
        return float(r @ r) - move.gain, np.clip(y + move.move, slice_.low, slice_.high)


@dataclass(eq=False)
class _Task:
    """One profile: its solves, and the points that it has."""

    solves: _Solves
    held: Held
    points: list[ProfilePoint] = field(default_factory=list)

    def begin(self, theta: Array) -> _At:
        """The best fit."""
        at = self._known(self.held.value(theta), theta)
        if at is None:
            raise ValueError(f"profile of {self.held.name}: the model cannot be solved at the best fit")
        self.points.append(ProfilePoint(at.value, 0.0, theta))
        return at

    def end(self, near: _At, side: int, level: float, best: _At) -> tuple[End, _At]:
        """Where the deviance reaches a level on one side, and the last point before it. near: a point before
        it."""
        held, now, outside = self.held, near, math.nan
        blocked = wall = False  # whether nothing could be solved at the last value, and outside
        bound = held.high if side > 0 else held.low
        reach = REACH * held.typical
        for _ in range(MOST):
            if abs(near.value - bound) <= AT_BOUND * (held.high - held.low):
                return End(level, bound, 0.0, "bound"), near
            if wall and abs(outside - near.value) < CLOSE * held.typical:
                return End(level, near.value, 0.0, "unsolvable"), near
            far = side * min(side * (near.value + side * reach), side * bound)
            value = self._next(now, near.value, far, outside, best.chi2 + level, blocked=blocked)
            at, off = self._solved(value, now, best)
            if at is None:
                now, outside, blocked, wall = near, value, True, True
                continue
            deviance = at.chi2 - best.chi2
            if abs(deviance - level) <= MISSED:
                return End(level, at.value, off), at
            now, blocked = at, False
            if deviance < level:
                near, reach = at, 2 * reach
            else:
                outside, wall = value, False
        return End(level, near.value, 0.0, "search"), near

    def _next(
        self, now: _At, near: float, far: float, outside: float, target: float, *, blocked: bool
    ) -> float:
        """The value at which the derivatives see the level, between one before it and one beyond it."""
        if blocked:
            return (near + outside) / 2
        beyond = far if math.isnan(outside) else outside

        def over(value: float) -> float:
            return now.foretold(self.held.slice(value))[0] - target

        if over(near) >= 0:
            value = (near + beyond) / 2
        elif over(beyond) <= 0:
            value = beyond
        else:
            value = float(brentq(over, near, beyond, xtol=1e-9 * abs(beyond - near)))
        if math.isnan(outside):
            return value
        margin = MARGIN * abs(outside - near)
        return float(np.clip(value, min(near, outside) + margin, max(near, outside) - margin))

    def _solved(self, value: float, now: _At, best: _At) -> tuple[_At | None, float]:
        """The others fitted at a value, and how far off what was foretold of it was."""
        slice_ = self.held.slice(value)
        foretold, y = now.foretold(slice_)
        theta = self._clipped(slice_.theta(y))
        if len(y):
            names = (f"direction {k}" for k in range(len(y)))
            fit = least_squares(
                lambda y: self.solves.residual(self._clipped(slice_.theta(y))),
                lambda y: self.solves.jacobian(self._clipped(slice_.theta(y))) @ slice_.directions,
                [Parameter(*row) for row in zip(names, slice_.low, slice_.high, strict=True)],
                start=y, max_evaluations=EVALUATIONS, tolerance=TOLERANCE,
            )  # fmt: skip
            theta = self._clipped(slice_.theta(fit.theta))
        at = self._known(value, theta)
        if at is None:
            return None, math.nan
        off = max(abs(at.chi2 - foretold), at.chi2 - at.foretold(slice_)[0])
        self.points.append(ProfilePoint(value, at.chi2 - best.chi2, theta, off))
        return at, off

    def _clipped(self, theta: Array) -> Array:
        """Theta (d,) where rounding has left a bound."""
        return np.clip(theta, *bounds(self.held.parameters))

    def _known(self, value: float, theta: Array) -> _At | None:
        """A solve at theta (d,); None where there is none."""
        r = self.solves.residual(theta)
        if r is None or not np.all(np.isfinite(r)):
            return None
        jac = self.solves.jacobian(theta)
        if not np.all(np.isfinite(jac)):
            return None
        d = len(theta)
        small: Array = np.linalg.qr(np.column_stack([jac, r])).R
        return _At(value, theta, small[:, d], small[:, :d])
