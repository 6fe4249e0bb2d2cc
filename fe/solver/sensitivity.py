"""Derivatives to parameters: a parameter is the test on either side of the present one, and the equilibrium
answers to the difference of their residuals by the tangent that it has (direct differentiation).

The two sides are solved nowhere; they share the base's mesh and held nodes. What they may change besides is
carried whole: positions, materials, prescribed displacements, clamp, forces dead and growing, layer, plane,
self-contact, precurvature, pressure, shares of a path, drift of the moduli, gravity, pulls.
`refused` names what they may not.
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
    """A parameter's direction: the test on either side of the present one, `step` of the parameter apart."""

    plus: tuple[Case, Path]
    minus: tuple[Case, Path]
    step: float


def refused(case: Case, path: Path, variations: Sequence[Variation]) -> None:
    """Nothing, or ValueError that names what of a case or a path a variation changes, and whose derivative is
    not computed."""
    for v in variations:
        for other, way in (v.plus, v.minus):
            found = _unsupported_change(case, other) or _unsupported_path_change(path, way)
            if found:
                raise ValueError(
                    f"a variation changes {found}: that derivative is not computed; keep it as it is in the "
                    "base, or solve both sides and take their difference"
                )


def _unsupported_change(base: Case, side: Case) -> str:
    """What of a case differs that the derivative does not carry, or nothing."""
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
    """What of a path differs that the derivative does not carry, or nothing."""
    if not _same(side.time, base.time):
        return "`time`, when the pressure is given"
    if not _same(side.output, base.output):
        return "`output`, the output times"
    if not _same(side.places, base.places):
        return "`places`, where forces pull"
    if side.chambers != base.chambers:
        return "`chambers`, the surfaces that carry shares of the pressure"
    return "" if _same(side.turns, base.turns) else "`gravity`, `pulls` or `shares`, when they change"


def _loaded_faces(case: Case) -> Integers | None:
    return case.face_nodes(case.pressurised) if case.pressurised else None


def _touching(case: Case) -> Integers:
    surface = case.contact.surface if case.contact else ""
    return case.face_nodes(surface)[off_the_clamp(case, surface)]


def _without_memory(case: Case) -> Case:
    return replace(case, materials={name: m.instant for name, m in case.materials.items()})


def _same(a: object, b: object) -> bool:
    """Whether two values are equal throughout: arrays, records, mappings and tuples of them."""
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
    """A parameter seen by its two neighbouring problems, `step` apart on either side: `plus` and `minus`."""

    plus: Problem
    minus: Problem
    step: float

    @property
    def rubs(self) -> bool:
        """Whether there is friction in either."""
        return self.plus.rubs or self.minus.rubs

    def remembers(self, plus: Path, minus: Path) -> bool:
        """Whether the material of either may answer by other than a function of pressure over the moduli."""
        return self.plus.remembers(plus) or self.minus.remembers(minus)

    def sliding(self, where: Flags | None) -> "Differenced":
        """The neighbours, sliding there (f, q) and nowhere else."""
        if not self.rubs:
            return self
        return replace(self, plus=self.plus.sliding(where), minus=self.minus.sliding(where))

    def after(self, state: State, change: State, slides: Flags | None) -> "Differenced":
        """The neighbours as they go on from the equilibrium `state`, which slides there (f, q), and of which
        `change` is the derivative."""
        if not self.rubs:
            return self
        step, v = self.step * change.u, self.sliding(slides)
        return replace(self, plus=v.plus.after(state.u + step), minus=v.minus.after(state.u - step))

    def touch(self, base: Problem, state: State, change: State, slides: Flags | None) -> Array:
        """The derivative (6,) of the obstacle's force and moment (`Problem.touch`) at the base's equilibrium,
        which slides there (f, q), and of which `change` is the derivative."""
        v = self.sliding(slides)
        own = (v.plus.touch(state.u) - v.minus.touch(state.u)) / (2 * self.step)
        return own if base.plane is None else own + base.plane.along(base.case.nodes + state.u, change.u)

    @cached_property
    def placed_alike(self) -> bool:
        """Whether nothing differs but constants of materials and outside forces: then so do the residuals."""
        return bool(self.plus.placed_as(self.minus))

    @cached_property
    def rows(self) -> Integers:
        """The elements (k,) whose law without memory differs."""
        return differing(self.plus.constants, self.minus.constants)

    @cached_property
    def history_only(self) -> bool:
        """Whether nothing differs but the memory of the material, of which a curve knows nothing."""
        a, b = self.plus, self.minus
        return (
            np.array_equal(a.dead, b.dead)
            and _same(a.growing, b.growing)
            and _same(a.constants.instant, b.constants.instant)
            and _same(_without_memory(a.case), _without_memory(b.case))
        )


def towards_memory(base: Problem, path: Path, varied: Differenced, paths: tuple[Path, Path]) -> bool:
    """Whether two neighbours on their paths differ from a base that has no memory by theirs alone."""
    held = base.plane is not None or base.walls is not None
    if base.remembers(path) or held or not base.kernel.symmetric:
        return False
    sides = varied.plus, varied.minus
    return (
        varied.history_only
        and any(q.remembers(path) for q in sides)
        and all(
            _same(q.constants.instant, base.constants.instant)
            and np.array_equal(q.dead, base.dead)
            and (q.case is base.case or _same(_without_memory(q.case), _without_memory(base.case)))
            and (way is path or _same(way, path))
            for q, way in zip(sides, paths, strict=True)
        )
    )


@dataclass(frozen=True)
class Neighbours:
    """A varied parameter at one time: the loads in MPa and the memories of its two neighbouring problems, and
    where they are known their laws' answers to the state."""

    varied: Differenced
    load: tuple[float, float]
    memory: tuple[Memory | None, Memory | None] = (None, None)
    answers: tuple[Response, Response] | None = None

    def residual(self, state: State) -> Residual:
        """The residuals' derivative at fixed displacement, pressure modes and clamp rotation."""
        v, (a, b) = self.varied, self.memory
        known = self.answers is not None or (a is None and b is None)
        if not (v.placed_alike and known):
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
        """The difference (n, 3) N of the two laws' nodal forces, with their memories."""
        (a, b), (plus, minus) = self.memory, (self.varied.plus, self.varied.minus)
        if self.answers is not None:
            one, other = self.answers
            more = one.stress if a is None else a.stress(one)
            return plus.kernel.internal(state.u, more - (other.stress if b is None else b.stress(other)))
        rows = self.varied.rows
        if not len(rows):
            return np.zeros_like(state.u)
        more, less = (q.kernel.isochoric(state.u, q.constants, q.geometry, rows) for q in (plus, minus))
        return plus.kernel.internal(state.u, more - less, rows)

    def held(self, rotation: float) -> Array:
        """The derivative (n, 3) of what is not free to move: prescribed displacements, and the clamp's nodes,
        which turn differently where they lie elsewhere."""
        out, v = np.zeros_like(self.varied.plus.dead), self.varied
        out.flat[v.plus.kernel.supported] = (v.plus.prescribed - v.minus.prescribed) / (2 * v.step)
        ahead, behind = (q.clamp_motion(rotation)[0] for q in (v.plus, v.minus))
        out[v.plus.kernel.clamped] = (ahead - behind) / (2 * v.step)
        return v.plus.kernel.followed(out)


def differing(a: ElementConstants, b: ElementConstants) -> Integers:
    """The elements (k,) whose stress without memory differs."""
    if a.table.shape != b.table.shape:
        return np.arange(len(a.table))
    return np.flatnonzero((a.table != b.table).any(axis=1))


def sensitivities(step: Corrected, state: State, neighbours: Sequence[Neighbours]) -> list[State]:
    """The derivatives of the state to parameters, by direct differentiation with its tangent."""
    if not neighbours:
        return []
    neighbours = [replace(n, varied=n.varied.sliding(step.slides)) for n in neighbours]
    changes = step.solve([n.residual(state) for n in neighbours])
    for change, n in zip(changes, neighbours, strict=True):
        change.u[:] += n.held(state.rotation)
    return changes
