"""A case and a pressure history -> displacements at the output times, by one call: `solve`.

Without a memory the response is a function of pressure: one curve of equilibrium states serves every time.
Else the history is solved at a few times; between them u(t) = U(q(t)) + D(t), where U is the history-free
curve, q the creep-equivalent pressure of linear viscoelasticity over the moduli's drift, and D, small and
slow, is interpolated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_matrix

from fe.assembly import Kernel, State
from fe.case import Case, digest
from fe.curve import Curve, Differenced, trace
from fe.element import Array
from fe.history import Course, Direction, History, follow, remembers
from fe.locate import interpolation
from fe.newton import Problem, moved
from fe.path import Path, levels


@dataclass(frozen=True)
class Variation:
    """A parameter's direction: the test on either side of the present one, `step` of the parameter apart."""

    plus: tuple[Case, Path]
    minus: tuple[Case, Path]
    step: float


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
        slope = self.curve.values(self._operator(points), self.pressure, 1)
        return slope / self.path.stiffness_at(self.path.output)[:, None, None]

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
    pairs = [(v.plus[1], v.minus[1]) for v in variations]
    dense = Course.of(problem, path, path.time)
    directions = [Direction.of(v, paths, path.time) for v, paths in zip(varied, pairs, strict=True)]
    ahead = [(v.plus, paths[0]) for v, paths in zip(varied, pairs, strict=True)]
    remember = any(remembers(*one) for one in ((problem, path), *ahead))
    top, only = (
        max(float(dense.pressure.max()), 1e-9),
        float(np.interp(path.output[0], path.time, dense.pressure)),
    )
    if len(path.output) == 1 and only > 0 and not remember:
        top, count = only, 1
    curve = trace(problem, levels(top, count=count), varied=varied, near=start.curve if start else None)

    def result(history: History | None, iterations: int, reason: str) -> Solution:
        pressure, *slopes = (
            np.interp(path.output, path.time, x) for x in (dense.pressure, *(d.slopes for d in directions))
        )
        shape = np.reshape(slopes, (len(varied), len(path.output)))
        return Solution(case, path, curve, pressure, shape, history, curve.iterations + iterations, reason)

    if curve.reason != "converged" or not remember:
        return result(None, 0, curve.reason)
    return result(*follow(problem, path, curve, varied, pairs, near=start.history if start else None))


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
