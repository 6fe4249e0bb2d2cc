"""Displacements of a case along a pressure history, and their derivatives, by one call: `solve`.

Without a memory the response is a function of pressure and gravity: one curve of equilibrium states in each
direction of gravity serves every time. Else the history is solved at a few times; between them
u(t) = U(q(t)) + D(t), where U is the history-free curve, q the creep-equivalent pressure of linear
viscoelasticity over the moduli's drift, and D, small and slow, is interpolated. Gravity is put on at the
first time, at once. Friction on a plane is followed along the curve while the pressure rises, and as a
history where it falls, gravity turns, or a material has a memory.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.sparse import csr_matrix

from fe.case import Case, digest
from fe.element import Array, Integers
from fe.kernel.assembly import Kernel, State
from fe.mesh.mirror import middle_plane, symmetry_support
from fe.mesh.points import interpolation
from fe.path import LEVELS, Path, levels
from fe.solver.adjoint import NullTangents
from fe.solver.curve import Curve, nothing, trace
from fe.solver.limits import crossing
from fe.solver.loadings import Loadings
from fe.solver.memory import Course, Direction, History, follow
from fe.solver.newton import Problem, moved
from fe.solver.sensitivity import Differenced, Variation, refused, towards_memory


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The response of a case to a path.

    `converged`, or else `reason` says why not and `reached` (MPa) how far; `iterations` counts
    factorisations. curves: one for each direction of gravity; number (s,) of that which belongs to an output
    time. pressure (s,) MPa is the (creep-equivalent) pressure at the output times; slopes (v, s) its
    derivatives. towards: the parameters that lead to a memory which the case has not.
    """

    case: Case
    path: Path
    curves: tuple[Curve, ...]
    number: Integers
    pressure: Array
    slopes: Array
    history: History | None
    iterations: int
    reason: str
    towards: NullTangents | None = None
    _operators: dict[bytes, csr_matrix] = field(default_factory=dict, repr=False, compare=False)

    @property
    def converged(self) -> bool:
        """Whether every output time was reached."""
        return self.reason == "converged"

    @property
    def reached(self) -> float:
        """The last pressure in MPa with an equilibrium in every direction of gravity."""
        return min(float(c.pressure[-1]) if len(c.pressure) else 0.0 for c in self.curves)

    @cached_property
    def crossed(self) -> str:
        """A sentence where walls have passed through each other at the highest load, which nothing in the
        model hinders, or nothing."""
        for curve in self.curves:
            place = crossing(self.case, curve.u[-1]) if len(curve.u) else None
            if place is not None:
                return (
                    f"self-contact: at {curve.pressure[-1]:.4g} MPa walls pass through each other at "
                    "x {:.1f}, y {:.1f}, z {:.1f} mm".format(*place)
                )
        return ""

    @property
    def instant(self) -> "Solution | None":
        """The solution of the same case without the memory of its materials, without derivatives; None where
        the history is not that of materials alone, so that the curves do not tell."""
        case, drift = self.case, self.path.stiffness
        if (case.contact is not None and case.contact.friction) or (drift is not None and np.any(drift != 1)):
            return None
        plain, none = case.with_material(prony=(), mullins=None), np.empty((0, len(self.number)))
        pressure, curves = self.path.at_output(), tuple(c.without_derivatives for c in self.curves)
        return replace(
            self, case=plain, curves=curves, pressure=pressure, slopes=none, history=None, towards=None
        )

    def ahead(self, change: Array) -> "Solution":
        """The solution to first order where the parameters of its variations change by `change` (v,): a start
        for the solve there."""
        if not len(self.curves[0].derivative) or not np.any(change):
            return self
        h = self.history
        if h is not None:
            drift = list(h.drift)
            for c, curve in enumerate(self.curves):
                own = np.flatnonzero(h.number == c)
                for n in h.derivative if len(own) else ():
                    along = curve.derivative_at(n, h.pressure[own])
                    for k, u, p in zip(own, along.u, along.p, strict=True):
                        on_curve = moved(State(u, p), curve.slope(h.pressure[k]), h.slopes[n, k])
                        state = State(h.derivative[n][k], h.p_derivative[n][k], on_curve.rotation)
                        drift[k] = moved(drift[k], moved(state, on_curve, -1.0), change[n])
            h = replace(h, drift=tuple(drift))
        return replace(self, curves=tuple(c.ahead(change) for c in self.curves), history=h)

    def _operator(self, points: Array) -> csr_matrix:
        key = np.ascontiguousarray(points).tobytes()
        if key not in self._operators:
            self._operators[key] = interpolation(self.case, points)
        return self._operators[key]

    def at(self, points: Array) -> Array:
        """Displacements (s, p, 3) mm at the output times of undeformed points (p, 3) mm."""
        operator, h = self._operator(points), self.history
        u = self._on_curves(operator, self.number, self.pressure)
        if h is None or not h.active:
            return u
        rest = _apply(operator, h.u) - self._on_curves(operator, h.number, h.pressure)
        return u + np.tensordot(h.weights, rest, 1)

    def _on_curves(self, operator: csr_matrix, number: Integers, pressure: Array, order: int = 0) -> Array:
        """Displacements (k, p, 3) mm on the curves `number` (k,) at pressures (k,) MPa, or their slopes."""
        out = np.empty((len(pressure), operator.shape[0], 3))
        for k, curve in enumerate(self.curves):
            out[number == k] = curve.values(operator, pressure[number == k], order)
        return out

    def per_pressure(self, points: Array) -> Array:
        """dU/dp (s, p, 3) mm per MPa at the output times, at fixed history."""
        slope = self._on_curves(self._operator(points), self.number, self.pressure, 1)
        return slope / self.path.stiffness_at(self.path.output)[:, None, None]

    def variations_at(self, points: Array) -> Array:
        """Derivatives (v, s, p, 3) of `at` to the parameters of the variations, mm per unit."""
        operator, h = self._operator(points), self.history
        du = self._along(operator, self.number, self.pressure, self.slopes)
        if self.towards is not None:
            for n, rows in self.towards.at(operator).items():
                du[n] = rows
        if h is None or not len(du):
            return du
        carrier = self._along(operator, h.number, h.pressure, h.slopes)
        for n, d in h.derivative.items():
            du[n] += np.tensordot(h.weights, _apply(operator, d) - carrier[n], 1)
        return du

    def _along(self, operator: csr_matrix, number: Integers, pressure: Array, slopes: Array) -> Array:
        du = slopes[..., None, None] * self._on_curves(operator, number, pressure, 1)
        for k, curve in enumerate(self.curves):
            du[:, number == k] += curve.derivatives(operator, pressure[number == k])
        return du

    # -- what an obstacle does ------------------------------------------------------------------------------

    @property
    def contact_force(self) -> Array:
        """The force (s, 3) N of the obstacle on the structure at the output times, in a half model that on
        the whole."""
        return self._whole(self._touch())[:, :3]

    @property
    def contact_moment(self) -> Array:
        """The moment (s, 3) N mm of that force about the origin."""
        return self._whole(self._touch())[:, 3:]

    @property
    def contact_variations(self) -> Array:
        """Derivatives (v, s, 3) of `contact_force` to the parameters of the variations, N per unit."""
        out, h = self._touched(self.number, self.pressure, self.slopes), self.history
        if h is not None and len(out):
            carrier = self._touched(h.number, h.pressure, h.slopes)
            for n, d in h.touch_derivative.items():
                out[n] += h.weights @ (d - carrier[n])
        return np.array([self._whole(d)[:, :3] for d in out]).reshape(*out.shape[:2], 3)

    def _touch(self) -> Array:
        """Force and moment (s, 6) on what is solved."""
        out, h = self._touch_on(self.number, self.pressure), self.history
        if h is None or not h.active:
            return out
        return out + h.weights @ (h.touch - self._touch_on(h.number, h.pressure))

    def _touch_on(self, number: Integers, pressure: Array) -> Array:
        out = np.empty((len(pressure), 6))
        for k, curve in enumerate(self.curves):
            out[number == k] = curve.touch_at(pressure[number == k])
        return out

    def _touched(self, number: Integers, pressure: Array, slopes: Array) -> Array:
        """Derivatives (v, k, 6) on the curves `number` (k,) at pressures (k,) MPa with slopes (v, k)."""
        out = np.empty((*slopes.shape, 6))
        for k, curve in enumerate(self.curves):
            own = number == k
            *du, along = curve.touch_derivatives(pressure[own])
            out[:, own] = slopes[:, own, None] * along + np.reshape(du, (len(slopes), own.sum(), 6))
        return out

    def _whole(self, touch: Array) -> Array:
        """Force and moment (s, 6) with those of the other half, where one is solved."""
        if symmetry_support(self.case) is None:
            return touch
        force, moment = np.split(touch, 2, axis=1)
        image = force * [1.0, -1.0, 1.0]
        there = np.cross([0.0, 2 * middle_plane(self.case), 0.0], image)
        return np.concatenate([force + image, moment + moment * [-1.0, 1.0, -1.0] + there], axis=1)

    def fields(self, steps: Sequence[int]) -> Array:
        """Displacements (k, n, 3) mm of all nodes at the output times number `steps`."""
        rows, h = list(steps), self.history
        u = self._states(self.number[rows], self.pressure[rows])
        if h is None or not h.active:
            return u
        return u + np.tensordot(h.weights[rows], h.u - self._states(h.number, h.pressure), 1)

    def _states(self, number: Integers, pressure: Array) -> Array:
        return np.stack([self.curves[k].state(q).u for k, q in zip(number, pressure, strict=True)])


def _apply(operator: csr_matrix, fields: Array) -> Array:
    return np.stack([operator @ f for f in fields])


def solve(
    case: Case,
    path: Path,
    *,
    start: Solution | None = None,
    variations: Sequence[Variation] = (),
    count: int = LEVELS,
) -> Solution:
    """The displacements of `case` along `path`, and their derivatives along `variations`.

    start: a solution of a neighbouring case with the same mesh and path, to begin from. count: levels of
    pressure that carry the history-free curve; one output time needs no curve. Never raises for lack of
    convergence: see `Solution.converged`, `reason` and `reached`.
    """
    if case.contact is not None and not case.contact.friction >= 0:
        raise ValueError(
            f"friction {case.contact.friction}: wanted a coefficient of 0 or more, without unit; correct it"
        )
    if path.stiffness is not None and path.stiffness.min() <= 0:
        return _without_moduli(case, path, len(variations))
    refused(case, path, variations)
    task = _Task.of(case, path, variations)
    steps, loadings = task.levels(count)
    near = start.curves if start is not None and len(start.curves) == len(loadings.problems) else None
    curves = tuple(
        trace(q, steps, varied=around, near=near[k] if near else None)
        for k, (q, around) in enumerate(zip(loadings.problems, loadings.varied, strict=True))
    )
    reason = next((c.reason for c in curves if c.reason != "converged"), "converged")
    if reason != "converged" or not (task.follows or (task.slips and _touch(loadings, curves))):
        return task.solution(loadings, curves, None, 0, reason)
    near_history = start.history if start else None
    found = follow(loadings, curves, task.pairs, near=near_history, without=task.towards)
    return task.solution(loadings, curves, *found)


def _without_moduli(case: Case, path: Path, parameters: int) -> Solution:
    """The solution of a path along which the moduli drift to nothing."""
    least = 0.0 if path.stiffness is None else path.stiffness.min()
    reason = f"stopped: the moduli fall to {least:.3g} of what they were, wanted above 0; correct their drift"
    none = np.zeros(len(path.output))
    return Solution(
        case=case, path=path, curves=(nothing(reason),), number=none.astype(int), pressure=none,
        slopes=np.zeros((parameters, len(none))), history=None, iterations=0, reason=reason,
    )  # fmt: skip


@dataclass(frozen=True)
class _Task:
    """What is to be solved: problems and their neighbours under each gravity, the paths of the neighbours,
    what the path asks of the problem and of its neighbours at the log times."""

    case: Case
    path: Path
    loadings: Loadings
    pairs: list[tuple[Path, Path]]
    dense: Course
    directions: list[Direction]

    @staticmethod
    def of(case: Case, path: Path, variations: Sequence[Variation]) -> "_Task":
        kernel = _kernel(_Key(case))
        problem, pairs = Problem.of(case, kernel), [(v.plus[1], v.minus[1]) for v in variations]
        varied = [
            Differenced(Problem.of(v.plus[0], kernel), Problem.of(v.minus[0], kernel), v.step)
            for v in variations
        ]
        directions = [Direction.of(v, paths, path.time) for v, paths in zip(varied, pairs, strict=True)]
        dense, loadings = Course.of(problem, path, path.time), Loadings.of(problem, path, varied, pairs)
        return _Task(case, path, loadings, pairs, dense, directions)

    @cached_property
    def remembers(self) -> bool:
        """Whether the material of the case, or of a neighbour, may have a memory."""
        return bool(self.towards) or self.follows

    @cached_property
    def towards(self) -> frozenset[int]:
        """Numbers of the parameters that would give a case without memory its first creep or softening.

        Only their two neighbours remember. Such derivatives come from the curves (`fe.solver.adjoint`), so
        that no history is followed for them.
        """
        base, varied = self.loadings.problems, self.loadings.varied
        return frozenset(
            n
            for n, pair in enumerate(self.pairs)
            if all(towards_memory(q, self.path, v[n], pair) for q, v in zip(base, varied, strict=True))
        )

    @cached_property
    def follows(self) -> bool:
        """Whether a history must be followed: of the case, or of a neighbour whose derivative needs it."""
        return any(
            q.remembers(self.path)
            or any(
                v.remembers(*p)
                for n, (v, p) in enumerate(zip(around, self.pairs, strict=True))
                if n not in self.towards
            )
            for q, around in zip(self.loadings.problems, self.loadings.varied, strict=True)
        )

    @cached_property
    def rubs(self) -> bool:
        """Whether there is friction."""
        return any(q.rubs for q in self.loadings.everyone())

    @cached_property
    def slips(self) -> bool:
        """Whether slip, where a plane is touched, must be followed in time."""
        turns = len(self.loadings.problems) > 1
        return self.rubs and (self.remembers or turns or _falls(self.path, self.dense.pressure))

    def levels(self, count: int) -> tuple[Array, Loadings]:
        """The pressures (k,) MPa of the history-free curves, and the loadings that need one."""
        pressure, path, loadings = self.dense.pressure, self.path, self.loadings
        top, only = max(float(pressure.max()), 1e-9), float(np.interp(path.output[0], path.time, pressure))
        if len(path.output) == 1 and only > 0 and not (self.remembers or self.slips):
            top, loadings = only, loadings.only(int(loadings.at(path.output)[0]))
            count = count if self.rubs else 1
        steps, low = levels(top, count=count), float(pressure.min())
        # above that is a gauge's noise, which the first cubic carries
        return (np.append(low, steps) if low < -0.01 * top else steps), loadings

    def solution(
        self,
        loadings: Loadings,
        curves: tuple[Curve, ...],
        history: History | None,
        iterations: int,
        reason: str,
    ) -> Solution:
        """What was found, at the output times."""
        path, output, along = self.path, self.path.output, [d.slopes for d in self.directions]
        pressure, *slopes = (np.interp(output, path.time, x) for x in (self.dense.pressure, *along))
        towards = None
        if self.towards and reason == "converged":
            varied = {n: loadings.varied[0][n] for n in sorted(self.towards)}
            towards = NullTangents(loadings, curves, self.dense.pressure, varied)
        return Solution(
            case=self.case, path=path, curves=curves, number=loadings.at(output), pressure=pressure,
            slopes=np.reshape(slopes, (len(self.directions), len(output))), history=history,
            iterations=iterations + sum(c.iterations for c in curves), reason=reason,
            towards=towards,
        )  # fmt: skip


FALL = 0.02  # of the range: a fall of the pressure by less is a gauge's noise


def _falls(path: Path, pressure: Array) -> bool:
    """Whether the pressure (t,) MPa falls before the last output."""
    p = pressure[: int(np.searchsorted(path.time, path.output.max())) + 1]
    return bool((np.maximum.accumulate(p) - p).max() > FALL * np.ptp(pressure))


def _touch(loadings: Loadings, curves: tuple[Curve, ...]) -> bool:
    """Whether a problem or a neighbour is on its plane anywhere on its curve."""
    return any(
        q.plane is not None and q.plane.touches(q.case.nodes + u)
        for problem, varied, curve in zip(loadings.problems, loadings.varied, curves, strict=True)
        for q in (problem, *(q for v in varied for q in (v.plus, v.minus)))
        for u in curve.u
    )


class _Key:
    """What two cases must share to use one kernel: mesh, supports and surfaces, not materials or loads."""

    def __init__(self, case: Case) -> None:
        self.case = case
        surface = case.surfaces[case.pressurised] if case.pressurised else ()
        held = case.supported, case.clamped
        mesh = case.element.name, case.nodes, case.connectivity, case.precurvature
        tied = [case.surfaces[name] for tie in case.ties for name in (tie.slave, tie.master)]
        self.digest = digest(*mesh, surface, *held, case.ties, case.equations, *tied, case.pressure_shares)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and other.digest == self.digest

    def __hash__(self) -> int:
        return hash(self.digest)


@lru_cache(maxsize=4)
def _kernel(key: _Key) -> Kernel:
    return Kernel(key.case)
