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
from functools import cached_property, lru_cache, partial

import numpy as np
from scipy.sparse import csr_matrix

from fe.case import Case, CaseKey, digest
from fe.element import Array, Integers
from fe.kernel.assembly import Kernel, State
from fe.mesh.mirror import images, modes_of_images, symmetry_support
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
    """Response of a case to a path.

    `converged`, or else `reason` says why not and `reached` (MPa) how far; `iterations` counts
    factorisations. curves: one for each direction of gravity; number (s,): curve of each output time.
    pressure (s,) MPa: the (creep-equivalent) pressure at the output times; slopes (v, s) its derivatives.
    towards: parameters that would give the case a memory.
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
        """True if every output time was reached."""
        return self.reason == "converged"

    @property
    def reached(self) -> float:
        """The last pressure in MPa with an equilibrium in every direction of gravity."""
        return min(float(c.pressure[-1]) if len(c.pressure) else 0.0 for c in self.curves)

    @cached_property
    def crossed(self) -> str:
        """Sentence about walls that penetrate each other at the highest load, or ""."""
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
        """The solution without material memory and without derivatives; None where moduli drift or friction
        made the history, so that the curves do not give it."""
        case, drift = self.case, self.path.stiffness
        if (case.contact is not None and case.contact.friction) or (drift is not None and np.any(drift != 1)):
            return None
        plain, none = case.with_material(prony=(), mullins=None), np.empty((0, len(self.number)))
        pressure, curves = self.path.at_output(), tuple(c.without_derivatives for c in self.curves)
        return replace(
            self, case=plain, curves=curves, pressure=pressure, slopes=none, history=None, towards=None
        )

    def ahead(self, change: Array) -> "Solution":
        """The solution extrapolated to first order in changes (v,) of its parameters: a start for the solve
        there."""
        if not len(self.curves[0].derivative) or not np.any(change):
            return self
        h = self.history
        if h is not None:
            drift = list(h.drift)
            for c, curve in enumerate(self.curves):
                rows = np.flatnonzero(h.number == c)
                for n in h.derivative if len(rows) else ():
                    along = curve.derivative_at(n, h.pressure[rows])
                    for k, u, p in zip(rows, along.u, along.p, strict=True):
                        on_curve = moved(State(u, p), curve.slope(h.pressure[k]), h.slopes[n, k])
                        state = State(h.derivative[n][k], h.p_derivative[n][k], on_curve.rotation)
                        drift[k] = moved(drift[k], moved(state, on_curve, -1.0), change[n])
            h = replace(h, drift=tuple(drift))
        return replace(self, curves=tuple(c.ahead(change) for c in self.curves), history=h)

    def mirrored(self, whole: Case) -> "Solution":
        """The solution of a half model with its mirror image, without derivatives and history: a start for
        the `whole` case that `fe.mesh.mirror.mirrored` makes of it."""
        curves = tuple(c.without_derivatives.mapped(partial(images, self.case),
                       partial(modes_of_images, whole.element)) for c in self.curves)  # fmt: skip
        none = np.empty((0, len(self.number)))
        return replace(self, case=whole, curves=curves, slopes=none, history=None, towards=None)

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
        """Derivatives (v, s, p, 3) of `at` by the parameters of the variations, mm per unit."""
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
        """Force (s, 3) N of the obstacle on the structure at the output times; of a half model, on the whole
        structure."""
        return self._with_mirror_image(self._touch())

    @property
    def contact_variations(self) -> Array:
        """Derivatives (v, s, 3) of `contact_force` by the parameters of the variations, N per unit."""
        out, h = self._touched(self.number, self.pressure, self.slopes), self.history
        if h is not None and len(out):
            carrier = self._touched(h.number, h.pressure, h.slopes)
            for n, d in h.touch_derivative.items():
                out[n] += h.weights @ (d - carrier[n])
        return self._with_mirror_image(out)

    def _touch(self) -> Array:
        """Force (s, 3) N on the solved part."""
        out, h = self._touch_on(self.number, self.pressure), self.history
        if h is None or not h.active:
            return out
        return out + h.weights @ (h.touch - self._touch_on(h.number, h.pressure))

    def _touch_on(self, number: Integers, pressure: Array) -> Array:
        out = np.empty((len(pressure), 3))
        for k, curve in enumerate(self.curves):
            out[number == k] = curve.touch_at(pressure[number == k])
        return out

    def _touched(self, number: Integers, pressure: Array, slopes: Array) -> Array:
        """Derivatives (v, k, 3) on the curves `number` (k,) at pressures (k,) MPa with slopes (v, k)."""
        out = np.empty((*slopes.shape, 3))
        for k, curve in enumerate(self.curves):
            rows = number == k
            *du, along = curve.touch_derivatives(pressure[rows])
            out[:, rows] = slopes[:, rows, None] * along + np.reshape(du, (len(slopes), rows.sum(), 3))
        return out

    def _with_mirror_image(self, touch: Array) -> Array:
        """Forces (..., 3) on the whole structure: in a half model with their mirror image."""
        return touch if symmetry_support(self.case) is None else touch + touch * [1.0, -1.0, 1.0]

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
    """Displacements of `case` along `path`, and their derivatives along `variations`.

    start: a solution of a neighbouring case with its path, to begin from: on its mesh, or on the half that
    `mirrored` makes it of. count: levels of pressure on the history-free curve; a single output time needs no
    curve. Never raises for lack of convergence: see `Solution.converged`, `reason` and `reached`.

    A bar of 20 mm x 1 mm2 that 2 mN stretch: u = F L / (E A) with E = 6 C10, a little less beside the clamp.

    >>> from fe import Material
    >>> from fe.mesh.extruding import box_grid, extruded, hollow_case
    >>> quads = box_grid(np.array([0.0, 0.5]), np.array([0.0, 1.0]))  # the half y >= 0
    >>> cells = extruded(quads, np.linspace(0.0, 20.0, 6)).reshape(-1, 27, 3)
    >>> bar = hollow_case(cells, np.ones(5, bool), material=Material(C10=0.1), marks={})
    >>> pulled = replace(bar, forces={"tip_face": np.array([1e-3, 0.0, 0.0])})  # N, on the half
    >>> rest = Path(np.array([0.0, 1.0]), np.zeros(2), output=np.array([1.0]))
    >>> solution = solve(pulled, rest)
    >>> solution.converged, solution.at(np.array([[20.0, 0.0, 0.5]]))[0, 0, 0].round(3).item()
    (True, 0.066)
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
    if start is not None and len(start.case.nodes) < len(case.nodes):
        start = start.mirrored(case)
    near = start.curves if start is not None and len(start.curves) == len(loadings.problems) else None
    curves = tuple(
        trace(q, steps, varied=around, near=near[k] if near else None)
        for k, (q, around) in enumerate(zip(loadings.problems, loadings.varied, strict=True))
    )
    reason = next((c.reason for c in curves if c.reason != "converged"), "converged")
    if reason != "converged" or not (task.follows or (task.slips and _touch(loadings, curves))):
        return task.solution(loadings, curves, None, 0, reason)
    near_history = start.history if start else None
    history = follow(loadings, curves, task.pairs, near=near_history, without=task.towards)
    return task.solution(loadings, curves, *history)


def _without_moduli(case: Case, path: Path, parameters: int) -> Solution:
    """Failed solution of a path along which the moduli drift to zero."""
    least = 0.0 if path.stiffness is None else path.stiffness.min()
    reason = f"stopped: the moduli fall to {least:.3g} of what they were, wanted above 0; correct their drift"
    none = np.zeros(len(path.output))
    return Solution(
        case=case, path=path, curves=(nothing(reason),), number=none.astype(int), pressure=none,
        slopes=np.zeros((parameters, len(none))), history=None, iterations=0, reason=reason,
    )  # fmt: skip


@dataclass(frozen=True)
class _Task:
    """A problem to solve: problems and their neighbours under each gravity, the neighbours' paths, and their
    courses at the log times."""

    case: Case
    path: Path
    loadings: Loadings
    pairs: list[tuple[Path, Path]]
    dense: Course
    directions: list[Direction]

    @staticmethod
    def of(case: Case, path: Path, variations: Sequence[Variation]) -> "_Task":
        kernel = _kernel(_key(case))
        kernel.begin()
        problem, pairs = Problem.of(case, kernel), [(v.plus[1], v.minus[1]) for v in variations]
        varied = [
            Differenced(Problem.of(v.plus[0], kernel), Problem.of(v.minus[0], kernel), v.step)
            for v in variations
        ]
        directions = [Direction.of(v, paths, path.time) for v, paths in zip(varied, pairs, strict=True)]
        dense, loadings = Course.of(problem, path, path.time), Loadings.of(problem, path, varied, pairs)
        return _Task(case, path, loadings, pairs, dense, directions)

    @cached_property
    def has_memory(self) -> bool:
        """True if the material of the case, or of a neighbour, may have a memory."""
        return bool(self.towards) or self.follows

    @cached_property
    def towards(self) -> frozenset[int]:
        """Numbers of the parameters that would give a case without memory its first creep or softening.

        Only their two neighbours have a memory. Such derivatives come from the curves (`fe.solver.adjoint`),
        without a history.
        """
        base, varied = self.loadings.problems, self.loadings.varied
        return frozenset(
            n
            for n, pair in enumerate(self.pairs)
            if all(towards_memory(q, self.path, v[n], pair) for q, v in zip(base, varied, strict=True))
        )

    @cached_property
    def follows(self) -> bool:
        """True if a history must be solved: the case's own, or a neighbour's whose derivative needs it."""
        return any(
            q.has_memory(self.path)
            or any(
                v.has_memory(*p)
                for n, (v, p) in enumerate(zip(around, self.pairs, strict=True))
                if n not in self.towards
            )
            for q, around in zip(self.loadings.problems, self.loadings.varied, strict=True)
        )

    @cached_property
    def has_friction(self) -> bool:
        """True if there is friction."""
        return any(q.has_friction for q in self.loadings.everyone())

    @cached_property
    def slips(self) -> bool:
        """True if slip on an obstacle must be followed in time."""
        turns = len(self.loadings.problems) > 1
        return self.has_friction and (self.has_memory or turns or _falls(self.path, self.dense.pressure))

    def levels(self, count: int) -> tuple[Array, Loadings]:
        """The pressures (k,) MPa of the history-free curves, and the loadings that need one."""
        pressure, path, loadings = self.dense.pressure, self.path, self.loadings
        top, only = max(float(pressure.max()), 1e-9), float(np.interp(path.output[0], path.time, pressure))
        if len(path.output) == 1 and only > 0 and not (self.has_memory or self.slips):
            top, loadings = only, loadings.only(int(loadings.at(path.output)[0]))
            count = count if self.has_friction else 1
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
        """Solution at the output times."""
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
    """True if the pressure (t,) MPa falls before the last output."""
    p = pressure[: int(np.searchsorted(path.time, path.output.max())) + 1]
    return bool((np.maximum.accumulate(p) - p).max() > FALL * np.ptp(pressure))


def _touch(loadings: Loadings, curves: tuple[Curve, ...]) -> bool:
    """True if a problem or a neighbour touches its obstacle anywhere on its curve."""
    return any(
        q.plane is not None and q.plane.touches(q.case.nodes + u)
        for problem, varied, curve in zip(loadings.problems, loadings.varied, curves, strict=True)
        for q in (problem, *(q for v in varied for q in (v.plus, v.minus)))
        for u in curve.u
    )


def _key(case: Case) -> CaseKey:
    """Cache key of a kernel: mesh, supports and surfaces, not materials or loads."""
    surface = case.surfaces[case.pressurised] if case.pressurised else ()
    held = case.supported, case.clamped
    mesh = case.element.name, case.nodes, case.connectivity, case.precurvature
    tied = [case.surfaces[name] for tie in case.ties for name in (tie.slave, tie.master)]
    parts = *mesh, surface, *held, case.ties, case.equations, *tied, case.pressure_shares
    return CaseKey(case, digest(*parts))


@lru_cache(maxsize=4)
def _kernel(key: CaseKey) -> Kernel:
    return Kernel(key.case)
