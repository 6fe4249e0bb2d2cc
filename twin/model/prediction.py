"""A base test and effects -> predicted displacements and their derivatives, each by a solve of its own."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Self

import numpy as np
from numpy.typing import NDArray

from calibrate import Parameter
from fe import Solution, Variation, solve
from fe.mesh.mirror import mirrored, symmetry_support
from fe.path import LEVELS
from twin import effort
from twin.effects.material import Elasticity
from twin.effects.protocol import Effect, Order, Test, Theta, Unsolvable
from twin.gravity import hangs_aside, is_heavy, pulls_across
from twin.laws.law import STRETCH, RubberLaw
from twin.laws.stability import steadiness
from twin.model.discretisation import Discretisation
from twin.model.firstorder import Known, Paced, directions, paced, perturbed, slipped
from twin.model.sagged import material_points, moved_along
from twin.targets import Array, relative

STEP = 1e-6  # of a parameter's typical size, for differencing the effects' maps
# Of what a material's memory makes of each displacement, the error of the mesh beside its correction, made
# without history: 1 sd. Two meshes of the demo's test differ by 1 to 3 % of it, near the clamp by 6 %.
HISTORY = 0.05
BESIDE = 0.02  # of the shear modulus, by which derivatives may go beyond what is stable
SECANT_LEVELS = 6  # of pressure, for what absent effects add: within 0.2 % of what 12 levels give
NUDGE = 1e-4  # of the highest pressure, for differencing the mesh's correction


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

    reference (r,): output steps whose mean is subtracted. rests (s,): number of the rest that each step is
    relative to, where films have their own; None: one for all. mesh: the error of the mesh, which corrects
    every prediction and its derivatives. parent: the model that this one came from by adding an effect. A
    model has no state: every question is a solve of its own. `keptmodel.KeptModel` keeps solves and gives the
    same answers sooner.
    """

    test: Test
    effects: tuple[Effect, ...]
    reference: NDArray[np.int64]
    mesh: Discretisation | None = field(default=None, compare=False, repr=False)
    parent: "Model | None" = field(default=None, compare=False, repr=False)
    rests: NDArray[np.int64] | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", tuple(sorted(self.effects, key=lambda e: e.order)))

    @property
    def law(self) -> RubberLaw | None:
        """The law of its silicone; None where nothing of that is a parameter."""
        return next((e.law for e in self.effects if isinstance(e, Elasticity)), None)

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
        """The model with one more effect, which replaces a wider or narrower law of its physics."""
        others = tuple(e for e in self.effects if e.name != effect.name)
        return replace(self, effects=(*others, effect), parent=self)

    def on_mesh(self, mesh: Discretisation | None) -> Self:
        """The model whose predictions carry the error of its mesh; None: as the mesh gives them."""
        parent = self.parent.on_mesh(mesh) if self.parent is not None else None
        return replace(self, mesh=mesh, parent=parent)

    def at_one_rest(self) -> Self:
        """The model relative to the rest of its first film alone, for a film that was not made yet."""
        if self.rests is None:
            return self
        reference = self.reference[self.rests[self.reference] == self.rests[self.reference[0]]]
        return replace(self, reference=reference, rests=None)

    @property
    def base(self) -> "Model":
        """The model that this one came from by adding effects."""
        return self.parent.base if self.parent is not None else self

    @cached_property
    def _whole(self) -> tuple[Test, str]:
        """The base test, of the whole structure where a half is not enough, and the reason."""
        case, names = self.test.case, [e.name for e in self.effects if e.breaks_symmetry(self.test)]
        if pulls_across(self.test.path) and is_heavy(case):
            names.append("weight")
        if hangs_aside(case, self.test.path):
            names.append("a hung load")
        if symmetry_support(case) is None:
            return self.test, "Whole model: the mesh has no plane of symmetry."
        if not names:
            return self.test, "Half model: load and shape are symmetric."
        test = replace(self.test, case=mirrored(case))
        return test, f"Whole model: {', '.join(names)} {'break' if names[1:] else 'breaks'} the symmetry."

    def over(self, model: "Model") -> "Model":
        """This model on the mesh of another that came from it: halves and wholes agree to 1e-7 mm only, as
        Newton's method leaves them, so that what an effect does is told on one mesh."""
        return self if self._is_as(model) else replace(self, test=model._whole[0], parent=None)

    @property
    def extent(self) -> str:
        """A sentence: whether half of a symmetric mesh is solved or all of it, and why."""
        return self._whole[1]

    def _is_as(self, model: "Model") -> bool:
        """True if both solve meshes of equal size."""
        return len(self._whole[0].case.nodes) == len(model._whole[0].case.nodes)

    def put(self, theta: Theta) -> Test:
        """The test with every effect's `before` applied. Raises Unsolvable where its rubber is not stable."""
        test = self._put(theta)
        if (least := steadiness(test.case)) < -BESIDE:
            raise Unsolvable(
                f"no stable rubber: of its shear modulus {least:.2g} is left within a stretch of "
                f"{STRETCH:g}; wanted 0 or more"
            )
        return test

    def allowed(self, theta: Theta) -> bool:
        """True if a fit may go there: where its rubber is stable. Derivatives may go a little beyond."""
        try:
            return steadiness(self._put(theta).case) >= 0.0
        except Unsolvable:
            return False

    def _put(self, theta: Theta) -> Test:
        test = self._whole[0]
        for e in self.effects:
            test = e.before(test, theta)
        return test

    def seen(self, u: Array, test: Test, theta: Theta) -> Array:
        """Displacements (s, p, 3) mm with the mesh's correction and after every effect's `after`, relative to
        the reference."""
        if self.mesh is not None:
            u = self.mesh.corrected(u, test)
        for e in self.effects:
            u = e.after(u, test, theta)
        return self.relative(u)

    def relative(self, u: Array) -> Array:
        """Displacements (s, p, 3) mm relative to the reference of their film."""
        if self.rests is None:
            return u - u[self.reference].mean(axis=0)
        return relative(u, self.reference, self.rests)

    # -- solves ---------------------------------------------------------------------------------------------

    def predict(self, theta: Array) -> Array:
        """Displacements (s, p, 3) mm relative to the reference. Raises Unsolvable where there is no
        equilibrium."""
        return self.solved(theta).u

    def jacobian(self, theta: Array) -> Array:
        """Derivatives (d, s, p, 3) of `predict`, mm per unit of each parameter."""
        jacobian = self.solved(theta, derivatives=True).jacobian
        assert jacobian is not None
        return jacobian

    def solution(self, theta: Array) -> Solution:
        """The finite-element solution at theta (d,)."""
        return self.solved(theta).solution

    def per_pressure(self, theta: Array) -> Array:
        """dU/dp (s, p, 3) mm per MPa of the pressure at the step itself, with the mesh's correction, before
        the effects of the camera."""
        test, solution = self.put(self.named(theta)), self.solution(theta)
        out = np.zeros((len(self.test.path.output), len(self.test.points), 3))
        out[:, test.moving] = solution.per_pressure(test.points[test.moving])
        if self.mesh is None:
            return out
        u, little = moved(test, solution), NUDGE * float(np.abs(test.path.pressure).max())
        if not little:  # no pressure at all: a bar under its weight
            return np.zeros_like(out)
        ahead, behind = (self.mesh.corrected(u + h * out, test) for h in (little, -little))
        return (ahead - behind) / (2 * little)

    def modes(self, theta: Array) -> Array:
        """Modes (q, s, p, 3) mm, 1 sd each, of the mesh's error that remains at theta (d,), relative to the
        reference; none without `mesh`."""
        return self._beside(theta, self.mesh_modes(theta))

    def mesh_modes(self, theta: Array) -> Array:
        """As `modes`, but for the first, which is as the finer meshes have it."""
        if self.mesh is None:
            return np.zeros((0, len(self.test.path.output), len(self.test.points), 3))
        test = self.put(self.named(theta))
        solution = self.solution(theta)
        u = moved(test, solution)
        modes = self.mesh.modes(u, test)
        memory = remembered(test, solution)
        if memory is not None:
            modes = np.concatenate([modes, HISTORY * each(memory)])
        return np.reshape([self.relative(mode) for mode in modes], modes.shape)

    def _beside(self, theta: Array, modes: Array) -> Array:
        """The modes with the first, the mesh's stiffness, exactly what the fitted constants take up: with a
        history the finer meshes' curves differ by a hundredth, by which good data would seem to tell the two
        apart."""
        rows = {p.name: k for k, p in enumerate(self.parameters)}
        moduli = self.law.moduli if self.law else ()
        if self.mesh is not None and len(modes) and moduli and set(moduli) <= set(rows):
            jacobian = self.jacobian(theta)
            modes[0] = -self.mesh.stiffness * sum(theta[rows[name]] * jacobian[rows[name]] for name in moduli)
        return modes

    def solved(self, theta: Array, *, derivatives: bool = False) -> Solved:
        """The solve at theta (d,), with derivatives where they are asked for. Raises Unsolvable where there
        is no equilibrium."""
        values = self.named(theta)
        test = self.put(values)
        changes = [self._direction(values, p) for p in self.parameters] if derivatives else []
        u, du, solution = respond(test, [c[0] for c in changes], start=self._start(theta))
        rows = [self._through(u, d + _slid(test, solution, c), c) for d, c in zip(du, changes, strict=True)]
        jacobian = np.stack(rows) if derivatives else None
        return Solved(theta.copy(), self.seen(u, test, values), jacobian, solution)

    def values(self, theta: Array) -> Solved:
        """The solve at theta (d,), without derivatives where none is kept."""
        return self.solved(theta)

    def drawn(self, theta: Array) -> Solved:
        """The solve at theta (d,) for whoever draws it: without derivatives, whatever the model keeps."""
        return Model.solved(self, theta)

    def _seen_again(self, solved: Solved) -> Solved:
        """A solve of another model that differs in `mesh` alone, as this one sees it."""
        values, solution = self.named(solved.theta), solved.solution
        test, jacobian = self.put(values), None
        u = moved(test, solution)
        if solved.jacobian is not None:
            changes = [self._direction(values, p) for p in self.parameters]
            du = varied(test, solution, [c[0] for c in changes])
            every = zip(du, changes, strict=True)
            jacobian = np.stack([self._through(u, d + _slid(test, solution, c), c) for d, c in every])
        return Solved(solved.theta, self.seen(u, test, values), jacobian, solution)

    def _start(self, theta: Array) -> Solution | None:
        """A solution to begin the solve at theta (d,) from: none, as a model remembers none."""
        del theta
        return None

    def _direction(self, values: dict[str, float], p: Parameter, *, step: float | None = None) -> "Direction":
        h = STEP * p.step if step is None else step
        plus, minus = {**values, p.name: values[p.name] + h}, {**values, p.name: values[p.name] - h}
        a, b = self.put(plus), self.put(minus)
        ways, perturbs = ((a, plus), (b, minus), h), [e for e in self.effects if e.order == Order.COURSE]
        for k, e in enumerate(perturbs):
            if p in e.parameters:
                ahead, behind = a.perturbations[k], b.perturbations[k]
                return Paced((ahead.plus, a.path), (behind.plus, b.path), h, ahead.course), *ways
        return Variation((a.case, a.path), (b.case, b.path), h), *ways

    def _through(self, u: Array, du: Array, change: "Direction") -> Array:
        """The derivative of the seen displacements, from the motion's: one difference along (du, theta)."""
        _, (a, plus), (b, minus), h = change
        return (self.seen(u + h * du, a, plus) - self.seen(u - h * du, b, minus)) / (2 * h)

    def tangents(self, theta: Array, effects: Sequence[Effect]) -> "Tangents":
        """For each absent effect, per entry of its `tries`, the changes (k, s, p, 3) mm per unit of each
        parameter that has a null, by label.

        Secants over a typical step from null, to first order and all effects on the same mesh in one solve,
        or, where an effect is not smooth, by whole solves; the other parameters stay at null or at theta. An
        effect that moves nothing but what is seen costs no back-substitution. Where there is no equilibrium
        or no room for a step, rows are 0 and `Tangents.notes` says why.
        """
        out, models = Tangents(), {e.label: self.with_effect(e) for e in effects}
        rows = [
            _Row(e, models[e.label], k, {**self.named(theta), **_nulls(e), **entry}, p)
            for e in effects
            for k, entry in enumerate(e.tries(self.test))
            for p in e.amplitudes
        ]
        by_key = {row.key: self._whole_secant(theta, row, out.notes) for row in rows if not row.effect.smooth}
        for on_this_mesh in (True, False):
            batch = [row for row in rows if row.effect.smooth and self._is_as(row.model) == on_this_mesh]
            if batch:
                by_key |= self._secants(theta, batch, out.notes)
        for e in effects:
            tried = range(len(e.tries(self.test)))
            out[e.label] = [np.stack([by_key[e.label, k, p.name] for p in e.amplitudes]) for k in tried]
        return out

    def _whole_secant(self, theta: Array, row: "_Row", notes: dict[str, str]) -> Array:
        """One row of `tangents`, from a solve with the effect; nothing where there is none."""
        base = self.over(row.model).predict(theta)
        values = {**row.values, row.parameter.name: row.null + row.parameter.step}
        try:
            test = row.model.put(values)
            u = row.model.seen(respond(test, (), start=None)[0], test, values)
        except Unsolvable as why:
            notes[row.effect.label] = str(why)
            u = base
        return (u - base) / row.parameter.step

    def _secants(self, theta: Array, batch: "Sequence[_Row]", notes: dict[str, str]) -> "dict[Key, Array]":
        """The rows of `tangents` of effects whose models solve one mesh."""
        by_key = {row.key: self._way(row, notes) for row in batch}
        model = self.over(batch[0].model)  # of effects that break the symmetry, the whole
        test = model.put(self.named(theta))
        moving = [row.key for row in batch if by_key[row.key] is not None and row.moves]
        u, du, solution = respond(
            test,
            [direction[0] for key in moving if (direction := by_key[key])],
            start=self._start(theta),
            columns=True,
        )
        along, out = dict(zip(moving, du, strict=True)), {}
        slopes: Known = {}
        for row in batch:
            direction, still = by_key[row.key], np.zeros_like(u)
            if direction is not None:
                still = along.get(row.key, still) + _slid(test, solution, direction, slopes)
                still = row.model._through(u, still, direction)
            out[row.key] = still
        return out

    def _way(self, row: "_Row", notes: dict[str, str]) -> "Direction | None":
        """The secant's direction, over a shorter step where there is no room for a typical one, if any."""
        p = row.parameter
        for step in (p.step / 2, p.step / 16):
            try:
                return row.model._direction({**row.values, p.name: row.null + step}, p, step=step)
            except Unsolvable as why:
                notes[row.effect.label] = str(why)
        return None


class Tangents(dict[str, list[Array]]):
    """Rows (k, s, p, 3) mm per unit of each of k parameters, one array an entry of `tries`, by an effect's
    label. notes: by label, why an effect has rows of 0, or of a shorter step."""

    def __init__(self) -> None:
        super().__init__()
        self.notes: dict[str, str] = {}


Key = tuple[str, int, str]


@dataclass(frozen=True)
class _Row:
    """One row of `tangents`: an effect in its model, the number of the entry of `tries`, the values of all
    parameters there with the effect absent, and the parameter that changes."""

    effect: Effect
    model: Model
    entry: int
    values: dict[str, float]
    parameter: Parameter

    @property
    def key(self) -> Key:
        return self.effect.label, self.entry, self.parameter.name

    @property
    def null(self) -> float:
        assert self.parameter.null is not None
        return self.parameter.null

    @property
    def moves(self) -> bool:
        """True if the effect changes the solve, and not only its picture."""
        base, little = self.model.test, self.null + self.parameter.step / 8
        test = self.effect.before(base, {**self.values, self.parameter.name: little})
        return test.case is not base.case or test.path is not base.path or bool(test.perturbations)


def _nulls(effect: Effect) -> dict[str, float]:
    return {p.name: p.null for p in effect.amplitudes if p.null is not None}


Direction = tuple[Variation, tuple[Test, Theta], tuple[Test, Theta], float]


def respond(
    test: Test, variations: Sequence[Variation], *, start: Solution | None, columns: bool = False
) -> tuple[Array, Array, Solution]:
    """Displacements (s, p, 3) mm of a test's points, derivatives (v, s, p, 3), and the solution.

    columns: the variations are counted, not the solve. Raises Unsolvable where the load path cannot be
    followed to its end.
    """
    began, count = time.process_time(), len(variations)
    every = [*variations, *directions(test)]
    levels = SECANT_LEVELS if columns else LEVELS
    solution = solve(test.case, test.path, start=start, variations=every, count=levels)
    if solution.converged:
        u, du = moved(test, solution), varied(test, solution, variations)
    kind = effort.kind_of(history=solution.history is not None, derivatives=count > 0)
    work = (effort.COLUMNS, count) if columns and count else (kind, 1)
    effort.add(*work, time.process_time() - began)
    if not solution.converged:
        raise Unsolvable(f"the finite-element model {solution.reason}", reached=solution.reached)
    return u, du, solution


def moved(test: Test, solution: Solution) -> Array:
    """Displacements (s, p, 3) mm of a test's points in its solution, before any correction and effect."""
    u = np.zeros((len(test.path.output), len(test.points), 3))
    displacements = partial(perturbed, test, solution)
    u[:, test.moving] = displacements(material_points(test, displacements))
    return u + slipped(test, displacements) if test.slips else u


def remembered(test: Test, solution: Solution) -> Array | None:
    """Displacements (s, p, 3) mm of a test's points that the memory of its materials adds; None without a
    memory. Without it they are displacements of the curves that carried the history. Perturbations of the
    test are left out."""
    test = replace(test, perturbations=())
    plain = test.case.with_material(prony=(), mullins=None)
    if plain.materials == test.case.materials:
        return None
    without, instant = replace(test, case=plain), solution.instant
    u = moved(without, instant) if instant else respond(without, (), start=None)[0]
    return moved(test, solution) - u


def each(field: Array) -> Array:
    """A field (s, p, 3) taken apart: one (s, p, 3) for each point and axis that it moves (k, s, p, 3)."""
    flat = field.reshape(len(field), -1)
    rows = np.flatnonzero((flat != 0).any(axis=0))
    out = np.einsum("sn,kn->ksn", flat, np.eye(flat.shape[1])[rows])
    return np.asarray(out.reshape(len(rows), *field.shape))


def varied(test: Test, solution: Solution, variations: Sequence[Variation]) -> Array:
    """Derivatives (v, s, p, 3) of `moved` along the variations, the first that were solved."""
    count = len(variations)
    du = np.zeros((count, len(test.path.output), len(test.points), 3))
    if not count:
        return du

    def derivatives(points: Array) -> Array:
        return paced(solution.variations_at(points)[:count], variations)

    displacements = partial(perturbed, test, solution)
    points = material_points(test, displacements)
    du[:, :, test.moving] = moved_along(test, points, displacements, derivatives(points))
    return du + slipped(test, derivatives, motion=displacements) if test.slips else du


def _slid(test: Test, solution: Solution, change: Direction, slopes: Known | None = None) -> Array:
    """The derivative (s, p, 3) to what slips alone on a solved test, 0 where nothing does."""
    _, (a, _), (b, _), h = change
    if not (a.slips or b.slips):
        return np.zeros((len(a.path.output), len(a.points), 3))
    slopes, displacements = {} if slopes is None else slopes, partial(perturbed, test, solution)
    plus, minus = (slipped(side, displacements, slopes=slopes) for side in (a, b))
    return (plus - minus) / (2 * h)
