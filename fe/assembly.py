"""A case and a state (displacement, pressure modes) -> residual and condensed symmetric tangent.

Mixed Q2/P1disc form: four discontinuous pressure modes (1, x, y, z about the element's centre) per element,
eliminated element by element (Sussman & Bathe 1987, doi 10.1016/0045-7949(87)90265-3). Work runs over chunks
of elements so that the arrays stay in the cache; each sum over quadrature points is one matrix product per
element.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fe.case import Case
from fe.element import Array, Integers, gauss, scatter, shape
from fe.linear import Symmetric
from fe.material import stress, tangent
from fe.pressure import PressureFaces

CHUNK = 32
THREADS = int(os.environ.get("OMP_NUM_THREADS") or os.cpu_count() or 1)
_POOL = ThreadPoolExecutor(THREADS)
PAIRS = (
    (0, 0),
    (1, 1),
    (2, 2),
    (0, 1),
    (0, 2),
    (1, 2),
)  # component blocks (i, j) of an element matrix, i <= j
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

    def at(self, part: slice) -> tuple[Array, Array, Array]:
        """C10, C01, C20 of the elements `part`, shaped to broadcast against quadrature points."""
        return self.C10[part, None], self.C01[part, None], self.C20[part, None]


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
        # (e, q, I, a): rows (q, I) of one element are contiguous, as the matrix products want them
        self.G = np.ascontiguousarray(np.swapaxes(np.linalg.inv(jacobian), 2, 3) @ np.swapaxes(dN, 1, 2))
        size = np.ptp(X, axis=1).max(-1)[:, None, None]
        x = (np.einsum("qa,eai->eqi", N, X) - X.mean(axis=1, keepdims=True)) / size
        self.psi = np.concatenate([np.ones((*x.shape[:2], 1)), x], axis=-1)  # (e, q, 4)
        self.mass = np.einsum("eq,eqk,eql->ekl", self.weight, self.psi, self.psi)


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

    def _each(self, work: Callable[[slice], None]) -> None:
        """Run `work` on every chunk of elements, on all threads: numpy lets go of the interpreter inside."""
        n = len(self.connectivity)
        parts = [slice(k, min(k + CHUNK, n)) for k in range(0, n, CHUNK)]
        for _ in _POOL.map(work, parts) if THREADS > 1 else map(work, parts):
            pass

    def gradients(self, u: Array, part: slice, geometry: Geometry) -> Array:
        """Deformation gradients (c, q, 3, 3) of the elements `part` at displacements u (n, 3) mm."""
        G = geometry.G[part]
        H = G.reshape(len(G), 81, 27) @ u[self.connectivity[part]]  # (c, (q, I), i)
        return np.swapaxes(H.reshape(len(G), 27, 3, 3), 2, 3) + np.eye(3)

    def isochoric(self, u: Array, c: Constants, geometry: Geometry) -> Array:
        """Isochoric second Piola-Kirchhoff stress (e, q, 3, 3) MPa at displacements u (n, 3) mm."""
        out = np.empty((len(self.connectivity), 27, 3, 3))

        def work(part: slice) -> None:
            P, a, _ = stress(self.gradients(u, part, geometry), *c.at(part))
            out[part] = np.swapaxes(a, -1, -2) @ P

        self._each(work)
        return out

    def residual(
        self, state: State, c: Constants, load: float, memory: Memory | None, geometry: Geometry
    ) -> tuple[Array, Array]:
        """Nodal forces (n, 3) N, internal minus follower pressure `load` MPa, and volume gaps (e, 4) mm3."""
        force, gap = np.empty((len(self.connectivity), 27, 3)), np.empty_like(state.p)

        def work(part: slice) -> None:
            F = self.gradients(state.u, part, geometry)
            P, a, J = stress(F, *c.at(part))
            q = (geometry.psi[part] @ state.p[part, :, None])[..., 0]
            P = _total(P, F, a, J * q, memory, part)
            force[part], gap[part] = _integrate(geometry, part, P, J, q, c.bulk)

        self._each(work)
        return self.gather(force) - load * self.pressure.force(geometry.nodes + state.u), gap

    def internal(self, u: Array, stress: Array) -> Array:
        """Nodal forces (n, 3) N of a second Piola-Kirchhoff stress (e, q, 3, 3) MPa at displacements u."""
        g, force = self.geometry, np.empty((len(self.connectivity), 27, 3))

        def work(part: slice) -> None:
            force[part] = _forces(g, part, self.gradients(u, part, g) @ stress[part])

        self._each(work)
        return self.gather(force)

    def linearise(
        self, state: State, c: Constants, load: float, memory: Memory | None, turn: Array
    ) -> Linearised:
        """Residual and tangent at a state; turn (k, 3) mm/rad is the clamp nodes' motion per rotation.

        Any J <= 0 gives NaN entries, which the caller treats as a failed step.
        """
        g, size = self.geometry, len(self.connectivity)
        force, gap = np.empty((size, 27, 3)), np.empty((size, 4))
        K, B = np.empty((size, 27, 6, 27)), np.empty((size, 27, 3, 4))

        def work(part: slice) -> None:
            F = self.gradients(state.u, part, g)
            q = (g.psi[part] @ state.p[part, :, None])[..., 0]
            scale = np.ones_like(q) if memory is None else np.broadcast_to(memory.scale[part, None], q.shape)
            P, a, J, A = tangent(F, q, scale, *c.at(part))
            P = _total(P, F, a, J * q, memory, part)
            if memory is not None:
                for i in range(3):
                    A[..., i, :, i, :] += memory.carried[part]
            force[part], gap[part] = _integrate(g, part, P, J, q, c.bulk)
            K[part], B[part] = _element_matrices(g, part, A, a * J[..., None, None])

        self._each(work)
        compliance = np.linalg.inv(g.mass / c.bulk[:, None, None])
        self._condense(K, B, compliance)
        coupling = B.reshape(size, 81, 4)
        force += (coupling @ (compliance @ gap[..., None])).reshape(size, 27, 3)
        x = g.nodes + state.u
        _, _, element, face = self._pattern
        nnz = len(self._pattern[1])
        data = scatter(element, K, nnz + 1)
        data -= load * scatter(face, self.pressure.tangent(x), nnz + 1)
        total = self.gather(force) - load * self.pressure.force(x)
        return Linearised(total, data[:nnz], gap, coupling, compliance, self._turned(K, turn))

    @staticmethod
    def _condense(K: Array, B: Array, compliance: Array) -> None:
        weighted = (B.reshape(len(B), 81, 4) @ compliance).reshape(B.shape)
        for n, (i, j) in enumerate(PAIRS):
            K[:, :, n] += weighted[:, :, i] @ np.swapaxes(B[:, :, j], 1, 2)

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


def _total(P: Array, F: Array, a: Array, pressure: Array, memory: Memory | None, part: slice) -> Array:
    """First Piola-Kirchhoff stress: isochoric, carried over from earlier times, and volumetric."""
    if memory is not None:
        P = P * memory.scale[part, None, None, None] + F @ memory.carried[part]
    return P + pressure[..., None, None] * a


def _integrate(g: Geometry, part: slice, P: Array, J: Array, q: Array, bulk: Array) -> tuple[Array, Array]:
    gap = (J - 1 - q / bulk[part, None]) * g.weight[part]
    return _forces(g, part, P), (gap[:, None] @ g.psi[part])[:, 0]


def _forces(g: Geometry, part: slice, P: Array) -> Array:
    """Element forces (c, 27, 3) N of a first Piola-Kirchhoff stress (c, q, 3, 3) MPa."""
    w = g.weight[part]
    flux = np.swapaxes(P * w[..., None, None], 2, 3).reshape(len(w), 81, 3)  # ((q, I), i)
    return np.swapaxes(g.G[part].reshape(len(w), 81, 27), 1, 2) @ flux


def _element_matrices(g: Geometry, part: slice, A: Array, cofactor: Array) -> tuple[Array, Array]:
    """Blocks (c, a, pair, b) of the displacement tangent and the pressure coupling (c, a, i, k)."""
    G, w = g.G[part], g.weight[part]
    n = len(w)
    Aw = A[:, :, _I, :, _J, :] * w[:, :, None, None]  # advanced indices first: (pair, c, q, I, J)
    Aw = np.ascontiguousarray(Aw.transpose(1, 2, 3, 0, 4)).reshape(n, 27, 18, 3)
    T = (Aw @ G).reshape(n, 81, 162)
    Gt = np.swapaxes(G.reshape(n, 81, 27), 1, 2)
    K = (Gt @ T).reshape(n, 27, 6, 27)
    spread = np.swapaxes(cofactor * w[..., None, None], 2, 3)[..., None] * g.psi[part][:, :, None, None, :]
    return K, (Gt @ spread.reshape(n, 81, 12)).reshape(n, 27, 3, 4)
