"""Residual and condensed symmetric tangent of a case at a state (displacements, pressure modes).

Mixed form: pressure modes of each element are eliminated element by element (Sussman & Bathe 1987,
doi 10.1016/0045-7949(87)90265-3); those that belong to corners are unknowns of the system.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import scipy
import scipy.sparse as sp
from numpy.polynomial.legendre import legval

from fe.case import Case, digest
from fe.element import Array, Element, Flags, Integers, scatter
from fe.kernel import compiled
from fe.kernel.compiled import (
    Balance,
    Changes,
    FieldArrays,
    HistoryArrays,
    Law,
    MeshArrays,
    PointTangents,
    Tangent,
)
from fe.kernel.matrix import Pattern, Places, Symmetric
from fe.kernel.pressure import PressureFaces
from fe.kernel.systems import Reduced, Wider
from fe.kernel.tying import Dependence, dependence
from fe.material import scaled
from fe.terms import OGDEN, PAIRS

THREADS = int(os.environ.get("OMP_NUM_THREADS") or os.cpu_count() or 1)
_POOL = ThreadPoolExecutor(THREADS)
_T = TypeVar("_T")


@dataclass(frozen=True)
class ElementConstants:
    """Material constants per element.

    table: (e, k) as `Material.constants` gives them. shear, bulk: moduli (e,) MPa. prony: pairs (m, e, 2) of
    g and tau s. softening: Mullins' amount, m in MPa and beta (e, 3), or (0, 3) where no material softens.
    """

    table: Array
    shear: Array
    bulk: Array
    prony: Array
    softening: Array

    @staticmethod
    def of(case: Case) -> "ElementConstants":
        """The constants of every element of a case."""
        terms = max(len(m.prony) for m in case.materials.values())
        width = max(len(m.constants) for m in case.materials.values())
        prony, table = np.zeros((terms, len(case.connectivity), 2)), np.zeros((len(case.connectivity), width))
        prony[..., 1] = 1.0  # an absent term has g = 0
        table[:, OGDEN + 1 :: 2] = 1.0  # or mu = 0
        for name, m in case.materials.items():
            rows, constants = case.element_sets[name], m.constants
            table[rows, : len(constants)] = constants
            for k, pair in enumerate(m.prony):
                prony[k, rows] = pair
        softening = np.zeros((0, 3))
        if any(m.mullins for m in case.materials.values()):
            softening = np.tile([0.0, 1.0, 0.0], (len(table), 1))
            for name, m in case.materials.items():
                softening[case.element_sets[name]] = m.mullins or (0.0, 1.0, 0.0)
        return ElementConstants(table, case.per_element("shear"), case.per_element("bulk"), prony, softening)

    @property
    def instant(self) -> "ElementConstants":
        """The constants without memory: neither Prony terms nor softening."""
        return replace(self, prony=np.zeros((0, len(self.table), 2)), softening=np.zeros((0, 3)))

    def times(self, factor: float) -> "ElementConstants":
        """All moduli multiplied."""
        table = scaled(self.table, factor)
        return replace(self, table=table, shear=factor * self.shear, bulk=factor * self.bulk)

    @property
    def law(self) -> Law:
        """Constants and bulk moduli as the compiled loops take them."""
        return Law(self.table, self.bulk)


@dataclass(frozen=True)
class Response:
    """Constitutive response to displacements: isochoric second Piola-Kirchhoff stress (e, q, 3, 3) MPa, and
    energy (e, q) N mm/mm3 where softening needs it."""

    stress: Array
    energy: Array | None

    def moved(self, slope: "Response", factor: float) -> "Response":
        """The response extrapolated by `factor` along its derivative `slope`."""
        energy = None if self.energy is None or slope.energy is None else self.energy + factor * slope.energy
        return Response(self.stress + factor * slope.stress, energy)

    def times(self, factor: float) -> "Response":
        """The response with all moduli multiplied by `factor`."""
        return (
            self
            if factor == 1
            else Response(factor * self.stress, None if self.energy is None else factor * self.energy)
        )


@dataclass(frozen=True)
class Softening:
    """Mullins softening in one time step: table (e, 3) of amount, m in MPa, beta; the largest energy so far,
    peak (e, q) N mm/mm3; below (e, q): points on the unloading branch, or None to decide by their energy."""

    table: Array
    peak: Array
    below: Flags | None

    def drop(self, energy: Array) -> Array:
        """Reduction (e, q) of the stress scale, r (W) = amount erf((W_max - W) / (m + beta W_max)), at
        energies (e, q)."""
        amount, m, beta = self.table.T[:, :, None]
        below = energy < self.peak if self.below is None else self.below
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            x = (self.peak - energy) / (m + beta * self.peak)
        return np.where(below, amount * scipy.special.erf(np.where(below, x, 0.0)), 0.0)


@dataclass(frozen=True)
class Memory:
    """Input of a material with memory to one time step.

    scale (e,) multiplies the new isochoric stress, less the reduction by softening; history_stress (e, q, 3,
    3) MPa is the second Piola-Kirchhoff stress that does not depend on the new displacement.
    """

    scale: Array
    history_stress: Array
    softening: Softening | None = None

    def times(self, factor: float) -> "Memory":
        """The memory with all moduli multiplied by `factor`."""
        soft = self.softening
        if factor == 1:
            return self
        if soft is not None:
            soft = replace(soft, table=soft.table * [1.0, factor, 1.0], peak=factor * soft.peak)
        return Memory(self.scale, factor * self.history_stress, soft)

    def stress(self, response: Response) -> Array:
        """Isochoric second Piola-Kirchhoff stress (e, q, 3, 3) MPa, history included."""
        scale = self.scale[:, None]
        if self.softening is not None and response.energy is not None:
            scale = scale - self.softening.drop(response.energy)
        return np.asarray(scale[..., None, None] * response.stress + self.history_stress)


# The softening of none.
_HARD: tuple[Array, Array, Flags] = (np.zeros((0, 3)), np.zeros((0, 0)), np.zeros((0, 0), bool))


@dataclass(frozen=True)
class State:
    """Displacement u (n, 3) mm, pressure modes p (e, m) MPa of every element, the clamp's rotation in rad."""

    u: Array
    p: Array
    rotation: float = 0.0


class Geometry:
    """Quadrature data of undeformed positions (n, 3) mm: gradients, weights, pressure modes.

    precurvature: curvature, 1/mm, of the structure where it is free of stress, about y, towards -z. With it
    F = Fe Fg with the isochoric Fg = diag(l, l^-1/2, l^-1/2) and l = 1 + precurvature (z - z of the centroid)
    (Rodriguez, Hoger & McCulloch 1994, doi 10.1016/0021-9290(94)90021-3): gradients are those of Fe. Several
    numbers are those of Legendre's polynomials along x, from -1 to 1 over the structure.
    """

    def __init__(
        self,
        nodes: Array,
        connectivity: Integers,
        element: Element,
        precurvature: float | tuple[float, ...] = 0.0,
    ) -> None:
        N, dN = element.at_points
        self.nodes = nodes
        X = nodes[connectivity]  # (e, n, 3)
        jacobian = np.einsum("eai,qaJ->eqiJ", X, dN, optimize=True)
        # (e, q) in one order, as the compiled loops are made for
        self.weight = np.ascontiguousarray(np.linalg.det(jacobian) * element.weights)
        # (e, q, I, a), as the compiled loops want them
        self.G = np.ascontiguousarray(np.swapaxes(np.linalg.inv(jacobian), 2, 3) @ np.swapaxes(dN, 1, 2))
        size = np.ptp(X, axis=1).max(-1)[:, None, None]
        x = (np.einsum("qa,eai->eqi", N, X) - X.mean(axis=1, keepdims=True)) / size
        self.psi = element.pressure_modes(x)  # (e, q, m)
        self.mass = np.einsum("eq,eqk,eql->ekl", self.weight, self.psi, self.psi)
        # pressures of corners are not eliminated: no answer of one element's own
        self._flexible = np.zeros_like(self.mass) if element.shared else np.linalg.inv(self.mass)
        self.precurvature, self.rest = precurvature, np.empty((0, 0, 3, 3))
        if np.any(precurvature):
            self._curve(np.einsum("qa,eai->eqi", N, X))

    def _curve(self, place: Array) -> None:
        """Turn gradients into gradients of Fe, at positions (e, q, 3) mm of the quadrature points."""
        z, curvature = place[..., 2], np.asarray(self.precurvature)
        if curvature.ndim:
            low, high = self.nodes[:, 0].min(), self.nodes[:, 0].max()
            curvature = legval((2 * place[..., 0] - low - high) / (high - low), curvature)
        stretch = 1 + curvature * (z - (self.weight * z).sum() / self.weight.sum())
        inverse = np.stack([1 / stretch, np.sqrt(stretch), np.sqrt(stretch)], axis=-1)
        self.G *= inverse[..., None]
        self.rest = (inverse - 1)[..., None] * np.eye(3)

    def compliance(self, bulk: Array) -> Array:
        """Compliance (e, m, m) of the pressure modes: the change of the modes per volume gap, at bulk moduli
        (e,) MPa."""
        return self._flexible * bulk[:, None, None]


@dataclass(frozen=True, kw_only=True)
class Linearised:
    """Residual and tangent at one state.

    force (n, 3) N: condensed residual. data (nnz,): upper triangle of its tangent, free displacements first,
    then shared pressures. coupling (e, 3 n, m) and compliance (e, m, m): pressure update. turning (f,):
    tangent times the clamp's rigid rotation, for the unknowns; lever (n, 3) N: for the clamp nodes. border:
    degrees of freedom (g, k) and matrices (g, k, k) N/mm, the unsymmetric part of the tangent where the
    pressurised surface has open edges. wider: the pattern of the data where faces touch each other.
    """

    force: Array
    data: Array
    gap: Array
    coupling: Array
    compliance: Array
    turning: Array
    lever: Array
    border: tuple[Integers, Array] | None = None
    wider: Wider | None = None


class Kernel:
    """One mesh with its supports: the sparsity pattern, and residual and tangent at any state."""

    def __init__(self, case: Case) -> None:
        self.connectivity, self.element = case.connectivity, case.element
        self.dofs = len(case.nodes) * 3
        self.geometry = Geometry(case.nodes, self.connectivity, self.element, case.precurvature)
        self.modes = self.geometry.psi.shape[2]
        self.pressure = PressureFaces(
            case.face_nodes(case.pressurised) if case.pressurised else None, self.element, len(case.nodes),
            case.pressure_shares,
        )  # fmt: skip
        held, self.clamped = case.supported, case.clamped
        self.supported = np.flatnonzero(held)  # degrees of freedom
        held[self.clamped] = True
        self.free = np.flatnonzero(~held.ravel())
        self.dependence = dependence(case)
        self._open = self.pressure.open_edges(case.nodes, ~held.ravel())
        width = self.connectivity.shape[1]
        self._element_dofs = (self.connectivity[:, :, None] * 3 + np.arange(3)).reshape(-1, 3 * width)
        # numbers (e, m) of shared pressures, from 0
        corners = self.connectivity[:, : self.modes] if self.element.shared else np.empty((0, 0), np.int64)
        self._corner = np.unique(corners, return_inverse=True)[1].reshape(corners.shape)
        self.shared = int(self._corner.max(initial=-1)) + 1
        self._with_shares = dict[str, Kernel]()  # by shares of the pressure
        self._widened: tuple[str, Wider] | None = None  # the newest, by what meets
        self._clamp_faces = np.flatnonzero(np.isin(self.pressure.faces, self.clamped).any(axis=1))
        self._clamp_elements = np.flatnonzero(np.isin(self.connectivity, self.clamped).any(axis=1))

    def with_shares(self, shares: Array | None) -> "Kernel":
        """The kernel with shares (f,) of the pressure on its pressurised faces. Pattern and solver are common
        to all of them, so only one kernel may be used at a time."""
        key = digest(shares)
        if key not in self._with_shares:
            free = np.zeros(self.dofs, bool)
            free[self.free] = True
            _ = self._places, self.matrix  # made before the copy, so that it has them, too
            kernel = copy(self)
            kernel.pressure = PressureFaces(self.pressure.faces, self.element, self.dofs // 3, shares)
            kernel._open = kernel.pressure.open_edges(self.geometry.nodes, free)
            self._with_shares[key] = kernel
        return self._with_shares[key]

    @property
    def symmetric(self) -> bool:
        """True if the tangent is symmetric: the pressurised surface has no open edges."""
        return not len(self._open)

    @cached_property
    def _number(self) -> Integers:
        """The numbers (dofs,) of the free degrees of freedom among the unknowns; -1 where one is held."""
        number = np.full(self.dofs, -1, np.int64)
        number[self.free] = np.arange(len(self.free))
        return number

    @cached_property
    def _pattern(self) -> Pattern:
        """Pattern of the free displacements, followed by the shared pressures."""
        corners = len(self.free) + self._corner if self.shared else np.empty((len(self.connectivity), 0), int)
        unknowns = np.concatenate([self._number[self._element_dofs], corners], axis=1)
        return Pattern.of(unknowns, len(self.free) + self.shared)

    @cached_property
    def _places(self) -> tuple[Places, ...]:
        """Positions in the pattern of the entries of elements, pressurised faces and shared pressures."""
        pattern, e = self._pattern, self._number[self._element_dofs].reshape(*self.connectivity.shape, 3)
        stiffness = np.empty((*e.shape[:2], len(PAIRS), e.shape[1]), np.int32)
        for k, (i, j) in enumerate(PAIRS):
            stiffness[:, :, k] = pattern.places(e[..., i], e[..., j], mirrored=True)
        face = self._number[self.pressure.dofs]
        places = stiffness, pattern.places(face, face)
        if not self.shared:
            return places
        corners = len(self.free) + self._corner
        return *places, pattern.places(e.reshape(len(e), -1), corners), pattern.places(corners, corners)

    @cached_property
    def matrix(self) -> Symmetric | Reduced:
        """The solver for this pattern."""
        return self._solver(self._pattern)

    def _solver(self, pattern: Pattern) -> Symmetric | Reduced:
        """The solver for a pattern of all unknowns."""
        definite = not self.shared  # shared pressures have as many negative eigenvalues
        if self.dependence is None:
            return Symmetric(pattern.indptr, pattern.indices, definite=definite)
        return Reduced(pattern, self._followers(self.dependence), definite=definite)

    def begin(self) -> None:
        """Begin a solve, whose results do not depend on those before it, to the bit."""
        self.matrix.begin()
        for kernel in (self, *self._with_shares.values()):
            if kernel._widened is not None:
                kernel._widened[1].matrix.begin()

    def _followers(self, tied: Dependence) -> sp.csr_matrix:
        """Matrix (f, g) from the independent unknowns to all unknowns."""
        size, dependent = len(self.free) + self.shared, self._number[tied.dofs]
        independent = np.setdiff1d(np.arange(size), dependent)
        column = np.full(size, -1)
        column[independent] = np.arange(len(independent))
        entries = tied.weights.tocoo()
        master = self._number[entries.col]  # -1: held
        free = master >= 0
        rows = np.concatenate([independent, dependent[entries.row[free]]])
        columns = np.concatenate([column[independent], column[master[free]]])
        values = np.concatenate([np.ones(len(independent)), entries.data[free]])
        return sp.csr_matrix((values, (rows, columns)), shape=(size, len(independent)))

    def followed(self, u: Array) -> Array:
        """Displacements (n, 3) mm with dependent nodes updated."""
        return u if self.dependence is None else self.dependence.followed(u)

    def _each(self, work: Callable[[int, int], _T]) -> list[_T]:
        """Results of `work(first, last)` on ranges of elements, one range a thread; compiled code releases
        the interpreter lock."""
        ends = np.linspace(0, len(self.connectivity), THREADS + 1).astype(int).tolist()
        return [work(0, ends[-1])] if THREADS == 1 else list(_POOL.map(work, ends[:-1], ends[1:]))

    def _mesh(self, g: Geometry, rows: Integers | None = None) -> MeshArrays:
        """Arrays of a geometry for the compiled loops, for all elements or those in `rows`."""
        if rows is None:
            return MeshArrays(g.G, g.rest, g.weight, g.psi, self.connectivity)
        rest = g.rest[rows] if len(g.rest) else g.rest
        return MeshArrays(g.G[rows], rest, g.weight[rows], g.psi[rows], self.connectivity[rows])

    def _remembered(self, memory: Memory | None) -> HistoryArrays:
        """Arrays of a memory, or of none, for the compiled loops."""
        size = len(self.connectivity)
        if memory is None:
            return HistoryArrays(np.ones(size), np.zeros((1, self.geometry.G.shape[1], 3, 3)), *_HARD)
        # a copy that may be written, as without a memory: numba compiles anew for another kind of array
        soft, scale = memory.softening, np.full(size, memory.scale)
        if soft is None or not soft.table[:, 0].any():
            return HistoryArrays(scale, memory.history_stress, *_HARD)
        below = _HARD[2] if soft.below is None else soft.below
        return HistoryArrays(scale, memory.history_stress, soft.table, soft.peak, below)

    def masses(self, density: Array, geometry: Geometry) -> Array:
        """Consistent nodal masses (n,) tonne of elements of densities (e,) tonne/mm3."""
        N, _ = self.element.at_points
        return scatter(self.connectivity, (density[:, None] * geometry.weight) @ N, self.dofs // 3)

    def isochoric(
        self, u: Array, c: ElementConstants, geometry: Geometry, rows: Integers | None = None
    ) -> Array:
        """Isochoric second Piola-Kirchhoff stress (e, q, 3, 3) MPa at displacements u (n, 3) mm, of all
        elements or of those in rows."""
        mesh, table = self._mesh(geometry, rows), c.table if rows is None else c.table[rows]
        out = np.empty((*mesh.G.shape[:2], 3, 3))
        if rows is None:
            self._each(lambda a, b: compiled.isochoric(mesh, u, table, a, b, out))
        else:
            compiled.isochoric(mesh, u, table, 0, len(rows), out)
        return out

    def changes(
        self, u: Array, c: ElementConstants, geometry: Geometry, along: Sequence[Array], *, energy: bool
    ) -> list[Response]:
        """Directional derivatives of the constitutive response at displacements u (n, 3) mm, along each
        change (n, 3) mm."""
        if not along:
            return []
        mesh, du = self._mesh(geometry), np.stack(along)
        stress = np.empty((len(du), *geometry.G.shape[:2], 3, 3))
        work = np.empty(stress.shape[:3])
        self._each(lambda a, b: compiled.isochoric_changes(mesh, u, c.table, du, a, b, stress, work))
        return [Response(s, w if energy else None) for s, w in zip(stress, work, strict=True)]

    def energies(self, u: Array, c: ElementConstants, geometry: Geometry) -> Array:
        """Isochoric energy (e, q) N mm/mm3 at displacements u (n, 3) mm."""
        mesh, out = self._mesh(geometry), np.empty(geometry.G.shape[:2])
        self._each(lambda a, b: compiled.energies(mesh, u, c.table, a, b, out))
        return out

    def internal(self, u: Array, stress: Array, rows: Integers | None = None) -> Array:
        """Nodal forces (n, 3) N of a second Piola-Kirchhoff stress (e, q, 3, 3) MPa at displacements u (n, 3)
        mm, for all elements or those in `rows`."""
        mesh, dofs = self._mesh(self.geometry, rows), self._element_dofs
        force = np.empty((*mesh.connectivity.shape, 3))
        if rows is None:
            self._each(lambda a, b: compiled.internal(mesh, u, stress, a, b, force))
        else:
            dofs = dofs[rows]
            compiled.internal(mesh, u, stress, 0, len(rows), force)
        return scatter(dofs, force, self.dofs).reshape(-1, 3)

    def residual(
        self, state: State, c: ElementConstants, load: float, memory: Memory | None, geometry: Geometry
    ) -> tuple[Array, Array]:
        """Nodal forces (n, 3) N, internal minus follower pressure `load` MPa, and volume gaps (e, m) mm3."""
        mesh, fields, past = self._mesh(geometry), FieldArrays(state.u, state.p), self._remembered(memory)
        out = Balance(np.empty((*self.connectivity.shape, 3)), np.empty_like(state.p))
        self._each(lambda a, b: compiled.residual(mesh, c.law, fields, past, a, b, out))
        return self.gather(out.force) - load * self.pressure.force(geometry.nodes + state.u), out.gap

    def at_points(self, state: State, c: ElementConstants, memory: Memory | None) -> PointTangents:
        """The tangents of all points at a state, for `along`."""
        g, past, size = self.geometry, self._remembered(memory), self.geometry.weight.shape
        mesh, fields = self._mesh(g), FieldArrays(state.u, state.p)
        out = PointTangents(np.empty((*size, 6, 3, 3)), np.empty((*size, 3, 3)))
        self._each(lambda a, b: compiled.at_points(mesh, c.law, fields, past, a, b, out))
        return out

    def along(
        self, u: Array, bulk: Array, load: float, tangents: PointTangents, changes: Sequence[State]
    ) -> list[tuple[Array, Array]]:
        """Directional derivatives of `residual` at displacements u (n, 3) mm, with bulk moduli (e,) MPa and
        the clamp held: nodal forces (n, 3) N and volume gaps (e, m) mm3 for each change of the state."""
        mesh, dofs = self._mesh(self.geometry), self.pressure.dofs
        change = Changes(np.stack([s.u for s in changes]), np.stack([s.p for s in changes]))
        size = (*self.connectivity.shape, 3 * len(changes))
        out = Balance(np.empty(size), np.empty_like(change.p))
        self._each(lambda a, b: compiled.along(mesh, bulk, tangents, change, a, b, out))
        pressed, changes_of_balance = load * self.pressure.tangent(self.geometry.nodes + u), []
        for v, du in enumerate(change.u):
            face = (pressed @ du.ravel()[dofs][..., None])[..., 0]
            force = self.gather(out.force[..., 3 * v : 3 * v + 3])
            changes_of_balance.append((force - scatter(dofs, face, self.dofs).reshape(-1, 3), out.gap[v]))
        return changes_of_balance

    def linearise(
        self, state: State, c: ElementConstants, load: float, memory: Memory | None, turn: Array
    ) -> Linearised:
        """Residual and tangent at a state; turn (k, 3) mm/rad is the clamp nodes' motion per rotation.

        Any J <= 0 gives NaN entries, which the caller treats as a failed step.
        """
        g, (size, n), m = self.geometry, self.connectivity.shape, self.modes
        out, B = Balance(np.empty((size, n, 3)), np.empty((size, m))), np.empty((size, n, 3, m))
        blocks = np.empty((len(self._clamp_elements), n, len(PAIRS), n))
        slots = np.full(size, -1)
        slots[self._clamp_elements] = np.arange(len(blocks))
        mesh, fields, past = self._mesh(g), FieldArrays(state.u, state.p), self._remembered(memory)
        (stiffness, *places), compliance = self._places, g.compliance(c.bulk)

        def assembled(a: int, b: int) -> Array:
            data = np.zeros(len(self._pattern.indices) + 1)  # and one for what is nowhere
            to = Tangent(compliance, B, stiffness, data, slots, blocks)
            compiled.linearise(mesh, c.law, fields, past, a, b, out, to)
            return data

        data, *others = self._each(assembled)
        for partial in others:
            data += partial
        x = g.nodes + state.u
        parts = [-load * self.pressure.tangent(x)]
        if self.element.shared:
            parts += [B, -g.mass / c.bulk[:, None, None]]
        for place, values in zip(places, parts, strict=True):
            compiled.scatter_add(place.ravel(), values.ravel(), data)
        total = self.gather(out.force) - load * self.pressure.force(x)
        turning, lever = self._turned(blocks, B[self._clamp_elements], turn)
        if len(self._clamp_faces):
            turned = self._levered(self.pressure.dofs[self._clamp_faces], parts[0][self._clamp_faces], turn)
            turning[: len(self.free)] += turned.ravel()[self.free]
            lever += turned
        border = None
        if len(self._open):
            dofs, C = self.pressure.antisymmetric(x, self._open)
            border = dofs, -load * C
        coupling = B.reshape(size, 3 * n, m)
        return Linearised(
            force=total, data=data[:-1], gap=out.gap, coupling=coupling, compliance=compliance,
            turning=turning, lever=lever, border=border,
        )  # fmt: skip

    def with_turned_faces(self, system: Linearised, dofs: Integers, K: Array, turn: Array) -> Linearised:
        """The system plus symmetric matrices K (g, k, k) of faces at degrees of freedom (g, k), clamped ones
        included; turn (k, 3): motion of the clamp nodes per rotation."""
        turned, turning = self._levered(dofs, K, turn), system.turning.copy()
        turning[: len(self.free)] += turned.ravel()[self.free]
        pattern, rows = system.wider.pattern if system.wider else self._pattern, self._number[dofs]
        data = np.append(system.data, 0.0)  # and one for what is nowhere
        np.add.at(data, pattern.places(rows, rows), K)
        return replace(system, data=data[:-1], turning=turning, lever=system.lever + turned)

    def widened(self, system: Linearised, meeting: Integers) -> Linearised:
        """The system with room for entries between all degrees of freedom (g, k) of each group."""
        key = digest(meeting)
        if self._widened is None or self._widened[0] != key:
            self._widened = key, Wider.of(self._pattern, self._number[meeting], self._solver)
        wider = self._widened[1]
        return replace(system, data=wider.spread(system.data), wider=wider)

    def _levered(self, dofs: Integers, K: Array, turn: Array) -> Array:
        """Nodal forces (n, 3) N from matrices K (g, k, k) N/mm, at dofs (g, k), times a rigid rotation of the
        clamp."""
        motion = np.zeros((self.dofs // 3, 3))
        motion[self.clamped] = turn
        turned = (K @ motion.ravel()[dofs][..., None])[..., 0]
        return scatter(dofs, turned, self.dofs).reshape(-1, 3)

    def _turned(self, K: Array, B: Array, turn: Array) -> tuple[Array, Array]:
        """The tangent of the clamp's elements, blocks K (k, n, 6, n) and coupling B (k, n, 3, m), times a
        rigid rotation of the clamp: for the unknowns (f,) and for the nodes (n, 3)."""
        motion = np.zeros((self.dofs // 3, 3))
        motion[self.clamped] = turn
        chosen = self._clamp_elements
        t = motion[self.connectivity[chosen]]  # (e, n, 3)
        out = np.zeros_like(t)
        for k, (i, j) in enumerate(PAIRS):
            block = K[:, :, k]
            out[..., i] += np.einsum("eab,eb->ea", block, t[..., j])
            if i != j:
                out[..., j] += np.einsum("eab,ea->eb", block, t[..., i])
        lever = scatter(self._element_dofs[chosen], out, self.dofs)
        gap = np.einsum("eaik,eai->ek", B, t) if self.shared else np.empty((0, 0))
        corner = self._corner[chosen] if self.shared else np.empty((0, 0), np.int64)
        return np.concatenate([lever[self.free], scatter(corner, gap, self.shared)]), lever.reshape(-1, 3)

    def unknowns(self, force: Array, gap: Array | None) -> Array:
        """The right-hand side (f,) of nodal forces (n, 3) N and, where pressures are shared, gaps (e, m)."""
        rows = force.ravel()[self.free]
        if not self.shared or gap is None:
            return np.concatenate([rows, np.zeros(self.shared)])
        return np.concatenate([rows, scatter(self._corner, gap, self.shared)])

    def pressures(self, x: Array) -> Array:
        """The shared pressures (e, m) of every element in a solution (f,)."""
        return x[len(self.free) :][self._corner]

    def gather(self, force: Array) -> Array:
        """Nodal forces (n, 3) N from element forces (e, n, 3) N."""
        return scatter(self._element_dofs, force, self.dofs).reshape(-1, 3)
