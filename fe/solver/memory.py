"""States of a structure with memory at selected times of its path, and their derivatives.

History variables (`Past`): stresses of the Prony terms, the largest energy so far for Mullins softening, and
the slip on an obstacle with friction. Slip takes smaller steps where the predictor is off (`curve.strays`).
Every parameter carries the history variables of its two neighbouring problems, so that derivatives advance in
time as the states do.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fe.element import Array, Flags, Integers
from fe.kernel.assembly import Memory, Response, State
from fe.path import Path, equivalent, in_time, knots
from fe.solver.curve import LEAST_STEP, Curve, strays
from fe.solver.historyvariables import Evaluated, Past
from fe.solver.loadings import Loadings
from fe.solver.newton import Equilibrium, Problem, eased, moved
from fe.solver.refinement import Corrected
from fe.solver.sensitivity import Differenced, Neighbours, differing, sensitivities


@dataclass(frozen=True, kw_only=True)
class History:
    """The solved times of a history.

    time (k,) s, and the number (k,) of each time's curve; weights (s, k) from solved to output times;
    pressure (k,) MPa, creep-equivalent, and its derivatives slopes (v, k); u (k, n, 3) mm; derivative: by
    parameter number, (k, n, 3) mm per unit, and p_derivative (k, e, m) MPa per unit for the pressure modes.
    `active` is False without any memory: then u equals the curve and only the derivatives matter. `drift` is
    the state minus the curve's, a predictor for a neighbouring solve. touch (k, 3): force in N of an
    obstacle, touch_derivative its derivatives.
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
    touch: Array
    touch_derivative: dict[int, Array]
    active: bool


@dataclass(frozen=True)
class Course:
    """A problem's loading at the solved times: load (k,) MPa, the factor (k,) of all moduli, and the pressure
    (k,) MPa at which the history-free curve comes nearest."""

    load: Array
    stiffness: Array
    pressure: Array

    @staticmethod
    def of(problem: Problem, path: Path, time: Array) -> "Course":
        """Loading of a problem by a path, at times (k,) s."""
        load, stiffness, prony = path.pressure_at(time), path.stiffness_at(time), series(problem)
        plain = load / stiffness
        felt = equivalent(time, plain, prony, settled=path.settled) if prony[:, 0].any() else plain
        return Course(load, stiffness, felt)

    def halved(self, k: int) -> "Course":
        """The course with one more time, half way from number k - 1 to number k."""
        return Course(*(_halved(x, k) for x in (self.load, self.stiffness, self.pressure)))


def _halved(values: Array, k: int) -> Array:
    return np.insert(values, k, (values[k - 1] + values[k]) / 2)


def series(problem: Problem) -> Array:
    """Prony pairs (m, 2) that approximate the creep of the whole structure: the series of all materials,
    weighted by volume over modulus, as softer ones deform more."""
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

    def halved(self, k: int) -> "Direction":
        """The direction with one more time, half way from number k - 1 to number k."""
        return replace(self, courses=(self.courses[0].halved(k), self.courses[1].halved(k)))

    def on(self, pasts: tuple[Past, Past]) -> "Direction":
        """The direction with the neighbours' slip so far."""
        plus, minus = pasts[0].on(self.varied.plus), pasts[1].on(self.varied.minus)
        return replace(self, varied=replace(self.varied, plus=plus, minus=minus))

    @property
    def slopes(self) -> Array:
        """Derivative (k,) of the curve's pressure, MPa per unit."""
        return (self.courses[0].pressure - self.courses[1].pressure) / (2 * self.varied.step)

    def neighbours(
        self,
        k: int,
        memory: tuple[Memory | None, Memory | None],
        answers: tuple[Response, Response] | None = None,
    ) -> Neighbours:
        """The two problems at time number k, with memories scaled by the moduli's drift; `answers`: their
        constitutive responses to the state with initial moduli, where known."""
        (a, b), v = self.courses, self.varied
        if answers is not None:
            answers = answers[0].times(a.stiffness[k]), answers[1].times(b.stiffness[k])
        plus, minus = v.plus.stiffened(a.stiffness[k]), v.minus.stiffened(b.stiffness[k])
        if memory[0] is not None and memory[1] is not None:
            memory = memory[0].times(a.stiffness[k]), memory[1].times(b.stiffness[k])
        return Neighbours(replace(v, plus=plus, minus=minus), (a.load[k], b.load[k]), memory, answers)


@dataclass(frozen=True)
class _Stored:
    """Results at one solved time that are stored: the state, its distance from the curve's, its derivatives
    by every parameter; force (3,) of an obstacle and their derivatives."""

    state: State
    drift: State
    changes: tuple[State, ...]
    touch: Array
    touches: tuple[Array, ...]


@dataclass(frozen=True)
class _Point(_Stored):
    """Results at one solved time with the history variables of base and neighbours, which the next time needs
    and which are too large to store."""

    past: Past
    pasts: tuple[tuple[Past, Past], ...]

    @property
    def stored(self) -> _Stored:
        """The results without history variables."""
        return _Stored(self.state, self.drift, self.changes, self.touch, self.touches)


@dataclass(frozen=True, kw_only=True)
class _March:
    """A problem during its march through the times `time` (k,) s of a course, with the tracked parameters;
    number (k,): loading and curve of each time."""

    loadings: Loadings
    curves: Sequence[Curve]
    time: Array
    number: Integers
    course: Course
    directions: dict[int, Direction]
    near: History | None
    pace: Mapping[str, bool]
    soft: bool  # whether anyone asks for energies

    def _problem(self, k: int) -> Problem:
        return self.loadings.problems[self.number[k]]

    def _tracked(self, k: int) -> dict[int, Direction]:
        """The tracked parameters under the gravity of time number k."""
        varied = self.loadings.varied[self.number[k]]
        return {n: replace(d, varied=varied[n]) for n, d in self.directions.items()}

    def first(self) -> tuple[_Point, Equilibrium | None]:
        """State after instantaneous loading by the first pressure."""
        state, result, problem, tracked = self._carrier(0), None, self._problem(0), self._tracked(0)
        changes = tuple(self._along(n, d, 0) for n, d in tracked.items())
        if self.course.stiffness[0] != 1 and not problem.proportional:
            result = self._equilibrium(0, problem, state, None, None)
            if result.state is not None:
                state, tangent = result.state, Corrected.of(result)
                beside = [d.neighbours(0, (None, None)) for d in tracked.values()]
                changes = tuple(sensitivities(tangent, state, beside))
                result = replace(result, step=tangent.step)
        response = self.response(problem, state.u)
        around = self._around(0, state, changes, self._answers(0, state, response))
        pasts = tuple((Past.first(plus), Past.first(minus)) for plus, minus in around)
        past = Past.first(Evaluated(problem, state.u, response))
        touch = self._touch(problem, state, changes, [d.varied for d in tracked.values()], None)
        return _Point(state, moved(state, self._carrier(0), -1.0), changes, *touch, past, pasts), result

    def _carrier(self, k: int) -> State:
        return self.curves[self.number[k]].state(self.course.pressure[k])

    def _along(self, n: int, direction: Direction, k: int) -> State:
        """The derivative of the curve's state at time number k to parameter number n."""
        q, curve = float(self.course.pressure[k]), self.curves[self.number[k]]
        return moved(curve.derivative_at(n, q), curve.slope(q), direction.slopes[k])

    def _answers(self, k: int, state: State, response: Response) -> "list[tuple[Response, Response] | None]":
        """Constitutive responses of both neighbours of every parameter to the state, `response` being the
        base's; None where a neighbour differs by more than material constants."""
        base, out = self._problem(k), []
        for d in self._tracked(k).values():
            v = d.varied
            alike = not base.has_friction and v.plus.placed_as(base) and v.minus.placed_as(base)
            pair = [
                response if not len(differing(q.constants, base.constants)) else self.response(q, state.u)
                for q in (v.plus, v.minus)
                if alike
            ]
            out.append((pair[0], pair[1]) if pair else None)
        return out

    def _around(
        self,
        k: int,
        state: State,
        changes: Sequence[State],
        answers: "Sequence[tuple[Response, Response] | None]",
    ) -> Iterator[tuple[Evaluated, Evaluated]]:
        """Neighbouring problems of every parameter at their own displacements; known responses to the state
        are extrapolated by the base's tangent."""
        base, tracked = self._problem(k), self._tracked(k)
        available = [x is not None for x in answers]
        along = base.kernel.changes(
            state.u, base.constants, base.geometry,
            [c.u for c, yes in zip(changes, available, strict=True) if yes], energy=self.soft,
        )  # fmt: skip
        slopes = iter(along)
        for d, change, pair in zip(tracked.values(), changes, answers, strict=True):
            v, step = d.varied, d.varied.step * change.u
            ahead, behind = state.u + step, state.u - step
            if pair is None:
                plus, minus = self.response(v.plus, ahead), self.response(v.minus, behind)
            else:
                slope = next(slopes)
                plus, minus = pair[0].moved(slope, v.step), pair[1].moved(slope, -v.step)
            yield Evaluated(v.plus, ahead, plus), Evaluated(v.minus, behind, minus)

    def response(self, problem: Problem, u: Array) -> Response:
        """Constitutive response to displacements u (n, 3) mm with initial moduli."""
        kernel, c, geometry = problem.kernel, problem.constants, problem.geometry
        return Response(
            kernel.isochoric(u, c, geometry), kernel.energies(u, c, geometry) if self.soft else None
        )

    def _equilibrium(
        self, k: int, problem: Problem, guess: State, memory: Memory | None, last: Equilibrium | None
    ) -> Equilibrium:
        factor = self.course.stiffness[k]
        return eased(
            problem.stiffened(factor),
            guess,
            load=self.course.load[k],
            memory=memory.times(factor) if memory else None,
            last=last.step if last else None,
            exact=bool(self.directions),
            quick=True,
        )

    def virgin(self, k: int, before: _Point) -> _Point | None:
        """Point at time number k if it lies on the curve: softening is the only memory, and no point is below
        its largest energy; else None."""
        problem, tracked = self._problem(k), self._tracked(k)
        problems = [problem, *(d.varied.plus for d in tracked.values())]
        if any(len(q.constants.prony) or q.has_friction for q in problems):
            return None
        if _drifts(problem, self.course.stiffness):
            return None
        state = self._carrier(k)
        response = self.response(problem, state.u)
        below = before.past.below(response)
        if below is None or below.any():
            return None
        changes = tuple(self._along(n, d, k) for n, d in tracked.items())
        answers = self._answers(k, state, response)
        return self._point(k, before, state, response, answers, changes, None)

    def divisible(self, k: int) -> bool:
        """True if the step to time number k may be halved: with friction, while the load changes by enough.
        """
        load = self.course.load
        return self._problem(k).has_friction and abs(load[k] - load[k - 1]) > LEAST_STEP * float(np.ptp(load))

    def found(self, k: int, before: _Point, last: Equilibrium | None) -> Equilibrium:
        """Equilibrium at time number k, after the point before; without a state if it is far from its
        predictor and the step may be halved."""
        problem = before.past.on(self._problem(k))
        guess = moved(self._carrier(k), before.drift)
        if self.near is not None:  # as the neighbour goes on from the last time
            guess = moved(moved(guess, self.near.drift[k]), self.near.drift[k - 1], -1.0)
        result = self._equilibrium(k, problem, guess, before.past.memory(problem, self._dt(k)), last)
        strayed = result.state is not None and self.divisible(k) and strays(problem, guess, result.state)
        return replace(result, state=None) if strayed else result

    def halved(self, k: int) -> "_March":
        """The march with one more time, half way from number k - 1 to number k."""
        directions = {n: d.halved(k) for n, d in self.directions.items()}
        number = np.insert(self.number, k, self.number[k])
        time, course = _halved(self.time, k), self.course.halved(k)
        return replace(self, time=time, number=number, course=course, directions=directions)

    def point(self, k: int, before: _Point, state: State, step: Corrected) -> _Point:
        """The point at time number k, from the equilibrium there and its tangent."""
        response, dt = self.response(self._problem(k), state.u), self._dt(k)
        below, answers = before.past.below(response), self._answers(k, state, response)
        around = [
            d.on((a, b)).neighbours(
                k, (a.memory(d.varied.plus, dt, below), b.memory(d.varied.minus, dt, below)), pair
            )
            for d, (a, b), pair in zip(self._tracked(k).values(), before.pasts, answers, strict=True)
        ]
        changes = tuple(sensitivities(step, state, around))
        return self._point(k, before, state, response, answers, changes, step.slides)

    def _point(
        self,
        k: int,
        before: _Point,
        state: State,
        response: Response,
        answers: "Sequence[tuple[Response, Response] | None]",
        changes: tuple[State, ...],
        slides: Flags | None,
    ) -> _Point:
        dt, below = self._dt(k), before.past.below(response)
        around = self._around(k, state, changes, answers)
        pasts = tuple(
            (a.after(plus, dt, below, slides), b.after(minus, dt, below, slides))
            for (plus, minus), (a, b) in zip(around, before.pasts, strict=True)
        )
        past = before.past.after(Evaluated(self._problem(k), state.u, response), dt, below, None)
        varied = [d.on(two).varied for d, two in zip(self._tracked(k).values(), before.pasts, strict=True)]
        touch = self._touch(before.past.on(self._problem(k)), state, changes, varied, slides)
        return _Point(state, moved(state, self._carrier(k), -1.0), changes, *touch, past, pasts)

    @staticmethod
    def _touch(
        problem: Problem,
        state: State,
        changes: Sequence[State],
        varied: Sequence[Differenced],
        slides: Flags | None,
    ) -> tuple[Array, tuple[Array, ...]]:
        """Force (3,) of an obstacle at a state with the slip so far, and their derivatives."""
        derivatives = (v.touch(problem, state, d, slides) for v, d in zip(varied, changes, strict=True))
        return problem.touch(state.u), tuple(derivatives)

    def _dt(self, k: int) -> float:
        return float(self.time[k] - self.time[k - 1])

    def history(self, points: Sequence[_Stored], slopes: Array) -> History:
        """History of the stored results; slopes (v, k)."""
        u, p = (
            {
                n: np.stack([getattr(x.changes[i], name) for x in points])
                for i, n in enumerate(self.directions)
            }
            for name in ("u", "p")
        )
        c, problem = self._problem(0).constants, self._problem(0)
        weights = in_time(self.loadings.path, self.time, **self.pace)
        touches = {n: np.stack([x.touches[i] for x in points]) for i, n in enumerate(self.directions)}
        drifts = any(_drifts(q, self.course.stiffness) for q in self.loadings.problems)
        active = bool(drifts or problem.has_friction or c.prony[..., 0].any() or c.softening[:, 0].any())
        states, drift = np.stack([x.state.u for x in points]), tuple(x.drift for x in points)
        return History(
            time=self.time, number=self.number, weights=weights, pressure=self.course.pressure, slopes=slopes,
            u=states, derivative=u, p_derivative=p, drift=drift, touch=np.stack([x.touch for x in points]),
            touch_derivative=touches, active=active,
        )  # fmt: skip


def _drifts(problem: Problem, stiffness: Array) -> bool:
    """True if drifting moduli change the response by more than a change of pressure would."""
    return bool((stiffness != 1).any()) and not problem.proportional


def _pace(path: Path, every: Sequence[Problem]) -> dict[str, bool]:
    """Arguments of `fe.path.knots` for the history of these problems."""
    has_friction = any(q.has_friction for q in every)
    creeping = not has_friction or any(q.has_memory(path) for q in every)
    return {"softening": has_friction or any(len(q.constants.softening) for q in every), "creeping": creeping}


def follow(
    loadings: Loadings,
    curves: Sequence[Curve],
    paths: Sequence[tuple[Path, Path]],
    *,
    near: History | None,
    without: Collection[int] = (),
) -> tuple[History | None, int, str]:
    """History at its solved times, number of factorisations, and the reason where it stopped.

    curves: one for each loading; paths: paths of the parameters' neighbouring problems; near: the history of
    a neighbouring case; without: numbers of the parameters whose derivatives come from elsewhere.
    """
    path, problem = loadings.path, loadings.problems[0]
    every = loadings.everyone(without=without)
    soft, pace = any(len(q.constants.softening) for q in every), _pace(path, every)
    time = knots(path, **pace)
    if near is not None and (problem.has_friction or not np.array_equal(near.time, time)):
        near = None
    directions = [Direction.of(v, pair, time) for v, pair in zip(loadings.varied[0], paths, strict=True)]
    has_memory = any(q.has_memory(path) or q.has_friction for q in loadings.problems)
    # without a memory in the base, only the derivatives towards one have a history of their own
    tracked = {
        n: d
        for n, d in enumerate(directions)
        if n not in without
        and (has_memory or any(v[n].has_memory(*paths[n]) or v[n].has_friction for v in loadings.varied))
    }
    course, number = Course.of(problem, path, time), loadings.at(time)
    march = _March(
        loadings=loadings, curves=curves, time=time, number=number, course=course, directions=tracked,
        near=near, pace=pace, soft=soft,
    )  # fmt: skip
    point, last = march.first()
    points, iterations = [point.stored], last.iterations if last else 0
    going, requested = march, np.ones(len(time), bool)  # slip may need times in between
    while (k := len(points)) < len(requested):
        virgin = going.virgin(k, point)
        if virgin is not None:
            point = virgin
            points.append(point.stored)
            continue
        result = going.found(k, point, last)
        iterations += result.iterations
        if result.state is not None:
            tangent = Corrected.of(result)
            point = going.point(k, point, result.state, tangent)
            last = replace(result, step=tangent.step)
            points.append(point.stored)
        elif going.divisible(k):
            going, requested = going.halved(k), np.insert(requested, k, False)
        else:
            where = f"{going.time[k]:.4g} s, {going.course.load[k]:.4g} MPa"
            return None, iterations, f"stopped at {where}: {result.reason}"
    slopes = np.array([d.slopes for d in directions]).reshape(len(directions), len(time))
    points = [p for p, on_request in zip(points, requested, strict=True) if on_request]
    return march.history(points, slopes), iterations, "converged"
