"""Element loops over quadrature points, compiled to machine code by numba, one element after the other.

Arrays of a mesh with e elements of n nodes, q quadrature points and m pressure modes: gradients G
(e, q, 3, n) per mm, weights w (e, q) mm3, modes psi (e, q, m), connectivity (e, n), constants c (e, 3) C10,
C01, C20 in MPa. Loops run over the elements first .. last. The formulas are those of `fe.material`.
"""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from fe.element import Array, Integers

# Component blocks (i, j) of an element matrix, i <= j.
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

# Sums may be reordered; NaN stays NaN, as it marks a cell turned inside out.
_compiled: Callable[[Any], Any] = numba.njit(
    cache=True, nogil=True, fastmath={"contract", "reassoc"}, error_model="numpy"
)


@_compiled
def _deformation(G: Array, u: Array, F: Array) -> None:
    """F (3, 3) at one point from its gradients (3, n) and the element's displacements (3, n)."""
    for i in range(3):
        for k in range(3):
            value = 0.0
            for a in range(G.shape[1]):
                value += u[i, a] * G[k, a]
            F[i, k] = value + (1.0 if i == k else 0.0)


@_compiled
def _invariants(F: Array, C: Array, a: Array) -> tuple[float, float, float]:
    """J, tr C and (tr(C)^2 - tr(C^2)) / 2; fills C = F^T F and a = F^-T. NaN where J <= 0."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for p in range(3):
            m, n = (p + 1) % 3, (p + 2) % 3
            a[i, p] = F[j, m] * F[k, n] - F[j, n] * F[k, m]
    J = F[0, 0] * a[0, 0] + F[0, 1] * a[0, 1] + F[0, 2] * a[0, 2]
    if not J > 0.0:
        J = np.nan
    I1, square = 0.0, 0.0
    for i in range(3):
        for p in range(3):
            a[i, p] /= J
            C[i, p] = F[0, i] * F[0, p] + F[1, i] * F[1, p] + F[2, i] * F[2, p]
            square += C[i, p] * C[i, p]
        I1 += C[i, i]
    return J, I1, 0.5 * (I1 * I1 - square)


@_compiled
def _stress(
    F: Array, C: Array, a: Array, J: float, I1: float, I2: float, c: Array, g: Array, m: Array, P: Array
) -> tuple[float, float, float, float]:
    """W1, W11 = dW1/dI1 and J^(-2/3), J^(-4/3); fills P isochoric, g = dI2/dF and m = d(J^(-2/3) I1)/dF."""
    j1 = J ** (-2.0 / 3.0)
    j2 = j1 * j1
    W1 = c[0] + 2.0 * c[2] * (j1 * I1 - 3.0)
    for i in range(3):
        for k in range(3):
            FC = F[i, 0] * C[0, k] + F[i, 1] * C[1, k] + F[i, 2] * C[2, k]
            g[i, k] = 2.0 * (I1 * F[i, k] - FC)
            m[i, k] = j1 * (2.0 * F[i, k] - 2.0 / 3.0 * I1 * a[i, k])
            P[i, k] = W1 * m[i, k] + c[1] * j2 * (g[i, k] - 4.0 / 3.0 * I2 * a[i, k])
    return W1, 2.0 * c[2], j1, j2


@_compiled
def _tangent(
    F: Array, C: Array, a: Array, g: Array, m: Array, I1: float, I2: float,
    w1: float, w2: float, w11: float, pJ: float, A: Array,
) -> None:  # fmt: skip
    """A (6, 3, 3): d(scale P + p J F^-T)_iI / dF_jJ of the PAIRS (i, j); w = scale (W1 j1, W2 j2, W11)."""
    aa = 4.0 / 9.0 * w1 * I1 + 16.0 / 9.0 * w2 * I2 + pJ
    cross = 2.0 / 3.0 * w1 * I1 + 4.0 / 3.0 * w2 * I2 - pJ
    for n in range(6):
        i, j = PAIRS[n]
        left = -2.0 * w2 * (F[i, 0] * F[j, 0] + F[i, 1] * F[j, 1] + F[i, 2] * F[j, 2])
        for p in range(3):
            for q in range(3):
                value = 4.0 * w2 * F[i, p] * F[j, q] - 2.0 * w2 * F[i, q] * F[j, p]
                value += aa * a[i, p] * a[j, q] + cross * a[i, q] * a[j, p]
                value -= 4.0 / 3.0 * w1 * (F[i, p] * a[j, q] + a[i, p] * F[j, q])
                value -= 4.0 / 3.0 * w2 * (a[i, p] * g[j, q] + g[i, p] * a[j, q])
                value += w11 * m[i, p] * m[j, q]
                if i == j:
                    value -= 2.0 * w2 * C[p, q]
                if p == q:
                    value += left
                    if i == j:
                        value += 2.0 * w1 + 2.0 * w2 * I1
                A[n, p, q] = value


@_compiled
def _gathered(u: Array, nodes: Integers, out: Array) -> None:
    for a in range(len(nodes)):
        for i in range(3):
            out[i, a] = u[nodes[a], i]


@_compiled
def _total(P: Array, F: Array, a: Array, pressure: float, scale: float, S: Array) -> None:
    """P becomes scale P + F S + pressure a."""
    for i in range(3):
        for k in range(3):
            FS = F[i, 0] * S[0, k] + F[i, 1] * S[1, k] + F[i, 2] * S[2, k]
            P[i, k] = scale * P[i, k] + FS + pressure * a[i, k]


@_compiled
def isochoric(
    G: Array, connectivity: Integers, u: Array, c: Array, first: int, last: int, S: Array
) -> None:
    """Isochoric second Piola-Kirchhoff stress S (e, q, 3, 3) MPa at displacements u (n, 3) mm."""
    ue, work = np.empty((3, connectivity.shape[1])), np.empty((6, 3, 3))
    F, C, a, g, m, P = work[0], work[1], work[2], work[3], work[4], work[5]
    for e in range(first, last):
        _gathered(u, connectivity[e], ue)
        for q in range(G.shape[1]):
            _deformation(G[e, q], ue, F)
            J, I1, I2 = _invariants(F, C, a)
            _stress(F, C, a, J, I1, I2, c[e], g, m, P)
            for i in range(3):
                for k in range(3):
                    S[e, q, i, k] = a[0, i] * P[0, k] + a[1, i] * P[1, k] + a[2, i] * P[2, k]


@_compiled
def internal(
    G: Array, w: Array, connectivity: Integers, u: Array, S: Array, first: int, last: int, force: Array
) -> None:
    """Element forces (e, n, 3) N of a second Piola-Kirchhoff stress S (e, q, 3, 3) MPa."""
    points, n = G.shape[1], connectivity.shape[1]
    ue, F, flux = np.empty((3, n)), np.empty((3, 3)), np.empty((points, 3, 3))
    for e in range(first, last):
        _gathered(u, connectivity[e], ue)
        for q in range(points):
            _deformation(G[e, q], ue, F)
            for i in range(3):
                for k in range(3):
                    FS = F[i, 0] * S[e, q, 0, k] + F[i, 1] * S[e, q, 1, k] + F[i, 2] * S[e, q, 2, k]
                    flux[q, k, i] = w[e, q] * FS
        np.dot(G[e].reshape(3 * points, n).T, flux.reshape(3 * points, 3), force[e])


@_compiled
def residual(
    G: Array, w: Array, psi: Array, connectivity: Integers, u: Array, p: Array, c: Array, bulk: Array,
    scale: Array, carried: Array, first: int, last: int, force: Array, gap: Array,
) -> None:  # fmt: skip
    """Element forces (e, n, 3) N and volume gaps (e, m) mm3; scale (e,) and carried (e or 1, q, 3, 3) MPa are
    a history's."""
    points, n = G.shape[1], connectivity.shape[1]
    ue, work, flux = np.empty((3, n)), np.empty((6, 3, 3)), np.empty((points, 3, 3))
    F, C, a, g, m, P = work[0], work[1], work[2], work[3], work[4], work[5]
    for e in range(first, last):
        _gathered(u, connectivity[e], ue)
        gap[e] = 0.0
        for q in range(points):
            _deformation(G[e, q], ue, F)
            J, I1, I2 = _invariants(F, C, a)
            _stress(F, C, a, J, I1, I2, c[e], g, m, P)
            pressure = 0.0
            for k in range(psi.shape[2]):
                pressure += psi[e, q, k] * p[e, k]
            _total(P, F, a, J * pressure, scale[e], carried[e % len(carried), q])
            for k in range(psi.shape[2]):
                gap[e, k] += w[e, q] * (J - 1.0 - pressure / bulk[e]) * psi[e, q, k]
            for i in range(3):
                for k in range(3):
                    flux[q, k, i] = w[e, q] * P[i, k]
        np.dot(G[e].reshape(3 * points, n).T, flux.reshape(3 * points, 3), force[e])


@_compiled
def linearise(
    G: Array, w: Array, psi: Array, connectivity: Integers, u: Array, p: Array, c: Array, bulk: Array,
    scale: Array, carried: Array, compliance: Array, first: int, last: int,
    force: Array, gap: Array, K: Array, B: Array,
) -> None:  # fmt: skip
    """As `residual`, with the pressure eliminated by its compliance (e, m, m): condensed forces, the blocks
    K (e, n, 6, n) of the tangent's PAIRS, and the coupling B (e, n, 3, m)."""
    points, n, modes = G.shape[1], connectivity.shape[1], psi.shape[2]
    ue, work, A = np.empty((3, n)), np.empty((6, 3, 3)), np.empty((6, 3, 3))
    F, C, a, g, m, P = work[0], work[1], work[2], work[3], work[4], work[5]
    flux, spread = np.empty((points, 3, 3)), np.empty((points, 3, 3, modes))
    T, rows, eliminated = np.empty((points, 3, 6, n)), np.empty((3, modes, n)), np.empty(modes)
    for e in range(first, last):
        _gathered(u, connectivity[e], ue)
        gap[e] = 0.0
        S = carried[e % len(carried)]
        for q in range(points):
            _deformation(G[e, q], ue, F)
            J, I1, I2 = _invariants(F, C, a)
            W1, W11, j1, j2 = _stress(F, C, a, J, I1, I2, c[e], g, m, P)
            pressure = 0.0
            for k in range(modes):
                pressure += psi[e, q, k] * p[e, k]
            s = scale[e]
            _tangent(F, C, a, g, m, I1, I2, s * W1 * j1, s * c[e, 1] * j2, s * W11, J * pressure, A)
            _total(P, F, a, J * pressure, s, S[q])
            for k in range(modes):
                gap[e, k] += w[e, q] * (J - 1.0 - pressure / bulk[e]) * psi[e, q, k]
            for i in range(3):
                for k in range(3):
                    flux[q, k, i] = w[e, q] * P[i, k]
                    for r in range(modes):
                        spread[q, k, i, r] = w[e, q] * J * a[i, k] * psi[e, q, r]
            for k in range(3):
                for pair in range(6):
                    t = w[e, q] * A[pair, k]
                    if pair < 3:  # the same component on both sides: what is carried adds to the stiffness
                        t += w[e, q] * S[q, k]
                    for b in range(n):
                        T[q, k, pair, b] = t[0] * G[e, q, 0, b] + t[1] * G[e, q, 1, b] + t[2] * G[e, q, 2, b]
        Gt = G[e].reshape(3 * points, n).T
        np.dot(Gt, flux.reshape(3 * points, 3), force[e])
        np.dot(Gt, T.reshape(3 * points, 6 * n), K[e].reshape(n, 6 * n))
        np.dot(Gt, spread.reshape(3 * points, 3 * modes), B[e].reshape(n, 3 * modes))
        for r in range(modes):
            eliminated[r] = 0.0
            for k in range(modes):
                eliminated[r] += compliance[e, r, k] * gap[e, k]
        for b in range(n):
            for j in range(3):
                for r in range(modes):
                    rows[j, r, b] = B[e, b, j, r]
                    force[e, b, j] += B[e, b, j, r] * eliminated[r]
        for d in range(n):
            for pair in range(6):
                i, j = PAIRS[pair]
                for r in range(modes):
                    value = 0.0
                    for k in range(modes):
                        value += B[e, d, i, k] * compliance[e, k, r]
                    for b in range(n):
                        K[e, d, pair, b] += value * rows[j, r, b]


@_compiled
def stresses(F: Array, c: Array, P: Array, a: Array, J: Array) -> None:
    """Fills P_iso, F^-T (k, 3, 3) and J (k,) at F (k, 3, 3) with constants c (k, 3)."""
    C, g, m = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for k in range(len(F)):
        J[k], I1, I2 = _invariants(F[k], C, a[k])
        _stress(F[k], C, a[k], J[k], I1, I2, c[k], g, m, P[k])


@_compiled
def tangents(F: Array, c: Array, A: Array) -> None:
    """Fills A (k, 6, 3, 3) at F (k, 3, 3), with C10, C01, C20, scale and pressure in c (k, 5)."""
    work = np.empty((5, 3, 3))
    C, a, g, m, P = work[0], work[1], work[2], work[3], work[4]
    for k in range(len(F)):
        J, I1, I2 = _invariants(F[k], C, a)
        W1, W11, j1, j2 = _stress(F[k], C, a, J, I1, I2, c[k], g, m, P)
        s = c[k, 3]
        _tangent(F[k], C, a, g, m, I1, I2, s * W1 * j1, s * c[k, 1] * j2, s * W11, J * c[k, 4], A[k])


@_compiled
def scatter_add(place: Integers, values: Array, out: Array) -> None:
    """out[place] += values, both flat."""
    for k in range(len(values)):
        out[place[k]] += values[k]
