"""States of a structure with memory at a few times of its path, and their derivatives.

What is remembered (`Past`): the stresses of the Prony terms, the largest energy so far, which Mullins
softening asks for, and the slip on a plane with friction. Between two times that are solved, slip takes
smaller steps where a guess is off (`curve.strays`). Every parameter carries two pasts of its own, those
of its neighbouring problems, so that derivatives go from time to time as the states do.
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

    time (k,) s, and which curve (k,) belongs to it; weights (s, k) carry values to the output times; pressure
    (k,) MPa, creep-equivalent, and its derivatives slopes (v, k); u (k, n, 3) mm; derivative of those
    parameters that have a history, each (k, n, 3) mm per unit, and p_derivative (k, e, m) MPa per unit of the
    pressure modes. `active` is False where nothing is remembered: then u equals the curve and only
    the derivatives matter. `drift` is the state minus the curve's, for a neighbouring solve to begin from.
    touch (k, 6) is the force in N and the moment in N mm of an obstacle, touch_derivative its derivatives.
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
    """What a path asks of a problem at the solved times: load (k,) MPa, the factor (k,) of all moduli, and
    the pressure (k,) MPa at which the history-free curve comes near."""

    load: Array
    stiffness: Array
    pressure: Array

    @staticmethod
    def of(problem: Problem, path: Path, time: Array) -> "Course":
        """At the times (k,) s."""
        load, stiffness, prony = path.pressure_at(time), path.stiffness_at(time), series(problem)
        plain = load / stiffness
        return Course(load, stiffness, equivalent(time, plain, prony) if prony[:, 0].any() else plain)

    def halved(self, k: int) -> "Course":
        """With one more time, half way from number k - 1 to number k."""
        return Course(*(_halved(x, k) for x in (self.load, self.stiffness, self.pressure)))


def _halved(values: Array, k: int) -> Array:
    return np.insert(values, k, (values[k - 1] + values[k]) / 2)


def series(problem: Problem) -> Array:
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

    def halved(self, k: int) -> "Direction":
        """With one more time, half way from number k - 1 to number k."""
        return replace(self, courses=(self.courses[0].halved(k), self.courses[1].halved(k)))

    def on(self, pasts: tuple[Past, Past]) -> "Direction":
        """With the slip of the neighbours so far."""
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
        """The two problems at time number k; answers of their laws to the state with the moduli as at the
        beginning, where they are known."""
        (a, b), v = self.courses, self.varied
        if answers is not None:
            answers = answers[0].times(a.stiffness[k]), answers[1].times(b.stiffness[k])
        plus, minus = v.plus.stiffened(a.stiffness[k]), v.minus.stiffened(b.stiffness[k])
        if memory[0] is not None and memory[1] is not None:
            memory = memory[0].times(a.stiffness[k]), memory[1].times(b.stiffness[k])
        return Neighbours(replace(v, plus=plus, minus=minus), (a.load[k], b.load[k]), memory, answers)


@dataclass(frozen=True)
class _Told:
    """What of a solved time stays: the state, its distance from the curve's, its derivatives to every
    parameter; the force and moment (6,) of an obstacle and their derivatives."""

    state: State
    drift: State
    changes: tuple[State, ...]
    touch: Array
    touches: tuple[Array, ...]


@dataclass(frozen=True)
class _Point(_Told):
    """One solved time, with its past and those of every parameter's neighbours, which the next one asks for
    and which are too large to be kept."""

    past: Past
    pasts: tuple[tuple[Past, Past], ...]

    @property
    def told(self) -> _Told:
        """The point without its pasts."""
        return _Told(self.state, self.drift, self.changes, self.touch, self.touches)


@dataclass(frozen=True, kw_only=True)
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
    pace: Mapping[str, bool]
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
            found = self._equilibrium(0, problem, state, None, None)
            if found.state is not None:
                state, tangent = found.state, Corrected.of(found)
                beside = [d.neighbours(0, (None, None)) for d in tracked.values()]
                changes = tuple(sensitivities(tangent, state, beside))
                found = replace(found, step=tangent.step)
        response = self.response(problem, state.u)
        around = self._around(0, state, changes, self._answers(0, state, response))
        pasts = tuple((Past.first(plus), Past.first(minus)) for plus, minus in around)
        past = Past.first(Evaluated(problem, state.u, response))
        touch = self._touch(problem, state, changes, [d.varied for d in tracked.values()], None)
        return _Point(state, moved(state, self._carrier(0), -1.0), changes, *touch, past, pasts), found

    def _carrier(self, k: int) -> State:
        return self.curves[self.number[k]].state(self.course.pressure[k])

    def _along(self, n: int, direction: Direction, k: int) -> State:
        """The derivative of the curve's state at time number k to parameter number n."""
        q, curve = float(self.course.pressure[k]), self.curves[self.number[k]]
        return moved(curve.derivative_at(n, q), curve.slope(q), direction.slopes[k])

    def _answers(self, k: int, state: State, response: Response) -> "list[tuple[Response, Response] | None]":
        """For every parameter the answers of its two neighbours' laws to the state, of which the problem's
        own is known; None where a neighbour differs by more than constants of materials."""
        base, out = self._problem(k), []
        for d in self._tracked(k).values():
            v = d.varied
            alike = not base.rubs and v.plus.placed_as(base) and v.minus.placed_as(base)
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
        """For every parameter its neighbouring problems at their own displacements; where their laws' answers
        to the state are known, they go on from there by the tangent of the problem's."""
        base, tracked = self._problem(k), self._tracked(k)
        known = [x is not None for x in answers]
        along = base.kernel.changes(
            state.u, base.constants, base.geometry,
            [c.u for c, yes in zip(changes, known, strict=True) if yes], energy=self.soft,
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
        """The law's answer to displacements u (n, 3) mm, the moduli as at the beginning."""
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
        """The point at time number k if it is the curve's: where only softening remembers, and nothing is
        below its largest energy."""
        problem, tracked = self._problem(k), self._tracked(k)
        problems = [problem, *(d.varied.plus for d in tracked.values())]
        if any(len(q.constants.prony) or q.rubs for q in problems) or _drifts(problem, self.course.stiffness):
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
        """Whether the step to time number k may be halved: with slip, while the load changes by enough."""
        load = self.course.load
        return self._problem(k).rubs and abs(load[k] - load[k - 1]) > LEAST_STEP * float(np.ptp(load))

    def found(self, k: int, before: _Point, last: Equilibrium | None) -> Equilibrium:
        """The equilibrium at time number k, after the point before; none if it is far from where it was
        expected and the step may be halved."""
        problem = before.past.on(self._problem(k))
        guess = moved(self._carrier(k), before.drift)
        if self.near is not None:  # as the neighbour goes on from the last time
            guess = moved(moved(guess, self.near.drift[k]), self.near.drift[k - 1], -1.0)
        found = self._equilibrium(k, problem, guess, before.past.memory(problem, self._dt(k)), last)
        strayed = found.state is not None and self.divisible(k) and strays(problem, guess, found.state)
        return replace(found, state=None) if strayed else found

    def halved(self, k: int) -> "_March":
        """With one more time, half way from number k - 1 to number k."""
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
        """Force and moment (6,) of an obstacle at a state with this slip so far, and their derivatives."""
        own = (v.touch(problem, state, d, slides) for v, d in zip(varied, changes, strict=True))
        return problem.touch(state.u), tuple(own)

    def _dt(self, k: int) -> float:
        return float(self.time[k] - self.time[k - 1])

    def history(self, points: Sequence[_Told], slopes: Array) -> History:
        """What is kept of the points."""
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
        active = bool(drifts or problem.rubs or c.prony[..., 0].any() or c.softening[:, 0].any())
        states, drift = np.stack([x.state.u for x in points]), tuple(x.drift for x in points)
        return History(
            time=self.time, number=self.number, weights=weights, pressure=self.course.pressure, slopes=slopes,
            u=states, derivative=u, p_derivative=p, drift=drift, touch=np.stack([x.touch for x in points]),
            touch_derivative=touches, active=active,
        )  # fmt: skip


def _drifts(problem: Problem, stiffness: Array) -> bool:
    """Whether a drift of the moduli does more than a change of pressure does."""
    return bool((stiffness != 1).any()) and not problem.proportional


def _pace(path: Path, every: Sequence[Problem]) -> dict[str, bool]:
    """How densely a history of these problems is to be solved: what `fe.path.knots` asks."""
    rubs = any(q.rubs for q in every)
    creeping = not rubs or any(q.remembers(path) for q in every)
    return {"softening": rubs or any(len(q.constants.softening) for q in every), "creeping": creeping}


def follow(
    loadings: Loadings,
    curves: Sequence[Curve],
    paths: Sequence[tuple[Path, Path]],
    *,
    near: History | None,
    without: Collection[int] = (),
) -> tuple[History | None, int, str]:
    """The history at its solved times, the factorisations it took, and the reason where it stopped.

    curves: one for each loading; paths: those of the parameters' neighbouring problems; near: the history of
    a neighbouring case; without: numbers of the parameters whose derivatives come from elsewhere.
    """
    path, problem = loadings.path, loadings.problems[0]
    every = loadings.everyone(without=without)
    soft, pace = any(len(q.constants.softening) for q in every), _pace(path, every)
    time = knots(path, **pace)
    if near is not None and (problem.rubs or not np.array_equal(near.time, time)):
        near = None
    directions = [Direction.of(v, pair, time) for v, pair in zip(loadings.varied[0], paths, strict=True)]
    own = any(q.remembers(path) or q.rubs for q in loadings.problems)
    # without a memory in the base, only the derivatives towards one have a history of their own
    tracked = {
        n: d
        for n, d in enumerate(directions)
        if n not in without and (own or any(v[n].remembers(*paths[n]) or v[n].rubs for v in loadings.varied))
    }
    course, number = Course.of(problem, path, time), loadings.at(time)
    march = _March(
        loadings=loadings, curves=curves, time=time, number=number, course=course, directions=tracked,
        near=near, pace=pace, soft=soft,
    )  # fmt: skip
    point, last = march.first()
    points, iterations = [point.told], last.iterations if last else 0
    going, asked = march, np.ones(len(time), bool)  # slip may need times in between
    while (k := len(points)) < len(asked):
        virgin = going.virgin(k, point)
        if virgin is not None:
            point = virgin
            points.append(point.told)
            continue
        found = going.found(k, point, last)
        iterations += found.iterations
        if found.state is not None:
            tangent = Corrected.of(found)
            point = going.point(k, point, found.state, tangent)
            last = replace(found, step=tangent.step)
            points.append(point.told)
        elif going.divisible(k):
            going, asked = going.halved(k), np.insert(asked, k, False)
        else:
            where = f"{going.time[k]:.4g} s, {going.course.load[k]:.4g} MPa"
            return None, iterations, f"stopped at {where}: {found.reason}"
    slopes = np.array([d.slopes for d in directions]).reshape(len(directions), len(time))
    points = [p for p, kept in zip(points, asked, strict=True) if kept]
    return march.history(points, slopes), iterations, "converged"
