"""A base test and effects -> predicted displacements and their derivatives, each by a solve of its own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate import Parameter
from fe import Solution, Variation, solve
from fe.mesh.mirror import mirrored, symmetry_support
from twin.effects.protocol import Effect, Test, Theta, Unsolvable
from twin.gravity import is_heavy, pulls_across
from twin.targets import Array

STEP = 1e-6  # of a parameter's typical size, for differencing the effects' maps


@dataclass(frozen=True)
class Solved:
    """A solve at theta (d,): displacements u (s, p, 3) mm relative to the reference, their derivatives
    jacobian (d, s, p, 3) in mm per unit of each parameter where they were asked for, and the solution."""

    theta: Array
    u: Array
    jacobian: Array | None
    solution: Solution


@dataclass(frozen=True)
class Model:
    """The base test with its effects; `predict` and `jacobian` give displacements relative to the reference
    steps.

    reference (r,): output steps whose mean is subtracted. parent: the model that this one came from by adding
    an effect. A model has no state: every question is a solve of its own. `memo.KeptModel` keeps solves and
    gives the same answers sooner.
    """

    test: Test
    effects: tuple[Effect, ...]
    reference: NDArray[np.int64]
    parent: "Model | None" = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", tuple(sorted(self.effects, key=lambda e: e.order)))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters, in the order of the vector theta."""
        return tuple(p for e in self.effects for p in e.parameters)

    def theta(self, values: Mapping[str, float]) -> Array:
        """The vector theta (d,) of named values."""
        return np.array([values[p.name] for p in self.parameters])

    def named(self, theta: Array) -> dict[str, float]:
        """Named values of the vector theta (d,)."""
        return {p.name: float(x) for p, x in zip(self.parameters, theta, strict=True)}

    def with_effect(self, effect: Effect) -> "Model":
        """The model with one more effect; a wider or narrower law of the same physics is replaced."""
        kept = tuple(e for e in self.effects if e.name != effect.name)
        return replace(self, effects=(*kept, effect), parent=self)

    @property
    def base(self) -> "Model":
        """The model that this one came from by adding effects."""
        return self.parent.base if self.parent is not None else self

    @cached_property
    def _whole(self) -> tuple[Test, str]:
        """The base test, of the whole structure where half of it is not enough, and why that is."""
        case, names = self.test.case, [e.name for e in self.effects if e.breaks_symmetry(self.test)]
        if pulls_across(self.test.path) and is_heavy(case):
            names.append("weight")
        if symmetry_support(case) is None:
            return self.test, "Whole model: the mesh has no plane of symmetry."
        if not names:
            return self.test, "Half model: load and shape are symmetric."
        whole = replace(self.test, case=mirrored(case))
        return whole, f"Whole model: {', '.join(names)} {'break' if names[1:] else 'breaks'} the symmetry."

    def over(self, other: "Model") -> "Model":
        """This model on the mesh of another that came from it: halves and wholes agree to 1e-7 mm only, as
        Newton's method leaves them, so that what an effect does is told on one mesh."""
        return self if self._is_as(other) else replace(self, test=other._whole[0], parent=None)

    @property
    def extent(self) -> str:
        """A sentence: whether half of a symmetric mesh is solved or all of it, and why."""
        return self._whole[1]

    def _is_as(self, other: "Model") -> bool:
        """Whether both solve the same mesh."""
        return len(self._whole[0].case.nodes) == len(other._whole[0].case.nodes)

    def put(self, theta: Theta) -> Test:
        """The test with every effect's `before` applied."""
        test = self._whole[0]
        for e in self.effects:
            test = e.before(test, theta)
        return test

    def seen(self, u: Array, test: Test, theta: Theta) -> Array:
        """Displacements (s, p, 3) mm after every effect's `after`, relative to the reference."""
        for e in self.effects:
            u = e.after(u, test, theta)
        return u - u[self.reference].mean(axis=0)

    # -- solves ---------------------------------------------------------------------------------------------

    def predict(self, theta: Array) -> Array:
        """Displacements (s, p, 3) mm relative to the reference. Raises Unsolvable where there is no
        equilibrium."""
        return self.solved(theta).u

    def jacobian(self, theta: Array) -> Array:
        """Derivatives (d, s, p, 3) of `predict`, mm per unit of each parameter."""
        found = self.solved(theta, derivatives=True).jacobian
        assert found is not None
        return found

    def solution(self, theta: Array) -> Solution:
        """The finite-element solution at theta (d,)."""
        return self.solved(theta).solution

    def per_pressure(self, theta: Array) -> Array:
        """dU/dp (s, p, 3) mm per MPa of the pressure at the step itself, before the effects of the camera."""
        test, solution = self.put(self.named(theta)), self.solution(theta)
        out = np.zeros((len(self.test.path.output), len(self.test.points), 3))
        out[:, test.moving] = solution.per_pressure(test.points[test.moving])
        return out

    def solved(self, theta: Array, *, derivatives: bool = False) -> Solved:
        """The solve at theta (d,), with derivatives where they are asked for. Raises Unsolvable where there
        is no equilibrium."""
        values = self.named(theta)
        test = self.put(values)
        changes = [self._direction(values, p) for p in self.parameters] if derivatives else []
        u, du, solution = respond(test, [c[0] for c in changes], start=self._start(theta))
        rows = [self._through(u, d, c) for d, c in zip(du, changes, strict=True)]
        jacobian = np.stack(rows) if derivatives else None
        return Solved(theta.copy(), self.seen(u, test, values), jacobian, solution)

    def _start(self, theta: Array) -> Solution | None:
        """A solution to begin the solve at theta (d,) from: none, as a model remembers none."""
        del theta
        return None

    def _direction(self, values: dict[str, float], p: Parameter, *, step: float | None = None) -> "Direction":
        h = STEP * p.step if step is None else step
        plus, minus = {**values, p.name: values[p.name] + h}, {**values, p.name: values[p.name] - h}
        a, b = self.put(plus), self.put(minus)
        return Variation((a.case, a.path), (b.case, b.path), h), (a, plus), (b, minus), h

    def _through(self, u: Array, du: Array, change: "Direction") -> Array:
        """The derivative of what is seen, from that of what moves: one difference along (du, theta)."""
        _, (a, plus), (b, minus), h = change
        return (self.seen(u + h * du, a, plus) - self.seen(u - h * du, b, minus)) / (2 * h)

    def signatures(self, theta: Array, effects: Sequence[Effect]) -> list[list[Array]]:
        """For each absent effect, per grid entry, the change (s, p, 3) mm per unit of its first parameter.

        A secant over a typical step from null, to first order and all effects on the same mesh in one solve,
        or, where an effect is not smooth, by whole solves; the other parameters stay at theta.
        """
        models = [self.with_effect(e) for e in effects]
        found = {e.label: self._whole_secants(theta, e) for e in effects if not e.smooth}
        for same in (True, False):
            some = [
                (e, m) for e, m in zip(effects, models, strict=True) if e.smooth and self._is_as(m) == same
            ]
            if some:
                found |= self._secants(theta, some)
        return [found[e.label] for e in effects]

    def _whole_secants(self, theta: Array, effect: Effect) -> list[Array]:
        """The rows of `signatures` for one effect, each from a solve with it; nothing where there is none."""
        p, model, rows = effect.parameters[0], self.with_effect(effect), []
        base = self.over(model).predict(theta)
        assert p.null is not None
        for entry in effect.grid or ({},):
            values = {**self.named(theta), **entry, p.name: p.null + p.step}
            test = model.put(values)
            try:
                u = model.seen(respond(test, (), start=None)[0], test, values)
            except Unsolvable:
                u = base
            rows.append((u - base) / p.step)
        return rows

    def _secants(self, theta: Array, some: "Sequence[tuple[Effect, Model]]") -> dict[str, list[Array]]:
        """The rows of `signatures` for effects whose models solve one mesh."""
        changes, models = [], []
        for e, model in some:
            p = e.parameters[0]
            assert p.null is not None
            for entry in e.grid or ({},):
                values = {**self.named(theta), **entry, p.name: p.null + p.step / 2}
                changes.append(model._direction(values, p, step=p.step / 2))
                models.append(model)
        own = self.over(models[0])  # of effects that break the symmetry, the whole
        start = self._start(theta) if own is self else None
        u, du, _ = respond(own.put(self.named(theta)), [c[0] for c in changes], start=start)
        rows = iter([m._through(u, d, c) for m, d, c in zip(models, du, changes, strict=True)])
        return {e.label: [next(rows) for _ in (e.grid or ({},))] for e, _ in some}


Direction = tuple[Variation, tuple[Test, Theta], tuple[Test, Theta], float]


def respond(
    test: Test, variations: Sequence[Variation], *, start: Solution | None
) -> tuple[Array, Array, Solution]:
    """Displacements (s, p, 3) mm of a test's points, derivatives (v, s, p, 3), and the solution.

    Raises Unsolvable where the load path cannot be followed to its end.
    """
    solution = solve(test.case, test.path, start=start, variations=variations)
    if not solution.converged:
        raise Unsolvable(f"the finite-element model {solution.reason}")
    shape = (len(test.path.output), len(test.points), 3)
    u, du = np.zeros(shape), np.zeros((len(variations), *shape))
    u[:, test.moving] = solution.at(test.points[test.moving])
    if len(variations):
        du[:, :, test.moving] = solution.variations_at(test.points[test.moving])
    return u, du, solution
