"""A case and a pressure history -> displacements at the output times, by one call: `solve`.

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
from fe.mesh.points import interpolation
from fe.path import Path, levels
from fe.solver.curve import Curve, nothing, trace
from fe.solver.loadings import Loadings
from fe.solver.memory import Course, Direction, History, follow
from fe.solver.newton import Problem, moved
from fe.solver.reach import crossing
from fe.solver.varied import Differenced, Variation, refused


@dataclass(frozen=True)
class Solution:
    """The response of a case to a path.

    `converged`, or else `reason` says why not and `reached` (MPa) how far; `iterations` counts
    factorisations. curves: one for each direction of gravity; number (s,) of that which belongs to an output
    time. pressure (s,) MPa is the (creep-equivalent) pressure at the output times; slopes (v, s) its
    derivatives.
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
                        carried = moved(State(u, p), curve.slope(h.pressure[k]), h.slopes[n, k])
                        state = State(h.derivative[n][k], h.p_derivative[n][k], carried.rotation)
                        drift[k] = moved(drift[k], moved(state, carried, -1.0), change[n])
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
        u = self._carried(operator, self.number, self.pressure)
        if h is None or not h.active:
            return u
        rest = _apply(operator, h.u) - self._carried(operator, h.number, h.pressure)
        return u + np.tensordot(h.weights, rest, 1)

    def _carried(self, operator: csr_matrix, number: Integers, pressure: Array, order: int = 0) -> Array:
        """Displacements (k, p, 3) mm on the curves `number` (k,) at pressures (k,) MPa, or their slopes."""
        out = np.empty((len(pressure), operator.shape[0], 3))
        for k, curve in enumerate(self.curves):
            out[number == k] = curve.values(operator, pressure[number == k], order)
        return out

    def per_pressure(self, points: Array) -> Array:
        """dU/dp (s, p, 3) mm per MPa at the output times, at fixed history."""
        slope = self._carried(self._operator(points), self.number, self.pressure, 1)
        return slope / self.path.stiffness_at(self.path.output)[:, None, None]

    def variations_at(self, points: Array) -> Array:
        """Derivatives (v, s, p, 3) of `at` to the parameters of the variations, mm per unit."""
        operator, h = self._operator(points), self.history
        du = self._along(operator, self.number, self.pressure, self.slopes)
        if h is None or not len(du):
            return du
        carrier = self._along(operator, h.number, h.pressure, h.slopes)
        for n, d in h.derivative.items():
            du[n] += np.tensordot(h.weights, _apply(operator, d) - carrier[n], 1)
        return du

    def _along(self, operator: csr_matrix, number: Integers, pressure: Array, slopes: Array) -> Array:
        du = slopes[..., None, None] * self._carried(operator, number, pressure, 1)
        for k, curve in enumerate(self.curves):
            du[:, number == k] += curve.derivatives(operator, pressure[number == k])
        return du

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
    count: int = 12,
) -> Solution:
    """The displacements of `case` along `path`, and their derivatives along `variations`.

    start: a solution of a neighbouring case with the same mesh and path, to begin from. count: levels of
    pressure that carry the history-free curve (10 leave 2e-4 mm of the finger's 58); one output time needs no
    curve. Never raises for lack of convergence: see `Solution.converged`, `reason` and `reached`.
    """
    if case.contact is not None and not case.contact.friction >= 0:
        raise ValueError(
            f"friction {case.contact.friction}: wanted a coefficient of 0 or more, without unit; correct it"
        )
    if path.stiffness is not None and path.stiffness.min() <= 0:
        none, slopes = np.zeros(len(path.output)), np.zeros((len(variations), len(path.output)))
        reason = f"stopped: the factor of its moduli falls to {path.stiffness.min():.3g}, wanted above 0"
        return Solution(case, path, (nothing(reason),), none.astype(int), none, slopes, None, 0, reason)
    refused(case, path, variations)
    kernel = _kernel(_Key(case))
    problem = Problem.of(case, kernel)
    varied = [
        Differenced(Problem.of(v.plus[0], kernel), Problem.of(v.minus[0], kernel), v.step) for v in variations
    ]
    pairs = [(v.plus[1], v.minus[1]) for v in variations]
    dense = Course.of(problem, path, path.time)
    directions = [Direction.of(v, paths, path.time) for v, paths in zip(varied, pairs, strict=True)]
    loadings = Loadings.of(problem, path, varied, pairs)
    remember = any(
        q.remembers(path) or any(v.remembers(*pair) for v, pair in zip(around, pairs, strict=True))
        for q, around in zip(loadings.problems, loadings.varied, strict=True)
    )
    rubs = any(q.rubs for q in loadings.everyone)
    slips = rubs and (remember or len(loadings.problems) > 1 or _falls(path, dense.pressure))
    top, only = (
        max(float(dense.pressure.max()), 1e-9),
        float(np.interp(path.output[0], path.time, dense.pressure)),
    )
    if len(path.output) == 1 and only > 0 and not (remember or slips):
        top, loadings = only, loadings.only(int(loadings.at(path.output)[0]))
        count = count if rubs else 1
    steps, low = levels(top, count=count), float(dense.pressure.min())
    if low < -0.01 * top:  # above that is a gauge's noise, which the first cubic carries
        steps = np.append(low, steps)
    near = start.curves if start is not None and len(start.curves) == len(loadings.problems) else None
    curves = tuple(
        trace(q, steps, varied=around, near=near[k] if near else None)
        for k, (q, around) in enumerate(zip(loadings.problems, loadings.varied, strict=True))
    )
    reason = next((c.reason for c in curves if c.reason != "converged"), "converged")
    slips = slips and any(
        _touched(*them) for them in zip(loadings.problems, loadings.varied, curves, strict=True)
    )

    def result(history: History | None, iterations: int, reason: str) -> Solution:
        pressure, *slopes = (
            np.interp(path.output, path.time, x) for x in (dense.pressure, *(d.slopes for d in directions))
        )
        shape = np.reshape(slopes, (len(varied), len(path.output)))
        number, count = loadings.at(path.output), iterations + sum(c.iterations for c in curves)
        return Solution(case, path, curves, number, pressure, shape, history, count, reason)

    if reason != "converged" or not (remember or slips):
        return result(None, 0, reason)
    return result(*follow(loadings, curves, pairs, near=start.history if start else None))


FALL = 0.02  # of the range: a fall of the pressure by less is a gauge's noise


def _falls(path: Path, pressure: Array) -> bool:
    """Whether the pressure (t,) MPa falls before the last output."""
    p = pressure[: int(np.searchsorted(path.time, path.output.max())) + 1]
    return bool((np.maximum.accumulate(p) - p).max() > FALL * np.ptp(pressure))


def _touched(problem: Problem, varied: Sequence[Differenced], curve: Curve) -> bool:
    """Whether a problem or a neighbour is on its plane anywhere on the curve."""
    every = [problem, *(q for v in varied for q in (v.plus, v.minus))]
    return any(q.plane is not None and q.plane.touches(q.case.nodes + u) for q in every for u in curve.u)


class _Key:
    """What two cases must share to use one kernel: mesh, supports and surfaces, not materials or loads."""

    def __init__(self, case: Case) -> None:
        self.case = case
        surface = case.surfaces[case.pressurised] if case.pressurised else ()
        held = case.supported, case.clamped
        mesh = case.element.name, case.nodes, case.connectivity, case.precurvature
        self.digest = digest(*mesh, surface, *held)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and other.digest == self.digest

    def __hash__(self) -> int:
        return hash(self.digest)


@lru_cache(maxsize=4)
def _kernel(key: _Key) -> Kernel:
    return Kernel(key.case)
