"""Derivatives with respect to parameters by direct differentiation.

A parameter is given by the two tests on either side of the present one; the equilibrium's own tangent solves
for the difference of their residuals. The two sides are not solved themselves; they share the base's mesh and
held nodes. They may differ in all else: positions, materials, prescribed displacements, clamp, forces dead
and growing, layer, obstacle, self-contact, precurvature, pressure, shares of a path, drift of the moduli,
gravity, pulls. `refused` names what they may not change.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property

import numpy as np

from fe.case import Case
from fe.element import Array, Flags, Integers
from fe.kernel.assembly import ElementConstants, Memory, Response, State
from fe.kernel.contact import off_the_clamp
from fe.path import Path
from fe.solver.newton import Problem, Residual, imbalance
from fe.solver.refinement import Corrected


@dataclass(frozen=True)
class Variation:
    """Central difference of a parameter: the tests on either side, `step` of the parameter away from the
    base."""

    plus: tuple[Case, Path]
    minus: tuple[Case, Path]
    step: float


def refused(case: Case, path: Path, variations: Sequence[Variation]) -> None:
    """ValueError naming a change of case or path by a variation whose derivative is not available."""
    for v in variations:
        for side, side_path in (v.plus, v.minus):
            reason = _unsupported_change(case, side) or _unsupported_path_change(path, side_path)
            if reason:
                raise ValueError(
                    f"a variation changes {reason}: that derivative is not computed; keep it as it is in the "
                    "base, or solve both sides and take their difference"
                )


def _unsupported_change(base: Case, side: Case) -> str:
    """Name of a change between two cases whose derivative is not available, or ""."""
    if side is base:
        return ""
    if side.element is not base.element or not _same(side.connectivity, base.connectivity):
        return "`blocks`, the elements of the mesh"
    if len(side.nodes) != len(base.nodes):
        return f"`nodes`, their number ({len(base.nodes)} to {len(side.nodes)})"
    if not np.array_equal(side.supported, base.supported):
        return "`supports`, which components of which nodes they hold"
    if not _same(side.clamped, base.clamped):
        return "`clamp`, the nodes that it holds"
    if not _same(_loaded_faces(side), _loaded_faces(base)):
        return "`pressurised`, the faces under pressure"
    if not _same(base.shares, side.shares):
        return "`shares`, what of the pressure each surface carries"
    if not _same((base.ties, base.equations), (side.ties, side.equations)):
        return "`ties` or `equations`, which nodes follow which"
    if base.contact and side.contact and not _same(_touching(side), _touching(base)):
        return "`contact`, the faces that may touch its plane"
    return ""


def _unsupported_path_change(base: Path, side: Path) -> str:
    """Name of a change between two paths whose derivative is not available, or ""."""
    if not _same(side.time, base.time):
        return "`time`, when the pressure is given"
    if not _same(side.output, base.output):
        return "`output`, the output times"
    if not _same(side.places, base.places):
        return "`places`, where forces pull"
    if side.chambers != base.chambers:
        return "`chambers`, the surfaces that carry shares of the pressure"
    if side.settled != base.settled:
        return "`settled`, whether it has come to rest before"
    return "" if _same(side.turns, base.turns) else "`gravity`, `pulls` or `shares`, when they change"


def _loaded_faces(case: Case) -> Integers | None:
    return case.face_nodes(case.pressurised) if case.pressurised else None


def _touching(case: Case) -> Integers:
    surface = case.contact.surface if case.contact else ""
    return case.face_nodes(surface)[off_the_clamp(case, surface)]


def _without_memory(case: Case) -> Case:
    return replace(case, materials={name: m.instant for name, m in case.materials.items()})


def _same(a: object, b: object) -> bool:
    """True if two values are equal: arrays, records, mappings and tuples of them."""
    if a is b:
        return True
    if is_dataclass(a) and type(a) is type(b):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_same(a[k], b[k]) for k in a)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(_same(x, y) for x, y in zip(a, b, strict=True))
    return np.array_equal(a, b)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Differenced:
    """The neighbouring problems of a parameter, `plus` and `minus`, `step` away from the base on either side.
    """

    plus: Problem
    minus: Problem
    step: float

    @property
    def has_friction(self) -> bool:
        """True if either neighbour has friction."""
        return self.plus.has_friction or self.minus.has_friction

    def has_memory(self, plus: Path, minus: Path) -> bool:
        """True if the response of either neighbour may not be a function of pressure over the moduli."""
        return self.plus.has_memory(plus) or self.minus.has_memory(minus)

    def sliding(self, where: Flags | None) -> "Differenced":
        """The neighbours with prescribed flags (f, q) of sliding points."""
        if not self.has_friction:
            return self
        return replace(self, plus=self.plus.sliding(where), minus=self.minus.sliding(where))

    def after(self, state: State, change: State, slides: Flags | None) -> "Differenced":
        """The neighbours with slip updated to the equilibrium `state` with sliding points (f, q); `change`:
        its derivative."""
        if not self.has_friction:
            return self
        step, v = self.step * change.u, self.sliding(slides)
        return replace(self, plus=v.plus.after(state.u + step), minus=v.minus.after(state.u - step))

    def touch(self, base: Problem, state: State, change: State, slides: Flags | None) -> Array:
        """Derivative (3,) of the obstacle's force (`Problem.touch`) at the base's equilibrium with
        sliding points (f, q); `change`: the state's derivative."""
        v = self.sliding(slides)
        explicit = (v.plus.touch(state.u) - v.minus.touch(state.u)) / (2 * self.step)
        if base.plane is None:
            return explicit
        return explicit + base.plane.along(base.case.nodes + state.u, change.u)

    @cached_property
    def placed_alike(self) -> bool:
        """True if the neighbours differ in material constants and outside forces alone: then so do the
        residuals."""
        return bool(self.plus.placed_as(self.minus))

    @cached_property
    def rows(self) -> Integers:
        """Elements (k,) whose law differs, apart from memory."""
        return differing(self.plus.constants, self.minus.constants)

    @cached_property
    def history_only(self) -> bool:
        """True if the neighbours differ by the material's memory alone, which does not affect a curve."""
        a, b = self.plus, self.minus
        return (
            np.array_equal(a.dead, b.dead)
            and _same(a.growing, b.growing)
            and _same(a.constants.instant, b.constants.instant)
            and _same(_without_memory(a.case), _without_memory(b.case))
        )


def towards_memory(base: Problem, path: Path, varied: Differenced, paths: tuple[Path, Path]) -> bool:
    """True if two neighbours on their paths differ from a base without memory by their memory alone."""
    held = base.plane is not None or base.walls is not None
    if base.has_memory(path) or held or not base.kernel.symmetric:
        return False
    sides = varied.plus, varied.minus
    return (
        varied.history_only
        and any(q.has_memory(path) for q in sides)
        and all(
            _same(q.constants.instant, base.constants.instant)
            and np.array_equal(q.dead, base.dead)
            and (q.case is base.case or _same(_without_memory(q.case), _without_memory(base.case)))
            and (side_path is path or _same(side_path, path))
            for q, side_path in zip(sides, paths, strict=True)
        )
    )


@dataclass(frozen=True)
class Neighbours:
    """A parameter at one time: loads in MPa and memories of its two neighbouring problems, and their
    constitutive responses to the state where known."""

    varied: Differenced
    load: tuple[float, float]
    memory: tuple[Memory | None, Memory | None] = (None, None)
    answers: tuple[Response, Response] | None = None

    def residual(self, state: State) -> Residual:
        """Derivative of the residual at fixed displacement, pressure modes and clamp rotation."""
        v, (a, b) = self.varied, self.memory
        direct = self.answers is not None or (a is None and b is None)
        if not (v.placed_alike and direct):
            plus, minus = (
                imbalance(q, state, load, memory)
                for q, load, memory in zip((v.plus, v.minus), self.load, self.memory, strict=True)
            )
            return plus.minus(minus, 1 / (2 * v.step))
        kernel, apart = v.plus.kernel, self.load[0] - self.load[1]
        force = self._inner(state) - (v.plus.loaded(self.load[0]) - v.minus.loaded(self.load[1]))
        if apart:
            force -= apart * kernel.pressure.force(v.plus.case.nodes + state.u)
        force /= 2 * v.step
        soft = (1 / v.minus.constants.bulk - 1 / v.plus.constants.bulk) / (2 * v.step)
        gap = np.zeros_like(state.p)
        if soft.any():
            gap = soft[:, None] * np.einsum("ekl,el->ek", v.plus.geometry.mass, state.p)
        return Residual(force, gap, v.plus.clamp_gap(state.rotation, force))

    def _inner(self, state: State) -> Array:
        """Difference (n, 3) N of the neighbours' internal nodal forces, with their memories."""
        (a, b), (plus, minus) = self.memory, (self.varied.plus, self.varied.minus)
        if self.answers is not None:
            upper, lower = self.answers
            more = upper.stress if a is None else a.stress(upper)
            return plus.kernel.internal(state.u, more - (lower.stress if b is None else b.stress(lower)))
        rows = self.varied.rows
        if not len(rows):
            return np.zeros_like(state.u)
        more, less = (q.kernel.isochoric(state.u, q.constants, q.geometry, rows) for q in (plus, minus))
        return plus.kernel.internal(state.u, more - less, rows)

    def held(self, rotation: float) -> Array:
        """Derivative (n, 3) of held displacements: prescribed ones, and the clamp's nodes, whose rotation
        moves them by their positions."""
        out, v = np.zeros_like(self.varied.plus.dead), self.varied
        out.flat[v.plus.kernel.supported] = (v.plus.prescribed - v.minus.prescribed) / (2 * v.step)
        ahead, behind = (q.clamp_motion(rotation)[0] for q in (v.plus, v.minus))
        out[v.plus.kernel.clamped] = (ahead - behind) / (2 * v.step)
        return v.plus.kernel.followed(out)


def differing(a: ElementConstants, b: ElementConstants) -> Integers:
    """Elements (k,) whose stress without memory differs."""
    if a.table.shape != b.table.shape:
        return np.arange(len(a.table))
    return np.flatnonzero((a.table != b.table).any(axis=1))


def sensitivities(step: Corrected, state: State, neighbours: Sequence[Neighbours]) -> list[State]:
    """Derivatives of the state by parameters: direct differentiation with its tangent."""
    if not neighbours:
        return []
    neighbours = [replace(n, varied=n.varied.sliding(step.slides)) for n in neighbours]
    changes = step.solve([n.residual(state) for n in neighbours])
    for change, n in zip(changes, neighbours, strict=True):
        change.u[:] += n.held(state.rotation)
    return changes
