"""A case and a state (displacement, pressure modes) -> residual and condensed symmetric tangent.

Mixed Q2/P1disc form: four discontinuous pressure modes (1, x, y, z about the element's centre) per element,
eliminated element by element (Sussman & Bathe 1987, doi 10.1016/0045-7949(87)90265-3).
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fe import compiled
from fe.case import Case
from fe.compiled import PAIRS
from fe.element import Array, Integers, gauss, scatter, shape
from fe.linear import Symmetric
from fe.pressure import PressureFaces

THREADS = int(os.environ.get("OMP_NUM_THREADS") or os.cpu_count() or 1)
_POOL = ThreadPoolExecutor(THREADS)
_I, _J = (np.array(x) for x in zip(*PAIRS, strict=True))


@dataclass(frozen=True)
class Constants:
    """Material constants per element, (e,) MPa, and Prony pairs (m, e, 2) of g and tau s."""

    C10: Array
    C01: Array
    C20: Array
    bulk: Array
    prony: Array

    @staticmethod
    def of(case: Case) -> "Constants":
        """The constants of every element of a case."""
        terms = max(len(m.prony) for m in case.materials.values())
        prony = np.zeros((terms, len(case.connectivity), 2))
        prony[..., 1] = 1.0  # an absent term has g = 0
        for name, m in case.materials.items():
            for k, pair in enumerate(m.prony):
                prony[k, case.element_sets[name]] = pair
        C10, C01, C20, bulk = (case.per_element(k) for k in ("C10", "C01", "C20", "bulk"))
        return Constants(C10, C01, C20, bulk, prony)

    @cached_property
    def table(self) -> Array:
        """C10, C01, C20 of every element (e, 3), as `fe.compiled` wants them."""
        return np.stack([self.C10, self.C01, self.C20], axis=1)


@dataclass(frozen=True)
class Memory:
    """What a history material hands to one time step.

    scale (e,) multiplies the new isochoric stress; carried (e, q, 3, 3) MPa is the second Piola-Kirchhoff
    stress that does not depend on the new displacement.
    """

    scale: Array
    carried: Array


@dataclass(frozen=True)
class State:
    """Displacement u (n, 3) mm, pressure modes p (e, 4) MPa and the clamp's rotation in rad."""

    u: Array
    p: Array
    rotation: float = 0.0


class Geometry:
    """Quadrature data of undeformed positions (n, 3) mm: gradients, weights, pressure modes."""

    def __init__(self, nodes: Array, connectivity: Integers) -> None:
        xi, weight = gauss(3)
        N, dN = shape(xi)
        self.nodes = nodes
        X = nodes[connectivity]  # (e, 27, 3)
        jacobian = np.einsum("eai,qaJ->eqiJ", X, dN, optimize=True)
        self.weight = np.linalg.det(jacobian) * weight  # (e, q)
        # (e, q, I, a), as fe.compiled wants them
        self.G = np.ascontiguousarray(np.swapaxes(np.linalg.inv(jacobian), 2, 3) @ np.swapaxes(dN, 1, 2))
        size = np.ptp(X, axis=1).max(-1)[:, None, None]
        x = (np.einsum("qa,eai->eqi", N, X) - X.mean(axis=1, keepdims=True)) / size
        self.psi = np.concatenate([np.ones((*x.shape[:2], 1)), x], axis=-1)  # (e, q, 4)
        self.mass = np.einsum("eq,eqk,eql->ekl", self.weight, self.psi, self.psi)
        self._flexible = np.linalg.inv(self.mass)

    def compliance(self, bulk: Array) -> Array:
        """The pressure modes' answer (e, 4, 4) to volume gaps, at bulk moduli (e,) MPa."""
        return self._flexible * bulk[:, None, None]


@dataclass(frozen=True)
class Linearised:
    """Residual and tangent at one state.

    force (n, 3) N is the condensed residual; data (nnz,) the free upper triangle of its tangent; coupling
    (e, 81, 4) and compliance (e, 4, 4) give the pressure update; turning (n, 3) N is the tangent times the
    clamp's rigid rotation.
    """

    force: Array
    data: Array
    gap: Array
    coupling: Array
    compliance: Array
    turning: Array


class Kernel:
    """One mesh with its supports: the sparsity pattern, and residual and tangent at any state."""

    def __init__(self, case: Case) -> None:
        self.connectivity = case.connectivity
        self.dofs = len(case.nodes) * 3
        self.geometry = Geometry(case.nodes, self.connectivity)
        self.pressure = PressureFaces(
            case.face_nodes(case.pressurised) if case.pressurised else None, len(case.nodes)
        )
        held = np.zeros((len(case.nodes), 3), bool)
        for s in case.supports:
            held[np.ix_(case.node_sets[s.nodes], np.array(s.components))] = True
        self.clamped = case.node_sets[case.clamp.nodes] if case.clamp else np.empty(0, np.int64)
        held[self.clamped] = True
        self.free = np.flatnonzero(~held.ravel())
        self._element_dofs = (self.connectivity[:, :, None] * 3 + np.arange(3)).reshape(-1, 81)
        self._clamp_elements = np.flatnonzero(np.isin(self.connectivity, self.clamped).any(axis=1))

    @cached_property
    def _pattern(self) -> tuple[Integers, Integers, Integers, Integers]:
        """CSR pattern of the free upper triangle, and where element and face entries go (nnz means
        nowhere)."""
        n = len(self.free)
        number = np.full(self.dofs, -1, np.int64)
        number[self.free] = np.arange(n)
        e = number[self._element_dofs].reshape(-1, 27, 3)
        r, c = (
            e[:, :, _I][:, :, :, None],
            e.transpose(0, 2, 1)[:, _J][:, None],
        )  # (e, a, pair, 1), (e, 1, pair, b)
        r, c = np.broadcast_arrays(r, c)
        twice = (r > c) & (_I == _J)[:, None]  # diagonal blocks hold both (a, b) and (b, a)
        element = np.where((r < 0) | (c < 0) | twice, n * n, np.minimum(r, c) * n + np.maximum(r, c))
        f = number[self.pressure.dofs]
        r, c = np.broadcast_arrays(f[:, :, None], f[:, None, :])
        face = np.where((r < 0) | (c < 0) | (r > c), n * n, r * n + c)
        unique, place = np.unique(
            np.concatenate([element.ravel(), face.ravel(), [n * n]]), return_inverse=True
        )
        unique = unique[:-1]
        indptr = np.searchsorted(unique, np.arange(n + 1) * n).astype(np.int64)
        place = place.astype(np.int64, copy=False)
        return indptr, unique % n, place[: element.size], place[element.size : -1]

    @cached_property
    def matrix(self) -> Symmetric:
        """The solver for this pattern."""
        return Symmetric(*self._pattern[:2])

    def _each(self, work: Callable[[int, int], None]) -> None:
        """Run `work` on the elements first .. last, shared by all threads: compiled code lets go of the
        interpreter."""
        ends = np.linspace(0, len(self.connectivity), THREADS + 1).astype(int).tolist()
        if THREADS == 1:
            work(0, ends[-1])
        else:
            list(_POOL.map(work, ends[:-1], ends[1:]))

    def _remembered(self, memory: Memory | None) -> tuple[Array, Array]:
        """Scale (e,) and carried stress of a memory, or of none."""
        size = len(self.connectivity)
        if memory is None:
            return np.ones(size), np.zeros((1, 27, 3, 3))
        return np.ascontiguousarray(np.broadcast_to(memory.scale, (size,))), memory.carried

    def isochoric(self, u: Array, c: Constants, geometry: Geometry) -> Array:
        """Isochoric second Piola-Kirchhoff stress (e, q, 3, 3) MPa at displacements u (n, 3) mm."""
        out = np.empty((len(self.connectivity), 27, 3, 3))
        self._each(lambda a, b: compiled.isochoric(geometry.G, self.connectivity, u, c.table, a, b, out))
        return out

    def internal(self, u: Array, stress: Array) -> Array:
        """Nodal forces (n, 3) N of a second Piola-Kirchhoff stress (e, q, 3, 3) MPa at displacements u."""
        g, force = self.geometry, np.empty((len(self.connectivity), 27, 3))
        self._each(lambda a, b: compiled.internal(g.G, g.weight, self.connectivity, u, stress, a, b, force))
        return self.gather(force)

    def residual(
        self, state: State, c: Constants, load: float, memory: Memory | None, geometry: Geometry
    ) -> tuple[Array, Array]:
        """Nodal forces (n, 3) N, internal minus follower pressure `load` MPa, and volume gaps (e, 4) mm3."""
        g, force, gap = geometry, np.empty((len(self.connectivity), 27, 3)), np.empty_like(state.p)
        scale, carried = self._remembered(memory)
        self._each(
            lambda a, b: compiled.residual(
                g.G, g.weight, g.psi, self.connectivity, state.u, state.p, c.table, c.bulk, scale, carried,
                a, b, force, gap,
            )
        )  # fmt: skip
        return self.gather(force) - load * self.pressure.force(geometry.nodes + state.u), gap

    def linearise(
        self, state: State, c: Constants, load: float, memory: Memory | None, turn: Array
    ) -> Linearised:
        """Residual and tangent at a state; turn (k, 3) mm/rad is the clamp nodes' motion per rotation.

        Any J <= 0 gives NaN entries, which the caller treats as a failed step.
        """
        g, size = self.geometry, len(self.connectivity)
        force, gap = np.empty((size, 27, 3)), np.empty((size, 4))
        K, B = np.empty((size, 27, 6, 27)), np.empty((size, 27, 3, 4))
        compliance, (scale, carried) = g.compliance(c.bulk), self._remembered(memory)
        self._each(
            lambda a, b: compiled.linearise(
                g.G, g.weight, g.psi, self.connectivity, state.u, state.p, c.table, c.bulk, scale, carried,
                compliance, a, b, force, gap, K, B,
            )
        )  # fmt: skip
        x = g.nodes + state.u
        _, indices, element, face = self._pattern
        data = np.zeros(len(indices) + 1)
        compiled.scatter_add(element, K.ravel(), data)
        compiled.scatter_add(face, -load * self.pressure.tangent(x).ravel(), data)
        total = self.gather(force) - load * self.pressure.force(x)
        return Linearised(total, data[:-1], gap, B.reshape(size, 81, 4), compliance, self._turned(K, turn))

    def _turned(self, K: Array, turn: Array) -> Array:
        """The tangent times a rigid rotation of the clamp, (n, 3) N per rad."""
        motion = np.zeros((self.dofs // 3, 3))
        motion[self.clamped] = turn
        chosen = self._clamp_elements
        t = motion[self.connectivity[chosen]]  # (e, 27, 3)
        out = np.zeros((len(chosen), 27, 3))
        for n, (i, j) in enumerate(PAIRS):
            block = K[chosen, :, n]
            out[..., i] += np.einsum("eab,eb->ea", block, t[..., j])
            if i != j:
                out[..., j] += np.einsum("eab,ea->eb", block, t[..., i])
        return scatter(self._element_dofs[chosen], out, self.dofs).reshape(-1, 3)

    def gather(self, force: Array) -> Array:
        """Nodal forces (n, 3) N from element forces (e, 27, 3) N."""
        return scatter(self._element_dofs, force, self.dofs).reshape(-1, 3)
