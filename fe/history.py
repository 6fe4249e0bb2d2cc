"""A material with a memory along a path -> its states at a few times, and their derivatives.

What is remembered (`Past`): the stresses of the Prony terms, and the largest energy so far, which Mullins
softening asks for. Every parameter carries two pasts of its own, those of its neighbouring problems, so that
derivatives go from time to time as the states do.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fe.assembly import Memory, Softening, State
from fe.curve import Curve, Differenced, Neighbours, Response, sensitivities
from fe.element import Array, Flags, Integers
from fe.loadings import Loadings
from fe.material import relaxation
from fe.newton import Equilibrium, Problem, Step, eased, moved
from fe.path import Path, equivalent, in_time, knots

# The largest energy so far is kept this much smaller. A held state, or one that comes back to its largest
# load, then lies clearly on the virgin side of the kink at W = W_max and not on either by rounding.
SHY = 1e-6


@dataclass(frozen=True)
class History:
    """The solved times of a history material.

    time (k,) s, and which curve (k,) belongs to it; weights (s, k) carry values to the output times; pressure
    (k,) MPa, creep-equivalent, and its derivatives slopes (v, k); u (k, n, 3) mm; derivative of those
    parameters that have a history, each (k, n, 3) mm per unit, and p_derivative (k, e, m) MPa per unit of the
    pressure modes. `active` is False where the material remembers nothing: then u equals the curve and only
    the derivatives matter. `drift` is the state minus the curve's, for a neighbouring solve to begin from.
    """

    time: Array
    number: Integers
    weights: Array
    pressure: Array
    slopes: Array
    u: Array
    derivative: dict[int, Array]
    p_derivative: dict[int, Array]
    drift: tuple[State, ...]
    active: bool


@dataclass(frozen=True)
class Past:
    """The law's stress (e, q, 3, 3) MPa at the last time, the Prony terms' (m, e, q, 3, 3), and the largest
    energy so far (e, q) N mm/mm3 where anyone asks for it."""

    now: Array
    terms: Array
    peak: Array | None

    @staticmethod
    def first(problem: Problem, response: Response) -> "Past":
        """The past of a state that was put on instantly, from rest."""
        terms = problem.constants.prony[..., 0][..., None, None, None] * response.stress
        return Past(response.stress, terms, None if response.energy is None else (1 - SHY) * response.energy)

    def below(self, response: Response) -> Flags | None:
        """Where (e, q) a state's energy is below the largest so far."""
        if self.peak is None or response.energy is None:
            return None
        return np.asarray(response.energy < self.peak)

    def memory(self, problem: Problem, dt: float, below: Flags | None = None) -> Memory:
        """What the next time step, dt s long, is to know; `below`: the side of the kink, where given."""
        c, prony = problem.constants, problem.constants.prony
        g, (decay, ramp) = prony[..., 0], relaxation(prony, dt)
        viscous = (g * ramp).sum(0)
        carried = np.einsum("me,meqij->eqij", decay, self.terms) - viscous[:, None, None, None] * self.now
        softening = None
        if self.peak is not None and len(c.softening):
            table = c.softening * np.stack([1 - g.sum(0), *np.ones((2, len(viscous)))], axis=1)
            softening = Softening(table, self.peak, below)
        return Memory(1 - g.sum(0) + viscous, carried, softening)

    def after(self, problem: Problem, dt: float, response: Response, below: Flags | None = None) -> "Past":
        """The past after one more time step."""
        prony = problem.constants.prony
        decay, ramp = relaxation(prony, dt)
        weight = (prony[..., 0] * ramp)[..., None, None, None]
        terms = decay[..., None, None, None] * self.terms + weight * (response.stress - self.now)
        peak = self.peak
        if peak is not None and response.energy is not None and below is not None:
            peak = np.where(below, peak, (1 - SHY) * response.energy)
        return Past(response.stress, terms, peak)


@dataclass(frozen=True)
class Course:
    """What a path asks of a problem at the solved times: load (k,) MPa, the factor (k,) of all moduli, and
    the pressure (k,) MPa at which the history-free curve comes near."""

    load: Array
    stiffness: Array
    pressure: Array

    @staticmethod
    def of(problem: Problem, path: Path, time: Array) -> "Course":
        """At the times (k,) s."""
        load, stiffness, prony = path.pressure_at(time), path.stiffness_at(time), _series(problem)
        plain = load / stiffness
        return Course(load, stiffness, equivalent(time, plain, prony) if prony[:, 0].any() else plain)


def _series(problem: Problem) -> Array:
    """The Prony pairs (m, 2) by which the structure as a whole comes near to its creep: those of all
    materials, each by its share of volume over modulus, as the softer ones move more."""
    c, weight = problem.constants, problem.geometry.weight
    if (c.prony == c.prony[:, :1]).all():
        return c.prony[:, 0]
    kinds, number = np.unique(c.prony, axis=1, return_inverse=True)
    share = np.bincount(number.reshape(-1), weights=weight.sum(axis=1) / c.shear)
    g, tau = kinds[..., 0] * (share / share.sum()), kinds[..., 1]
    return np.stack([g.ravel(), tau.ravel()], axis=1)[g.ravel() != 0]


@dataclass(frozen=True)
class Direction:
    """A parameter along a history: its neighbouring problems and their courses."""

    varied: Differenced
    courses: tuple[Course, Course]

    @staticmethod
    def of(varied: Differenced, paths: tuple[Path, Path], time: Array) -> "Direction":
        """At the times (k,) s."""
        plus, minus = (
            Course.of(q, path, time) for q, path in zip((varied.plus, varied.minus), paths, strict=True)
        )
        return Direction(varied, (plus, minus))

    @property
    def slopes(self) -> Array:
        """Derivative (k,) of the curve's pressure, MPa per unit."""
        return (self.courses[0].pressure - self.courses[1].pressure) / (2 * self.varied.step)

    def neighbours(self, k: int, memory: tuple[Memory | None, Memory | None]) -> Neighbours:
        """The two problems at time number k."""
        (a, b), v = self.courses, self.varied
        plus, minus = v.plus.stiffened(a.stiffness[k]), v.minus.stiffened(b.stiffness[k])
        if memory[0] is not None and memory[1] is not None:
            memory = memory[0].times(a.stiffness[k]), memory[1].times(b.stiffness[k])
        return Neighbours(replace(v, plus=plus, minus=minus), (a.load[k], b.load[k]), memory)


@dataclass(frozen=True)
class _Point:
    """One solved time: state, past, and for every parameter its derivative and the pasts of its
    neighbours."""

    state: State
    drift: State
    past: Past
    changes: tuple[State, ...]
    pasts: tuple[tuple[Past, Past], ...]


@dataclass(frozen=True)
class _March:
    """A problem on its way through the times `time` (k,) s of a course, with the tracked parameters; number
    (k,): which loading and which curve is each time's."""

    loadings: Loadings
    curves: Sequence[Curve]
    time: Array
    number: Integers
    course: Course
    directions: dict[int, Direction]
    near: History | None
    soft: bool  # whether anyone asks for energies

    def _problem(self, k: int) -> Problem:
        return self.loadings.problems[self.number[k]]

    def _tracked(self, k: int) -> dict[int, Direction]:
        """The tracked parameters under the gravity of time number k."""
        varied = self.loadings.varied[self.number[k]]
        return {n: replace(d, varied=varied[n]) for n, d in self.directions.items()}

    def first(self) -> tuple[_Point, Equilibrium | None]:
        """The state that the first pressure has put on instantly."""
        state, found, problem, tracked = self._carrier(0), None, self._problem(0), self._tracked(0)
        changes = tuple(self._along(n, d, 0) for n, d in tracked.items())
        if self.course.stiffness[0] != 1 and not problem.proportional:
            found = self._equilibrium(0, state, None, None)
            if found.state is not None and found.step is not None:
                state = found.state
                around = [d.neighbours(0, (None, None)) for d in tracked.values()]
                changes = tuple(sensitivities(found.step, state, around))
        pasts = tuple(
            (Past.first(v.plus, plus), Past.first(v.minus, minus))
            for v, plus, minus in self._around(0, state, changes)
        )
        past = Past.first(problem, self.response(problem, state.u))
        return _Point(state, moved(state, self._carrier(0), -1.0), past, changes, pasts), found

    def _carrier(self, k: int) -> State:
        return self.curves[self.number[k]].state(self.course.pressure[k])

    def _along(self, n: int, direction: Direction, k: int) -> State:
        """The derivative of the curve's state at time number k to parameter number n."""
        q, curve = float(self.course.pressure[k]), self.curves[self.number[k]]
        return moved(curve.derivative_at(n, q), curve.slope(q), direction.slopes[k])

    def _around(
        self, k: int, state: State, changes: Sequence[State]
    ) -> Iterator[tuple[Differenced, Response, Response]]:
        """For every parameter the law's answers in its neighbouring problems, at their own displacements."""
        for d, change in zip(self._tracked(k).values(), changes, strict=True):
            v, step = d.varied, d.varied.step * change.u
            yield v, self.response(v.plus, state.u + step), self.response(v.minus, state.u - step)

    def response(self, problem: Problem, u: Array) -> Response:
        """The law's answer to displacements u (n, 3) mm, the moduli as at the beginning."""
        kernel, c, geometry = problem.kernel, problem.constants, problem.geometry
        return Response(
            kernel.isochoric(u, c, geometry), kernel.energies(u, c, geometry) if self.soft else None
        )

    def _equilibrium(
        self, k: int, guess: State, memory: Memory | None, last: Equilibrium | None
    ) -> Equilibrium:
        factor = self.course.stiffness[k]
        return eased(
            self._problem(k).stiffened(factor),
            guess,
            load=self.course.load[k],
            memory=memory.times(factor) if memory else None,
            last=last.step if last else None,
            exact=bool(self.directions),
        )

    def virgin(self, k: int, before: _Point) -> _Point | None:
        """The point at time number k if it is the curve's: where only softening remembers, and nothing is
        below its largest energy."""
        problem, tracked = self._problem(k), self._tracked(k)
        problems = [problem, *(d.varied.plus for d in tracked.values())]
        if any(len(q.constants.prony) for q in problems) or _drifts(problem, self.course.stiffness):
            return None
        state = self._carrier(k)
        response = self.response(problem, state.u)
        below = before.past.below(response)
        if below is None or below.any():
            return None
        changes = tuple(self._along(n, d, k) for n, d in tracked.items())
        return self._point(k, before, state, response, changes)

    def found(self, k: int, before: _Point, last: Equilibrium | None) -> Equilibrium:
        """The equilibrium at time number k, after the point before."""
        guess = moved(self._carrier(k), before.drift)
        if self.near is not None:  # as the neighbour goes on from the last time
            guess = moved(moved(guess, self.near.drift[k]), self.near.drift[k - 1], -1.0)
        return self._equilibrium(k, guess, before.past.memory(self._problem(k), self._dt(k)), last)

    def point(self, k: int, before: _Point, state: State, step: Step) -> _Point:
        """The point at time number k, from the equilibrium there and its tangent."""
        response, dt = self.response(self._problem(k), state.u), self._dt(k)
        below = before.past.below(response)
        around = [
            d.neighbours(k, (a.memory(d.varied.plus, dt, below), b.memory(d.varied.minus, dt, below)))
            for d, (a, b) in zip(self._tracked(k).values(), before.pasts, strict=True)
        ]
        known = response.times(self.course.stiffness[k])
        changes = tuple(sensitivities(step, state, around, response=known))
        return self._point(k, before, state, response, changes)

    def _point(
        self, k: int, before: _Point, state: State, response: Response, changes: tuple[State, ...]
    ) -> _Point:
        dt, below = self._dt(k), before.past.below(response)
        pasts = tuple(
            (a.after(v.plus, dt, plus, below), b.after(v.minus, dt, minus, below))
            for (v, plus, minus), (a, b) in zip(self._around(k, state, changes), before.pasts, strict=True)
        )
        past = before.past.after(self._problem(k), dt, response, below)
        return _Point(state, moved(state, self._carrier(k), -1.0), past, changes, pasts)

    def _dt(self, k: int) -> float:
        return float(self.time[k] - self.time[k - 1])

    def history(self, points: Sequence[_Point], slopes: Array) -> History:
        """What is kept of the points."""
        u, p = (
            {
                n: np.stack([getattr(x.changes[i], name) for x in points])
                for i, n in enumerate(self.directions)
            }
            for name in ("u", "p")
        )
        c, weights = self._problem(0).constants, in_time(self.loadings.path, self.time, softening=self.soft)
        drifts = any(_drifts(q, self.course.stiffness) for q in self.loadings.problems)
        active = bool(drifts or c.prony[..., 0].any() or c.softening[:, 0].any())
        states, drift = np.stack([x.state.u for x in points]), tuple(x.drift for x in points)
        return History(
            self.time, self.number, weights, self.course.pressure, slopes, states, u, p, drift, active
        )


def _drifts(problem: Problem, stiffness: Array) -> bool:
    """Whether a drift of the moduli does more than a change of pressure does."""
    return bool((stiffness != 1).any()) and not problem.proportional


def remembers(problem: Problem, path: Path) -> bool:
    """Whether the response may be other than a function of pressure over the moduli."""
    c = problem.constants
    return bool(len(c.prony) or len(c.softening)) or (path.stiffness is not None and not problem.proportional)


def follow(
    loadings: Loadings,
    curves: Sequence[Curve],
    paths: Sequence[tuple[Path, Path]],
    *,
    near: History | None,
) -> tuple[History | None, int, str]:
    """The history at its solved times, the factorisations it took, and the reason where it stopped.

    curves: one for each loading; paths: those of the parameters' neighbouring problems; near: the history of
    a neighbouring case.
    """
    path, problem = loadings.path, loadings.problems[0]
    soft = any(len(q.constants.softening) for q in (problem, *(v.plus for v in loadings.varied[0])))
    time = knots(path, softening=soft)
    if near is not None and not np.array_equal(near.time, time):
        near = None
    directions = [Direction.of(v, pair, time) for v, pair in zip(loadings.varied[0], paths, strict=True)]
    own = any(remembers(q, path) for q in loadings.problems)
    # without a memory in the base, only the derivatives towards one have a history of their own
    tracked = {
        n: d
        for n, d in enumerate(directions)
        if own or any(remembers(around[n].plus, paths[n][0]) for around in loadings.varied)
    }
    course, number = Course.of(problem, path, time), loadings.at(time)
    march = _March(loadings, curves, time, number, course, tracked, near, soft)
    point, last = march.first()
    points, iterations = [point], last.iterations if last else 0
    for k in range(1, len(time)):
        virgin = march.virgin(k, points[-1])
        if virgin is not None:
            points.append(virgin)
            continue
        last = march.found(k, points[-1], last)
        iterations += last.iterations
        if last.state is None or last.step is None:
            load = march.course.load[k]
            return None, iterations, f"stopped at {time[k]:.4g} s, {load:.4g} MPa: {last.reason}"
        points.append(march.point(k, points[-1], last.state, last.step))
    slopes = np.array([d.slopes for d in directions]).reshape(len(directions), len(time))
    return march.history(points, slopes), iterations, "converged"
