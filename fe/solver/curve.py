"""Equilibrium states over pressure of a structure without memory, with slopes and derivatives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy.sparse import csr_matrix

from fe.element import Array
from fe.kernel.assembly import State
from fe.solver.limits import causes_of_stop
from fe.solver.newton import Equilibrium, Problem, Residual, Step, eased, moved
from fe.solver.refinement import Corrected
from fe.solver.sensitivity import Differenced, Neighbours, sensitivities

BENT = 5e-3  # mm: more than that between a cubic and a state on it asks for more levels
FORETOLD = 16  # times BENT: a cubic that foretold the next level so well needs no level in its middle
STRAYED = 0.05  # mm: a guess of the next level that is off by more, with friction, asks for one in between
SHARE = 0.4  # of a step that failed: 13 factorisations to 0.03 MPa on the default mesh, where a half takes 16
LEAST_STEP = 1 / 64  # of the distance between two levels; below that the path is given up


@dataclass(frozen=True, kw_only=True)
class Curve:
    """States over pressure (k,) MPa: u (k, n, 3) mm, p (k, e, 4) MPa, rotation (k,) rad, and their slopes.

    derivative (v, k, n, 3): mm per unit of each parameter at fixed pressure, p_derivative (v, k, e, m) for
    the pressure modes. touch (k, 3): an obstacle's force in N (`Problem.touch`), touch_derivative (v, k, 3).
    Where the path stopped early, `reason` says why and `pressure[-1]` is the last pressure reached.
    """

    pressure: Array
    u: Array
    p: Array
    rotation: Array
    u_slope: Array
    p_slope: Array
    rotation_slope: Array
    derivative: Array
    p_derivative: Array
    touch: Array
    touch_derivative: Array
    iterations: int
    reason: str

    def state(self, q: float) -> State:
        """The interpolated state (cubic Hermite) at pressure q MPa."""
        return self._hermite(q, 0)

    def slope(self, q: float) -> State:
        """The slope of the interpolated state at pressure q MPa, per MPa."""
        return self._hermite(q, 1)

    def _hermite(self, q: float, order: int) -> State:
        k = int(np.clip(np.searchsorted(self.pressure, q) - 1, 0, len(self.pressure) - 2))
        # written out: to make a spline of scipy's for two levels took four fifths of the time of this
        weights = _weights(self.pressure[k], self.pressure[k + 1], q, order)
        u, p, r = (
            weights[0] * y[k] + weights[1] * s[k] + weights[2] * y[k + 1] + weights[3] * s[k + 1]
            for y, s in ((self.u, self.u_slope), (self.p, self.p_slope), (self.rotation, self.rotation_slope))
        )
        return State(u, p, float(r))

    def derivative_at(self, number: int, q: float | Array) -> State:
        """Derivative of the state by parameter `number`, without the clamp's rotation, at pressure q MPa, or
        at several (s,)."""
        return State(
            scipy.interpolate.CubicSpline(self.pressure, self.derivative[number], axis=0)(q),
            scipy.interpolate.CubicSpline(self.pressure, self.p_derivative[number], axis=0)(q),
        )

    @property
    def without_derivatives(self) -> "Curve":
        """The curve with no parameters."""
        return replace(
            self, derivative=self.derivative[:0], p_derivative=self.p_derivative[:0],
            touch_derivative=self.touch_derivative[:0],
        )  # fmt: skip

    def mapped(self, to_u: Callable[[Array], Array], to_p: Callable[[Array], Array]) -> "Curve":
        """The curve with displacements and pressure modes mapped, as onto a mesh that holds this one."""
        u, p = to_u(self.u), to_p(self.p)
        return replace(self, u=u, u_slope=to_u(self.u_slope), p=p, p_slope=to_p(self.p_slope))

    def ahead(self, change: Array) -> "Curve":
        """The curve extrapolated to first order in changes (v,) of its parameters."""
        u, p = (np.tensordot(change, x, 1) for x in (self.derivative, self.p_derivative))
        q = self.pressure
        u_slope, p_slope = (scipy.interpolate.CubicSpline(q, x, axis=0)(q, 1) for x in (u, p))
        touch = self.touch + np.tensordot(change, self.touch_derivative, 1)
        return replace(
            self, u=self.u + u, p=self.p + p, u_slope=self.u_slope + u_slope, p_slope=self.p_slope + p_slope,
            touch=touch,
        )  # fmt: skip

    def touch_at(self, q: Array) -> Array:
        """Force (s, 3) N of an obstacle at pressures q (s,) MPa: by monotone cubics, so that nothing pushes
        before contact (Fritsch & Carlson 1980, doi 10.1137/0717021)."""
        return _monotone(self.pressure, self.touch, q)

    def touch_derivatives(self, q: Array) -> Array:
        """Derivatives (1 + v, s, 3) of `touch_at` by the parameters, and by the pressure as the last."""
        derivatives = [_monotone(self.pressure, d, q) for d in self.touch_derivative]
        return np.array([*derivatives, _monotone(self.pressure, self.touch, q, 1)])

    def values(self, operator: csr_matrix, q: Array, order: int = 0) -> Array:
        """Displacement, or its slope with order 1, at pressures q (s,) and points given by `operator` (p, n):
        (s, p, 3)."""
        y, s = _apply(operator, self.u), _apply(operator, self.u_slope)
        return scipy.interpolate.CubicHermiteSpline(self.pressure, y, s, axis=0)(q, order)

    def derivatives(self, operator: csr_matrix, q: Array) -> Array:
        """Derivatives (v, s, p, 3) at pressures q (s,) and points given by `operator` (p, n)."""
        if not len(self.derivative):
            return np.empty((0, len(q), operator.shape[0], 3))
        y = np.stack([_apply(operator, d) for d in self.derivative])
        return np.asarray(scipy.interpolate.CubicSpline(self.pressure, y, axis=1)(q))


def _weights(a: float, b: float, q: float, order: int) -> tuple[float, float, float, float]:
    """Cubic Hermite weights at q of value and slope at a, then at b; order 1: weights of the derivative."""
    h, t = b - a, (q - a) / (b - a)
    if order == 0:
        return (1 + 2 * t) * (1 - t) ** 2, h * t * (1 - t) ** 2, t**2 * (3 - 2 * t), h * t**2 * (t - 1)
    return 6 * t * (t - 1) / h, (1 - t) * (1 - 3 * t), 6 * t * (1 - t) / h, t * (3 * t - 2)


def _apply(operator: csr_matrix, fields: Array) -> Array:
    return np.stack([operator @ f for f in fields])


def _monotone(x: Array, y: Array, q: Array, order: int = 0) -> Array:
    """Values (s, ...), or slopes, of monotone cubics through y (k, ...) at x (k,)."""
    if len(x) == 1:
        return np.repeat(y, len(q), axis=0) if order == 0 else np.zeros((len(q), *y.shape[1:]))
    return np.asarray(scipy.interpolate.PchipInterpolator(x, y, axis=0)(q, nu=order))


def _per_pressure(problem: Problem, state: State) -> Residual:
    """The residuals' derivative to the follower pressure, per MPa."""
    kernel = problem.kernel
    force = -kernel.pressure.force(kernel.geometry.nodes + state.u)
    if problem.growing is not None:
        force -= problem.growing
    return Residual(force, np.zeros_like(state.p), problem.clamp_gap(state.rotation, force))


@dataclass(frozen=True)
class _Level:
    pressure: float
    state: State
    slope: State
    derivatives: tuple[State, ...]
    varied: tuple[Differenced, ...]  # as they go on from here
    touch: Array
    touches: tuple[Array, ...]  # its derivatives
    checked: bool = False  # the cubic that ends here is known to be good
    foretold: float = np.inf  # mm: by how much the cubic of the levels before was off here


def trace(
    problem: Problem, pressures: Array, *, varied: Sequence[Differenced] = (), near: Curve | None = None
) -> Curve:
    """Curve of a problem through increasing `pressures` (k,) MPa, starting from rest or from a `near` curve.

    A step that does not converge is shortened, and the level in between stays in the curve. With friction
    every level continues from the slip of the one before, in the base or in neighbours alone. Never raises
    for lack of convergence: the curve then ends early with a reason.
    """
    todo = [float(q) for q in pressures]
    done: list[_Level] = []
    near = None if problem.has_friction else near  # with friction the levels must not depend on the start
    rest, iterations, reason = _loaded(problem, todo[0], near)
    if reason:
        return _curve(done, len(varied), iterations, reason)
    last: Step | None = None
    least = LEAST_STEP * float(pressures[-1] - pressures[0])
    while todo:
        guess = _guess(rest, done, todo[0], near)
        if done:
            start = done[-1].state
            guess = moved(start, problem.filtered(start, moved(guess, start, -1.0)))
        level, result = _level(problem, todo[0], guess, last, varied)
        iterations += result.iterations
        if level is None:
            here = done[-1].pressure if done else 0.0
            if not done or todo[0] - here < least:
                reason = f"stopped at {here:.4g} MPa of {pressures[-1]:.4g}: {_cause(done, last, result)}"
                break
            todo.insert(0, here + SHARE * (todo[0] - here))
            near = None  # another way, or nearer to its limit point than this one: a bad guide from here
            continue
        strayed = bool(done) and problem.has_friction and strays(problem, guess, level.state)
        if strayed and todo[0] - done[-1].pressure > least:
            todo.insert(0, (done[-1].pressure + todo[0]) / 2)
            continue
        todo.pop(0)
        last = result.step
        off = float(np.abs(level.state.u - guess.u).max()) if len(done) > 1 else np.inf
        done.append(replace(level, foretold=off))
        problem, varied = problem.after(level.state.u), level.varied
    if not problem.has_friction:
        done, more = _refined_at_contact(problem, done)
        iterations += more
    return _curve(done, len(varied), iterations, reason or "converged")


def strays(problem: Problem, guess: State, state: State) -> bool:
    """True if a state on the obstacle is farther than STRAYED from its guess."""
    touches = problem.plane is not None and problem.plane.touches(problem.case.nodes + state.u)
    return touches and bool(np.abs(state.u - guess.u).max() > STRAYED)


def nothing(reason: str) -> Curve:
    """Empty curve of a problem that cannot be started, with the reason."""
    return _curve([], 0, 0, reason)


def _level(
    problem: Problem, load: float, guess: State, last: Step | None, varied: Sequence[Differenced]
) -> tuple[_Level | None, Equilibrium]:
    """Level at `load` MPa, None without an equilibrium; and the result of the iterations."""
    result = eased(problem, guess, load=load, last=last, quick=True)
    if result.state is None:
        return None, result
    tangent = Corrected.of(result)
    # alone: solved together with the derivatives its last bits would depend on their number
    (slope,) = tangent.solve([_per_pressure(problem, result.state)])
    seen = [Neighbours(v, (load, load)) for v in varied if not v.history_only]
    none, changes = moved(result.state, result.state, -1.0), iter(sensitivities(tangent, result.state, seen))
    derivatives = tuple(none if v.history_only else next(changes) for v in varied)
    after = tuple(
        v.after(result.state, d, tangent.slides) for v, d in zip(varied, derivatives, strict=True)
    )
    touches = tuple(
        v.touch(problem, result.state, d, tangent.slides) for v, d in zip(varied, derivatives, strict=True)
    )
    level = _Level(load, result.state, slope, derivatives, after, problem.touch(result.state.u), touches)
    return level, replace(result, step=tangent.step)


def _refined_at_contact(problem: Problem, done: list[_Level]) -> tuple[list[_Level], int]:
    """Levels with additional ones where contact bends the curve more than a cubic follows, and the number of
    factorisations."""
    out, todo, count = done[:1], done[:0:-1], 0
    least = LEAST_STEP * (done[-1].pressure - done[0].pressure) if done else 0.0
    while todo:
        a, b = out[-1], todo[-1]
        # a cubic is off by 1/64 of what it foretells as far ahead as it is long
        foretold = problem.plane is None and b.foretold < FORETOLD * BENT
        touches, middle = problem.in_contact(b.state.u) and not foretold, None
        if touches and b.pressure - a.pressure > least and not b.checked:
            guess = _ahead([a, b], (a.pressure + b.pressure) / 2)
            middle, result = _level(problem, (a.pressure + b.pressure) / 2, guess, None, a.varied)
            count += result.iterations
        if middle is None:
            out.append(todo.pop())
            continue
        near = bool(np.abs(middle.state.u - guess.u).max() < BENT)
        todo[-1] = replace(b, checked=near)
        todo.append(replace(middle, checked=near))
    return out, count


def _cause(done: list[_Level], last: Step | None, failure: Equilibrium) -> str:
    """Reason why the curve ends at its last level: a limit of its state, else the failure of the iterations.
    """
    if not done or last is None:
        return failure.reason
    slope = np.array([np.abs(level.slope.u).max() for level in done])
    cause = causes_of_stop(last, done[-1].state.u, np.array([level.pressure for level in done]), slope)
    return cause or failure.reason


def _loaded(problem: Problem, pressure: float, near: Curve | None) -> tuple[State, int, str]:
    """Starting state near the first level, from a `near` curve or by applying dead forces and weight in
    steps; the number of factorisations; the reason of a failure, or ""."""
    state, iterations, on, step = problem.start(), 0, 0.0, 1.0
    if not problem.dead.any():
        return state, 0, ""
    if near is not None and len(near.pressure) and near.pressure[0] == pressure:
        result = eased(problem, near.state(pressure), load=pressure)
        if result.state is not None:
            return result.state, result.iterations, ""
        iterations += result.iterations
    while on < 1:
        part = replace(problem, dead=(on + step) * problem.dead)
        result = eased(part, state, load=(on + step) * pressure)
        iterations += result.iterations
        if result.state is None:
            step /= 2
            if step < LEAST_STEP:
                part_on = f"{100 * on:.0f} % of its weight and dead forces, without pressure"
                return state, iterations, f"stopped at {part_on}: {result.reason}"
            continue
        state, on = result.state, on + step
        step = min(2 * step, 1 - on)
    return state, iterations, ""


def _guess(rest: State, done: list[_Level], target: float, near: Curve | None) -> State:
    """Predictor of the next state: from rest, by extrapolation of the last levels, or from a neighbouring
    curve."""
    if not done:
        return rest
    if near is None or target > near.pressure.max(initial=0.0):
        return _ahead(done[-2:], target)
    # what the neighbour is off by at the last levels goes on as a straight line: its slopes are less sure
    x = [level.pressure for level in done[-2:]]
    gaps = [moved(level.state, near.state(level.pressure), -1.0) for level in done[-2:]]
    guess = moved(near.state(target), gaps[-1])
    if len(gaps) == 1:
        return guess
    return moved(guess, moved(gaps[1], gaps[0], -1.0), (target - x[1]) / (x[1] - x[0]))


def _ahead(done: list[_Level], target: float) -> State:
    """The state at `target` MPa along the slope of one level, or by the cubic through two."""
    last = done[-1]
    if len(done) == 1:
        return moved(last.state, last.slope, target - last.pressure)
    weights = _weights(done[0].pressure, last.pressure, target, 0)
    parts = done[0].state, done[0].slope, last.state, last.slope
    u, p, r = (
        sum(w * getattr(part, name) for w, part in zip(weights, parts, strict=True))
        for name in ("u", "p", "rotation")
    )
    return State(u, p, float(r))


def _curve(done: list[_Level], parameters: int, iterations: int, reason: str) -> Curve:
    def of(kind: str, name: str) -> Array:
        return np.array([getattr(getattr(level, kind), name) for level in done])

    derivative, p_derivative = (
        np.array([[getattr(level.derivatives[v], name) for level in done] for v in range(parameters)])
        for name in ("u", "p")
    )
    return Curve(
        pressure=np.array([level.pressure for level in done]),
        u=of("state", "u"), p=of("state", "p"), rotation=of("state", "rotation"),
        u_slope=of("slope", "u"), p_slope=of("slope", "p"), rotation_slope=of("slope", "rotation"),
        derivative=derivative, p_derivative=p_derivative, touch=np.array([x.touch for x in done]),
        touch_derivative=np.array([[x.touches[v] for x in done] for v in range(parameters)]),
        iterations=iterations, reason=reason,
    )  # fmt: skip
