"""A case and a pressure history -> displacements at the output times, by one call: `solve`.

Without creep the response is a function of pressure: one curve of equilibrium states serves every time. With
a Prony series the history is solved at a few times; between them u(t) = U(q(t)) + D(t), where U is the
history-free curve, q the creep-equivalent pressure of linear viscoelasticity, and D, small and slow, is
interpolated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_matrix

from fe.assembly import Kernel, Memory, State
from fe.case import Case, digest
from fe.curve import Curve, Differenced, Neighbours, sensitivities, trace
from fe.element import Array
from fe.locate import interpolation
from fe.material import relaxation
from fe.newton import Problem, equilibrium, moved
from fe.path import Path, equivalent, in_time, knots, levels


@dataclass(frozen=True)
class Variation:
    """A parameter's direction: the test on either side of the present one, `step` of the parameter apart."""

    plus: tuple[Case, Path]
    minus: tuple[Case, Path]
    step: float


@dataclass(frozen=True)
class History:
    """The solved times of a history material.

    time (k,) s; weights (s, k) carry values to the output times; pressure (k,) MPa, creep-equivalent, and
    its derivatives slopes (v, k); u (k, n, 3) mm; derivative of those parameters that have a history, each
    (k, n, 3) mm per unit, and p_derivative (k, e, m) MPa per unit of the pressure modes. `active` is False
    where every g is 0: then u equals the curve and only the derivatives matter. `drift` is the state minus
    the curve's, for a neighbouring solve to begin from.
    """

    time: Array
    weights: Array
    pressure: Array
    slopes: Array
    u: Array
    derivative: dict[int, Array]
    p_derivative: dict[int, Array]
    drift: tuple[State, ...]
    active: bool


@dataclass(frozen=True)
class Solution:
    """The response of a case to a path.

    `converged`, or else `reason` says why not and `reached` (MPa) how far; `iterations` counts
    factorisations. pressure (s,) MPa is the (creep-equivalent) pressure at the output times; slopes (v, s)
    its derivatives.
    """

    case: Case
    path: Path
    curve: Curve
    pressure: Array
    slopes: Array
    history: History | None
    iterations: int
    reason: str
    _operators: dict[bytes, csr_matrix] = field(default_factory=dict, repr=False, compare=False)

    @property
    def converged(self) -> bool:
        """Whether every output time was reached."""
        return self.reason == "converged"

    @property
    def reached(self) -> float:
        """The last pressure in MPa with an equilibrium."""
        return float(self.curve.pressure[-1]) if len(self.curve.pressure) else 0.0

    def ahead(self, change: Array) -> "Solution":
        """The solution to first order where the parameters of its variations change by `change` (v,): a start
        for the solve there."""
        if not len(self.curve.derivative) or not np.any(change):
            return self
        h = self.history
        if h is not None:
            drift = list(h.drift)
            slopes = [self.curve.slope(q) for q in h.pressure]
            for n in h.derivative:
                along = self.curve.derivative_at(n, h.pressure)
                for k, slope in enumerate(slopes):
                    carried = moved(State(along.u[k], along.p[k]), slope, h.slopes[n, k])
                    own = State(h.derivative[n][k], h.p_derivative[n][k], carried.rotation)
                    drift[k] = moved(drift[k], moved(own, carried, -1.0), change[n])
            h = replace(h, drift=tuple(drift))
        return replace(self, curve=self.curve.ahead(change), history=h)

    def _operator(self, points: Array) -> csr_matrix:
        key = np.ascontiguousarray(points).tobytes()
        if key not in self._operators:
            self._operators[key] = interpolation(self.case, points)
        return self._operators[key]

    def at(self, points: Array) -> Array:
        """Displacements (s, p, 3) mm at the output times of undeformed points (p, 3) mm."""
        operator, h = self._operator(points), self.history
        u = self.curve.values(operator, self.pressure)
        if h is None or not h.active:
            return u
        rest = _apply(operator, h.u) - self.curve.values(operator, h.pressure)
        return u + np.tensordot(h.weights, rest, 1)

    def per_pressure(self, points: Array) -> Array:
        """dU/dp (s, p, 3) mm per MPa at the output times, at fixed history."""
        return self.curve.values(self._operator(points), self.pressure, 1)

    def variations_at(self, points: Array) -> Array:
        """Derivatives (v, s, p, 3) of `at` to the parameters of the variations, mm per unit."""
        operator, h = self._operator(points), self.history
        du = self._along(operator, self.pressure, self.slopes)
        if h is None or not len(du):
            return du
        carrier = self._along(operator, h.pressure, h.slopes)
        for n, d in h.derivative.items():
            du[n] += np.tensordot(h.weights, _apply(operator, d) - carrier[n], 1)
        return du

    def _along(self, operator: csr_matrix, pressure: Array, slopes: Array) -> Array:
        return self.curve.derivatives(operator, pressure) + slopes[..., None, None] * self.curve.values(
            operator, pressure, 1
        )

    def fields(self, steps: Sequence[int]) -> Array:
        """Displacements (k, n, 3) mm of all nodes at the output times number `steps`."""
        u, h = np.stack([self.curve.state(q).u for q in self.pressure[list(steps)]]), self.history
        if h is None or not h.active:
            return u
        rest = h.u - np.stack([self.curve.state(q).u for q in h.pressure])
        return u + np.tensordot(h.weights[list(steps)], rest, 1)


def _apply(operator: csr_matrix, fields: Array) -> Array:
    return np.stack([operator @ f for f in fields])


def solve(
    case: Case,
    path: Path,
    *,
    start: Solution | None = None,
    variations: Sequence[Variation] = (),
    count: int = 12,
) -> Solution:
    """The displacements of `case` along `path`, and their derivatives along `variations`.

    start: a solution of a neighbouring case with the same mesh and path, to begin from. count: levels of
    pressure that carry the history-free curve (10 leave 2e-4 mm of the finger's 58); one output time needs no
    curve. Never raises for lack of
    convergence: see `Solution.converged`, `reason` and `reached`.
    """
    kernel = _kernel(_Key(case))
    problem = Problem.of(case, kernel)
    varied = [
        Differenced(Problem.of(v.plus[0], kernel), Problem.of(v.minus[0], kernel), v.step) for v in variations
    ]
    dense = _equivalent(problem, path, path.time)
    remember = any(len(q.constants.prony) for q in (problem, *(v.plus for v in varied)))
    top, only = max(float(dense.max()), 1e-9), float(np.interp(path.output[0], path.time, dense))
    if len(path.output) == 1 and only > 0 and not remember:
        top, count = only, 1
    curve = trace(problem, levels(top, count=count), varied=varied, near=start.curve if start else None)

    def result(history: History | None, iterations: int, reason: str) -> Solution:
        pressure = np.interp(path.output, path.time, dense)
        slopes = _slopes(varied, variations, path.output, dense=True)
        return Solution(case, path, curve, pressure, slopes, history, curve.iterations + iterations, reason)

    if curve.reason != "converged" or not remember:
        return result(None, 0, curve.reason)
    return result(*_follow(problem, path, curve, variations, varied, start.history if start else None))


def _equivalent(problem: Problem, path: Path, time: Array) -> Array:
    """Creep-equivalent pressure (k,) MPa at `time`; the first element's series serves as the carrier's."""
    p = np.interp(time, path.time, path.pressure)
    prony = problem.constants.prony[:, 0]
    return equivalent(time, p, prony) if prony[:, 0].any() else p


def _slopes(
    varied: Sequence[Differenced], variations: Sequence[Variation], time: Array, *, dense: bool
) -> Array:
    """Derivatives (v, k) of the creep-equivalent pressure at `time`, solved on the log's times where
    `dense`."""

    def one(problem: Problem, path: Path) -> Array:
        if not dense:
            return _equivalent(problem, path, time)
        return np.interp(time, path.time, _equivalent(problem, path, path.time))

    rows = [
        (one(d.plus, v.plus[1]) - one(d.minus, v.minus[1])) / (2 * d.step)
        for d, v in zip(varied, variations, strict=True)
    ]
    return np.array(rows).reshape(len(rows), len(time))


@dataclass(frozen=True)
class _Stresses:
    """Isochoric stress (e, q, 3, 3) MPa at the last time and the Prony terms' stresses (m, e, q, 3, 3)."""

    now: Array
    terms: Array

    def memory(self, problem: Problem, dt: float) -> Memory:
        prony = problem.constants.prony
        g, (decay, ramp) = prony[..., 0], relaxation(prony, dt)
        scale = 1 - g.sum(0) + (g * ramp).sum(0)
        carried = np.einsum("me,meqij->eqij", decay, self.terms)
        return Memory(scale, carried - (g * ramp).sum(0)[:, None, None, None] * self.now)

    def after(self, problem: Problem, dt: float, new: Array) -> "_Stresses":
        prony = problem.constants.prony
        decay, ramp = relaxation(prony, dt)
        weight = (prony[..., 0] * ramp)[..., None, None, None]
        return _Stresses(new, decay[..., None, None, None] * self.terms + weight * (new - self.now))


def _follow(
    problem: Problem,
    path: Path,
    curve: Curve,
    variations: Sequence[Variation],
    varied: Sequence[Differenced],
    near: History | None,
) -> tuple[History | None, int, str]:
    """The history at its solved times, the factorisations it took, and the reason where it stopped."""
    g = problem.constants.prony[..., 0]
    # without creep in the base, only the derivatives towards creep have a history of their own
    tracked = [n for n, v in enumerate(varied) if len(g) or len(v.plus.constants.prony)]
    time = knots(path)
    load = np.interp(time, path.time, path.pressure)
    pressure = _equivalent(problem, path, time)
    loads = [[np.interp(time, w.time, w.pressure) for w in (v.plus[1], v.minus[1])] for v in variations]
    if near is not None and (near.time.shape != time.shape or not np.array_equal(near.time, time)):
        near = None
    state, iterations, last = curve.state(pressure[0]), 0, None
    drift = [moved(state, state, -1.0)]
    first = [
        _first_change(curve, n, varied[n], pressure[0], (loads[n][0][0], loads[n][1][0])) for n in tracked
    ]
    u, du, dp = [state.u], [first], [[np.zeros_like(state.p)] * len(tracked)]
    stresses = _first(problem, state.u)
    pairs = {
        n: tuple(
            _first(q, state.u + sign * varied[n].step * change)
            for q, sign in ((varied[n].plus, 1), (varied[n].minus, -1))
        )
        for n, change in zip(tracked, first, strict=True)
    }
    for k in range(1, len(time)):
        dt, carrier = time[k] - time[k - 1], curve.state(pressure[k])
        guess = moved(carrier, drift[-1])
        if near is not None:  # as the neighbour goes on from the last time
            guess = moved(moved(guess, near.drift[k]), near.drift[k - 1], -1.0)
        memory = stresses.memory(problem, dt)
        found = equilibrium(problem, guess, load=load[k], memory=memory, last=last, exact=bool(tracked))
        iterations += found.iterations
        if found.state is None or found.step is None:
            return None, iterations, f"stopped at {time[k]:.4g} s, {load[k]:.4g} MPa: {found.reason}"
        state, last = found.state, found.step
        drift.append(moved(state, carrier, -1.0))
        u.append(state.u)
        neighbours = [
            Neighbours(
                v := varied[n],
                (loads[n][0][k], loads[n][1][k]),
                (pairs[n][0].memory(v.plus, dt), pairs[n][1].memory(v.minus, dt)),
            )
            for n in tracked
        ]
        now = _isochoric(problem, state.u)
        changes = sensitivities(last, state, neighbours, isochoric=now)
        for n, change in zip(tracked, changes, strict=True):
            v = varied[n]
            pairs[n] = tuple(
                s.after(q, dt, _isochoric(q, state.u + sign * v.step * change.u))
                for s, q, sign in zip(pairs[n], (v.plus, v.minus), (1, -1), strict=True)
            )
        du.append([change.u for change in changes])
        dp.append([change.p for change in changes])
        stresses = stresses.after(problem, dt, now)
    slopes = _slopes(varied, variations, time, dense=False)
    weights = in_time(path, time)
    derivative, p_derivative = (
        {n: np.array([row[i] for row in rows]) for i, n in enumerate(tracked)} for rows in (du, dp)
    )
    return (
        History(
            time, weights, pressure, slopes, np.array(u), derivative, p_derivative, tuple(drift),
            bool(g.any()),
        ),
        iterations,
        "converged",
    )


def _first_change(
    curve: Curve, n: int, varied: Differenced, pressure: float, load: tuple[float, float]
) -> Array:
    """The derivative (n, 3) of the first state, which was put on instantly, to parameter number n."""
    along = (load[0] - load[1]) / (2 * varied.step)
    return np.asarray(curve.derivative_at(n, pressure).u + along * curve.slope(pressure).u, float)


def _first(problem: Problem, u: Array) -> _Stresses:
    """The stresses of displacements u (n, 3) mm that were put on instantly."""
    now = _isochoric(problem, u)
    return _Stresses(now, problem.constants.prony[..., 0][..., None, None, None] * now)


def _isochoric(problem: Problem, u: Array) -> Array:
    return problem.kernel.isochoric(u, problem.constants, problem.geometry)


class _Key:
    """What two cases must share to use one kernel: mesh, supports and surfaces, not materials or loads."""

    def __init__(self, case: Case) -> None:
        self.case = case
        held = [(s.nodes, s.components, case.node_sets[s.nodes]) for s in case.supports]
        clamp = case.node_sets[case.clamp.nodes] if case.clamp else ()
        surface = case.surfaces[case.pressurised] if case.pressurised else ()
        parts = [case.element.name, case.nodes, case.connectivity, surface, clamp]
        self.digest = digest(*parts, *(x for h in held for x in h))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and other.digest == self.digest

    def __hash__(self) -> int:
        return hash(self.digest)


@lru_cache(maxsize=4)
def _kernel(key: _Key) -> Kernel:
    return Kernel(key.case)
