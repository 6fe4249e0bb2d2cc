"""Profile likelihood of a parameter, or of a sum or a share of two: its deviance, and intervals from it.

The deviance of a value is the lowest chi2 with the value held and all other parameters refitted, minus the
chi2 of the best fit (A. Raue et al. 2009, doi:10.1093/bioinformatics/btp358). An interval ends where the
deviance reaches a quantile of chi2 with one degree of freedom. A covariance uses the slope at the best fit
alone; a profile includes bounds and curved valleys. The first guess of an end comes from the derivatives at
the best fit. Next guesses come from the root of the deviance, which grows by 1 per standard deviation.

Where the errors depend on the parameters, each value is tested under its own errors, linearised: they whiten
its chi2 and the chi2 of the best fit alike. Errors fixed at the best fit would make an interval too narrow
where they hide a parameter at the best fit but not beside it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from calibrate.fit import AT_BOUND, DAMPING, Jacobian, Residual, bounded_step, inside, least_squares
from calibrate.parameters import Array, Fit, Parameter, bounds

LEVELS = (1.0, 3.84)  # deviance at the ends of the 68 % and of the 95 % interval
MISSED = 0.02  # tolerance of the deviance at an end: 0.01 and 0.005 sd
TOLERANCE = 0.03  # sd, tolerance of a refit
EVALUATIONS = 25  # at most, of a refit
REACH = 2.5  # first step of a search in typical steps of the value; doubled every further time
MARGIN = 0.05  # of a bracket: distance of a new value from both ends
CLOSE = 0.1  # typical steps: accuracy of a limit of solvability
MOST = 30  # values of a search

Pair = tuple[Array, Array]
Refit = Callable[..., Fit]  # residual, jacobian, parameters, start=, max_evaluations=, tolerance= -> Fit
Guess = Callable[[Sequence["ProfilePoint"], float], Array]  # solved points and a value -> theta (d,)
Around = Callable[[Array], tuple[Residual, Jacobian]]
Limit = Literal["", "bound", "unsolvable", "search"]
IDENTIFIED, ONE_SIDED, NOT_IDENTIFIED = "identified", "one-sided", "not identified"


@dataclass(frozen=True, eq=False)
class Slice:
    """Affine subspace of a held value: theta = point (d,) + directions (d, k) y, low <= y (k,) <= high."""

    point: Array
    directions: Array
    low: Array
    high: Array

    def theta(self, y: Array) -> Array:
        """Parameters (d,) at y (k,)."""
        return np.asarray(self.point + self.directions @ y)

    def nearest(self, theta: Array) -> Array:
        """Projection y (k,) of theta (d,), clipped to its bounds."""
        size = (self.directions**2).sum(axis=0)
        return np.clip(self.directions.T @ (theta - self.point) / size, self.low, self.high)


@dataclass(frozen=True, eq=False)
class Held:
    """Quantity of a profile: a parameter, or the sum a + b or the share b / (a + b) of two.

    low, high: its range within the bounds of the parameters. typical: a noticeable change of it. rows:
    indices of its parameters. value: theta (d,) -> its value. line: value -> the line of its parameters, a
    point (1 or 2,) and a direction (1 or 2,), 0 for one alone. slope: theta (d,) -> its derivative (d,).

    >>> import numpy as np
    >>> both = [Parameter("C10", 0.0, 0.5, "MPa"), Parameter("C01", 0.0, 0.5, "MPa")]
    >>> share = Held.share(both, "C10", "C01", least=0.0)
    >>> share.value(np.array([0.2, 0.1])).__round__(3), share.low, share.high
    (0.333, 0.0, 1.0)
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
        """A single parameter. Raises ValueError for an unknown name."""
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
        """The share b / (a + b) of two parameters, a above 0.

        least: its lower end where the bounds allow sums down to 0.
        """
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
        """Subspace of the parameters at a value."""
        low, high = bounds(self.parameters)
        base, along = self.line(value)
        free = np.setdiff1d(np.arange(len(low)), self.rows)
        point = np.zeros(len(low))
        point[list(self.rows)] = base
        directions = [np.eye(len(low))[k] for k in free]
        ends = [(low[k], high[k]) for k in free]
        if along.any():
            moving = along != 0
            to = np.array([low, high])[:, list(self.rows)][:, moving] - base[moving]
            to = np.sort(to / along[moving], axis=0)
            start, stop = float(to[0].max()), float(to[1].min())
            direction = np.zeros(len(low))
            direction[list(self.rows)] = along
            if stop - start > AT_BOUND * float(np.ptp(to)):
                directions.append(direction)
                ends.append((start, stop))
            else:  # in a corner of the bounds
                point += direction * (start + stop) / 2
        y_low, y_high = np.reshape(ends, (-1, 2)).T
        return Slice(point, np.reshape(directions, (-1, len(low))).T, y_low, y_high)


def _two(parameters: Sequence[Parameter], a: str, b: str) -> tuple[int, int, Parameter, Parameter]:
    i, j = (Held.parameter(parameters, name).rows[0] for name in (a, b))
    return i, j, parameters[i], parameters[j]


@dataclass(frozen=True, eq=False)
class ProfilePoint:
    """Point of a profile: a value, its deviance, and the refitted theta (d,)."""

    value: float
    deviance: float
    theta: Array


@dataclass(frozen=True)
class End:
    """End of an interval: the value at which the deviance reaches a level.

    limit: "" where it does; otherwise the obstacle at this value: a bound of the parameters, an unsolvable
    model beyond it, or a search that has not settled.
    """

    level: float
    value: float
    limit: Limit = ""


@dataclass(frozen=True, eq=False)
class Profile:
    """Profile of a quantity: best value, solved points by value, and interval ends (lower, upper) per level.

    evaluations: number of solves.
    """

    name: str
    unit: str
    best: float
    points: tuple[ProfilePoint, ...]
    ends: tuple[tuple[End, End], ...]
    evaluations: int

    @property
    def known(self) -> str:
        """IDENTIFIED, ONE_SIDED or NOT_IDENTIFIED, by the number of ends at the last of LEVELS."""
        count = sum(not end.limit for end in self.ends[-1])
        return (NOT_IDENTIFIED, ONE_SIDED, IDENTIFIED)[count]

    @property
    def least(self) -> float:
        """Lowest deviance; below 0 where a refit was better than the best fit."""
        return min(point.deviance for point in self.points)


def profile_likelihood(
    around: Around,
    *,
    held: Held,
    theta: ArrayLike,
    refit: Refit = least_squares,
    guess: Guess | None = None,
    step: Callable[[], None] = lambda: None,
) -> Profile:
    """Profile likelihood of the quantity held, with both ends of the interval at each of LEVELS.

    around: theta (d,) -> residual and Jacobian as in `least_squares`, whitened by the errors of theta. theta
    (d,): the best fit, to which deviances are relative. refit: fits the other parameters at a value, called
    as `least_squares`. guess: start of a refit, from the solved points (the best first) and the value; by
    default `secant`. step: called after each of the 2 x 2 ends. Raises ValueError where the model cannot be
    solved at theta.

    The slope of a line through three points, each with an sd of 0.1; its sd is 0.1 / sqrt(sum x^2) = 0.0447:

    >>> import numpy as np
    >>> x, y = np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 2.0])
    >>> slope = Parameter("slope", 0.0, 2.0, typical=0.1)
    >>> around = lambda theta: (lambda t: (t[0] * x - y) / 0.1, lambda t: x[:, None] / 0.1)
    >>> profile = profile_likelihood(around, held=Held.parameter([slope], "slope"), theta=[1.0])
    >>> tuple(round(end.value, 3) for end in profile.ends[0])
    (0.955, 1.045)
    >>> profile.known
    'identified'
    """
    start = inside(np.atleast_2d(np.asarray(theta, float)), held.parameters)[0]
    task = _Task(around, held, start, refit, guess or secant)
    with np.errstate(under="ignore"):
        best = task.begin()
        sides = []
        for side in (-1, 1):
            points, ends = [best], []
            for level in LEVELS:
                ends.append(task.end(points, side, level))
                step()
            sides.append(ends)
    low, high = sides
    solved = tuple(sorted(task.points, key=lambda point: point.value))
    return Profile(
        held.name, held.unit, best.value, solved, tuple(zip(low, high, strict=True)), len(task.seen)
    )


class _Solves:
    """Residual and Jacobian, cached by theta; seen: all theta of a profile."""

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
    """Search for the ends of a profile: its settings, the theta solved (seen), and the points."""

    around: Around
    held: Held
    best: Array
    refit: Refit
    guess: Guess
    seen: set[bytes] = field(default_factory=set)
    points: list[ProfilePoint] = field(default_factory=list)
    _slope: Pair = field(init=False)  # residual and derivatives at the best fit

    def begin(self) -> ProfilePoint:
        """Point of the best fit."""
        solves = self._solves(self.best)
        rows = _rows(solves, self.best)
        if rows is None:
            raise ValueError(f"profile of {self.held.name}: the model cannot be solved at the best fit")
        self._slope = rows
        return self._point(self.held.value(self.best), 0.0, self.best)

    def end(self, points: list[ProfilePoint], side: int, level: float) -> End:
        """End of an interval on one side. points: of that side, the best fit first; new ones are appended."""
        held = self.held
        near = max((x for x in points if x.deviance < level), key=lambda x: side * x.value)
        outside = min((side * x.value for x in points if x.deviance >= level), default=math.nan) * side
        wall = False  # outside cannot be solved
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
                value = self._next(points, near.value, far, outside, level)
            point = self._solved(value, points)
            if point is None:
                outside, wall = value, True
                continue
            points.append(point)
            if abs(point.deviance - level) <= MISSED:
                return End(level, point.value)
            if point.deviance < level:
                near, reach = point, 2 * reach
            else:
                outside, wall = value, False
        return End(level, near.value, "search")

    def _next(
        self, points: Sequence[ProfilePoint], near: float, far: float, outside: float, level: float
    ) -> float:
        """Expected value of the level, between a value before it and one beyond it."""
        beyond = far if math.isnan(outside) else outside
        value = self._by_slope(level, near, beyond) if len(points) == 1 else _by_roots(points, level, beyond)
        low, high = sorted((near, beyond))
        margin = 0.0 if math.isnan(outside) else MARGIN * (high - low)
        return float(np.clip(value, low + margin, high - margin))

    def _by_slope(self, level: float, near: float, far: float) -> float:
        """Value at which the linearised deviance reaches the level."""

        def excess(value: float) -> float:
            return self._linear(self.held.slice(value))[0] - level

        if excess(far) <= 0:
            return far
        return float(scipy.optimize.brentq(excess, near, far, xtol=1e-9 * abs(far - near)))

    def _linear(self, slice_: Slice) -> tuple[float, Array]:
        """Deviance and best theta (d,) of a slice, linearised at the best fit."""
        (r, jac), y = self._slope, slice_.nearest(self.best)
        residual = r + jac @ (slice_.theta(y) - self.best)
        deviance = float(residual @ residual - r @ r)
        if not len(y):
            return deviance, slice_.theta(y)
        step = bounded_step(jac @ slice_.directions, residual, slice_.low - y, slice_.high - y, DAMPING[1])
        return deviance - step.gain, slice_.theta(y + step.move)

    def _solved(self, value: float, points: Sequence[ProfilePoint]) -> ProfilePoint | None:
        """Refit of the other parameters at a value, under its own errors; None without a solution."""
        slice_ = self.held.slice(value)
        linear = self._clipped(self._linear(slice_)[1])
        solves = self._solves(linear)  # errors at the refit itself would make the deviance rough
        y = slice_.nearest(linear if len(points) == 1 else self.guess(points, value))
        theta = self._clipped(slice_.theta(y))
        if len(y):
            names = (f"direction {k}" for k in range(len(y)))
            fit = self.refit(
                lambda y: solves.residual(self._clipped(slice_.theta(y))),
                lambda y: solves.jacobian(self._clipped(slice_.theta(y))) @ slice_.directions,
                [Parameter(*row) for row in zip(names, slice_.low, slice_.high, strict=True)],
                start=y, max_evaluations=EVALUATIONS, tolerance=TOLERANCE,
            )  # fmt: skip
            theta = self._clipped(slice_.theta(fit.theta))
        r, best = solves.residual(theta), _rows(solves, self.best)
        if r is None or best is None:
            return None
        low, high = bounds(self.held.parameters)
        free = bounded_step(best[1], best[0], low - self.best, high - self.best, DAMPING[1])
        return self._point(value, float(r @ r - best[0] @ best[0]) + free.gain, theta)

    def _point(self, value: float, deviance: float, theta: Array) -> ProfilePoint:
        self.points.append(ProfilePoint(value, deviance, theta))
        return self.points[-1]

    def _solves(self, theta: Array) -> _Solves:
        return _Solves(*self.around(theta), self.seen)

    def _clipped(self, theta: Array) -> Array:
        """Theta (d,) clipped to the bounds, which rounding may leave."""
        return np.clip(theta, *bounds(self.held.parameters))


def _by_roots(points: Sequence[ProfilePoint], level: float, beyond: float) -> float:
    """Secant step on the roots of the two deviances nearest to a level; `beyond` where they do not grow."""
    target = math.sqrt(level)
    roots = [(math.sqrt(max(point.deviance, 0.0)), point.value) for point in points]
    (_, a, x), (_, b, y) = sorted((abs(root - target), root, value) for root, value in roots)[:2]
    if (b - a) * (y - x) * (beyond - points[0].value) <= 0:
        return beyond
    return x + (target - a) * (y - x) / (b - a)


def secant(points: Sequence[ProfilePoint], value: float) -> Array:
    """Theta (d,) at a value on the line through the two nearest points of a profile."""
    x, y = sorted(points, key=lambda point: abs(point.value - value))[:2]
    return x.theta + (value - x.value) / (y.value - x.value) * (y.theta - x.theta)


def nearest(points: Sequence[ProfilePoint], value: float) -> Array:
    """Theta (d,) of the point of a profile nearest to a value."""
    return min(points, key=lambda point: abs(point.value - value)).theta


def _rows(solves: _Solves, theta: Array) -> Pair | None:
    """Residual (d + 1,) and Jacobian (d + 1, d) at theta (d,), reduced by QR; None without a solution."""
    r = solves.residual(theta)
    if r is None or not np.all(np.isfinite(jac := solves.jacobian(theta))):
        return None
    small: Array = np.linalg.qr(np.column_stack([jac, r])).R
    return small[:, -1], small[:, :-1]
