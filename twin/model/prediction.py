"""A base test and effects -> predicted displacements, their derivatives, and their discretisation modes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate import Parameter
from fe import Case, Finger, Lattice, Material, Path, Solution, Variation, finger_case, solve
from fe.mesh.mirror import mirrored, symmetry_support
from twin.effects.baselaw import NOMINAL
from twin.effects.material import Elasticity
from twin.effects.protocol import Effect, Test, Theta, Unsolvable
from twin.gravity import is_heavy, of_targets, pulls_across
from twin.targets import Array, Targets

STEP = 1e-6  # of a parameter's typical size, for differencing the effects' maps
# A prediction that differs from a solved neighbour by less than NEAR mm is taken along the neighbour's
# derivatives: of 58 mm of motion that leaves an error of about NEAR^2 / 58 = 2e-4 mm. Derivatives change by
# as large a share as the displacement does, so that within SAME_SLOPE mm they are kept to half a per cent.
NEAR = 0.1
SAME_SLOPE = 0.3


@dataclass(frozen=True)
class Anchor:
    """A full solve that others may start from: theta (d,), u (s, p, 3) mm, its derivatives (d, s, p, 3)."""

    theta: Array
    u: Array
    jacobian: Array
    solution: Solution


@dataclass(frozen=True)
class Model:
    """The base test with its effects; `predict` and `jacobian` give displacements relative to the reference
    steps.

    reference (r,): output steps whose mean is subtracted. Solves are kept and reused: a prediction so close
    to an earlier one that first order serves (NEAR) costs nothing.
    """

    test: Test
    effects: tuple[Effect, ...]
    reference: NDArray[np.int64]
    _anchors: list[Anchor] = field(default_factory=list, compare=False, repr=False)
    _kin: dict[str, "Model"] = field(default_factory=dict, compare=False, repr=False)
    _parent: "Model | None" = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", tuple(sorted(self.effects, key=lambda e: e.order)))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters, in the order of the vector theta."""
        return tuple(p for e in self.effects for p in e.parameters)

    def theta(self, values: Mapping[str, float]) -> Array:
        """The vector theta of named values."""
        return np.array([values[p.name] for p in self.parameters])

    def named(self, theta: Array) -> dict[str, float]:
        """Named values of the vector theta."""
        return {p.name: float(x) for p, x in zip(self.parameters, theta, strict=True)}

    def with_effect(self, effect: Effect) -> "Model":
        """The model with one more effect; a wider or narrower law of the same physics is replaced."""
        if effect.label not in self._kin:  # one object for one model, so that its solves are kept
            kept = tuple(e for e in self.effects if e.name != effect.name)
            self._kin[effect.label] = Model(self.test, (*kept, effect), self.reference, _parent=self)
        return self._kin[effect.label]

    @property
    def base(self) -> "Model":
        """The model that this one came from by adding effects."""
        return self._parent.base if self._parent is not None else self

    @cached_property
    def _whole(self) -> tuple[Test, str]:
        """The base test, of the whole structure where half of it is not enough, and why that is."""
        case, names = self.test.case, [e.name for e in self.effects if e.breaks_symmetry(self.test)]
        if pulls_across(self.test.path) and is_heavy(case):
            names.append("weight")
        if symmetry_support(case) is None:
            return self.test, "the mesh has no plane of symmetry: all of it is solved"
        if not names:
            return self.test, "half of the mesh is solved: nothing breaks its symmetry"
        whole = replace(self.test, case=mirrored(case))
        return whole, f"the whole mesh is solved: {', '.join(names)} breaks its symmetry"

    def over(self, other: "Model") -> "Model":
        """This model on the mesh of another that came from it: halves and wholes agree to 1e-7 mm only, as
        Newton's method leaves them, so that what an effect does is told on one mesh."""
        return self if self._is_as(other) else Model(other._whole[0], self.effects, self.reference)

    @property
    def extent(self) -> str:
        """Whether half of a symmetric mesh is solved or all of it, and why, in words."""
        return self._whole[1]

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

    def predict(self, theta: Array) -> Array:
        """Displacements (s, p, 3) mm relative to the reference. Raises Unsolvable where there is no
        equilibrium."""
        near, change = self._near(theta)
        if near is not None and np.abs(change).max() < NEAR:
            return near.u + change
        return self._solve(theta).u

    def jacobian(self, theta: Array) -> Array:
        """Derivatives (d, s, p, 3) of `predict`, mm per unit of each parameter."""
        near, change = self._near(theta)
        if near is not None and np.abs(change).max() < SAME_SLOPE:
            return near.jacobian
        return self._solve(theta).jacobian

    def solution(self, theta: Array) -> Solution:
        """The finite-element solution at theta, or at a solved neighbour that differs by less than NEAR."""
        near, change = self._near(theta)
        if near is not None and np.abs(change).max() < NEAR:
            return near.solution
        return self._solve(theta).solution

    def _near(self, theta: Array) -> tuple[Anchor | None, Array]:
        """The nearest solve in typical steps, and the change (s, p, 3) mm from it to first order."""
        scale = np.array([p.step for p in self.parameters])
        near = min(self._anchors, key=lambda a: float(np.abs((a.theta - theta) / scale).max()), default=None)
        return near, np.zeros(1) if near is None else np.tensordot(theta - near.theta, near.jacobian, 1)

    def _start(self, theta: Array) -> Solution | None:
        """The nearest solution to first order here; for a model's first, that of the model it came from."""
        near, model = self._near(theta)[0], self
        if near is None and self._parent is not None and self._parent._anchors and self._is_as(self._parent):
            near, model = self._parent._anchors[-1], self._parent
        if near is None:
            return None
        values = self.named(theta)
        return near.solution.ahead(np.array([values.get(p.name, 0.0) for p in model.parameters]) - near.theta)

    def _is_as(self, other: "Model") -> bool:
        """Whether both solve the same mesh."""
        return len(self._whole[0].case.nodes) == len(other._whole[0].case.nodes)

    def _solve(self, theta: Array) -> Anchor:
        """A full solve with all derivatives, kept for what comes near it."""
        values = self.named(theta)
        test = self.put(values)
        changes = [self._direction(values, p) for p in self.parameters]
        u, du, solution = respond(test, [c[0] for c in changes], start=self._start(theta))
        jacobian = np.stack([self._through(u, d, c) for d, c in zip(du, changes, strict=True)])
        anchor = Anchor(theta.copy(), self.seen(u, test, values), jacobian, solution)
        self._anchors.append(anchor)
        del self._anchors[:-6]
        return anchor

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

    def per_pressure(self, theta: Array) -> Array:
        """dU/dp (s, p, 3) mm per MPa of the pressure at the step itself, as seen by the camera."""
        test, out = (
            self.put(self.named(theta)),
            np.zeros((len(self.test.path.output), len(self.test.points), 3)),
        )
        out[:, test.moving] = self.solution(theta).per_pressure(test.points[test.moving])
        return out


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


def base_case(*, finger: Finger | None = None, lattice: Lattice | None = None) -> Case:
    """The embedded bellows finger with nominal constants, to which every effect is applied."""
    return finger_case(Material(NOMINAL.C10, NOMINAL.C01), finger=finger, lattice=lattice)


def base_test(targets: Targets, case: Case) -> Test:
    """The test that the targets describe: their points on the case, their log as the path."""
    moving = ~targets.fixed
    points = targets.places(case.position)
    path = Path(targets.log_time, targets.log_pressure, targets.time, gravity=of_targets(targets))
    return Test(case, path, np.nan_to_num(points), moving)


def base_model(
    targets: Targets, case: Case, *, elasticity: Elasticity | None = None, effects: Sequence[Effect] = ()
) -> Model:
    """The model of the targets: elasticity and the given effects."""
    return Model(base_test(targets, case), (elasticity or Elasticity(), *effects), targets.reference)
