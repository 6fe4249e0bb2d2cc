"""Element loops over quadrature points, compiled to machine code by numba, one element after the other.

Arrays of a mesh with e elements of n nodes, q quadrature points and m pressure modes: gradients G
(e, q, 3, n) per mm, rest (e, q, 3, 3) where it is not free of stress as it is meshed, or empty, weights w
(e, q) mm3, modes psi (e, q, m), connectivity (e, n), constants c (e, k) of `Material.constants`. Loops run
over the elements first .. last. The formulas are those of `fe.laws`.
"""

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from fe.element import Array, Flags, Integers

# Component blocks (i, j) of an element matrix, i <= j.
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

# Sums may be reordered; NaN stays NaN, as it marks a cell turned inside out.
_compiled: Callable[[Any], Any] = numba.njit(
    cache=True, nogil=True, fastmath={"contract", "reassoc"}, error_model="numpy"
)


@_compiled
def _deformation(G: Array, u: Array, rest: Array, e: int, q: int, F: Array) -> None:
    """F (3, 3) at one point from its gradients (3, n) and the element's displacements (3, n); rest
    (e, q, 3, 3) is what it is without displacements, beyond 1, or empty."""
    for i in range(3):
        for k in range(3):
            value = 0.0
            for a in range(G.shape[1]):
                value += u[i, a] * G[k, a]
            F[i, k] = value + (1.0 if i == k else 0.0)
    if len(rest) > 0:
        for i in range(3):
            for k in range(3):
                F[i, k] += rest[e, q, i, k]


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
    """W1, W11 = dW1/dI1 and J^(-2/3), J^(-4/3) of the terms in invariants; fills P, their isochoric stress,
    g = dI2/dF and m = d(J^(-2/3) I1)/dF. NaN beyond the limit of Gent's term."""
    j1 = J ** (-2.0 / 3.0)
    j2 = j1 * j1
    x = j1 * I1 - 3.0
    W1 = c[0] + (2.0 * c[2] + 3.0 * c[3] * x) * x
    W11 = 2.0 * c[2] + 6.0 * c[3] * x
    if c[4] != 0.0:
        left = 1.0 - c[5] * x
        if not left > 0.0:
            left = np.nan
        W1 += 0.5 * c[4] / left
        W11 += 0.5 * c[4] * c[5] / (left * left)
    for i in range(3):
        for k in range(3):
            FC = F[i, 0] * C[0, k] + F[i, 1] * C[1, k] + F[i, 2] * C[2, k]
            g[i, k] = 2.0 * (I1 * F[i, k] - FC)
            m[i, k] = j1 * (2.0 * F[i, k] - 2.0 / 3.0 * I1 * a[i, k])
            P[i, k] = W1 * m[i, k] + c[1] * j2 * (g[i, k] - 4.0 / 3.0 * I2 * a[i, k])
    return W1, W11, j1, j2


@_compiled
def _eigen(C: Array, D: Array, N: Array) -> None:
    """Diagonalises C (3, 3), symmetric, into D with eigenvectors in the columns of N, by Jacobi rotations."""
    for i in range(3):
        for k in range(3):
            D[i, k] = C[i, k]
            N[i, k] = 1.0 if i == k else 0.0
    for _ in range(12):
        if abs(D[0, 1]) + abs(D[0, 2]) + abs(D[1, 2]) < 1e-15 * (D[0, 0] + D[1, 1] + D[2, 2]):
            break
        for p, q in ((0, 1), (0, 2), (1, 2)):
            if D[p, q] == 0.0:
                continue
            cot = 0.5 * (D[q, q] - D[p, p]) / D[p, q]
            t = (1.0 if cot >= 0.0 else -1.0) / (abs(cot) + np.sqrt(1.0 + cot * cot))
            cos = 1.0 / np.sqrt(1.0 + t * t)
            sin = t * cos
            for k in range(3):
                D[k, p], D[k, q] = cos * D[k, p] - sin * D[k, q], sin * D[k, p] + cos * D[k, q]
            for k in range(3):
                D[p, k], D[q, k] = cos * D[p, k] - sin * D[q, k], sin * D[p, k] + cos * D[q, k]
                N[k, p], N[k, q] = cos * N[k, p] - sin * N[k, q], sin * N[k, p] + cos * N[k, q]


@_compiled
def _ogden(F: Array, C: Array, J: float, scale: float, c: Array, P: Array, A: Array) -> None:
    """Adds Ogden's terms to P, and `scale` times their tangent to A (6 or 0, 3, 3), by principal stretches
    (Holzapfel 2000, Nonlinear Solid Mechanics, section 6.6)."""
    work = np.empty((5, 3, 3))
    D, N, n, moduli, geometric = work[0], work[1], work[2], work[3], work[4]
    beta, S = np.zeros(3), np.zeros(3)
    _eigen(C, D, N)
    moduli[:, :] = 0.0
    for k in range(6, len(c), 2):
        mu, alpha = c[k], c[k + 1]
        if mu == 0.0:
            continue
        power, total = np.zeros(3), 0.0
        for a in range(3):
            power[a] = (D[a, a] * J ** (-2.0 / 3.0)) ** (0.5 * alpha)
            total += power[a]
        for a in range(3):
            beta[a] += 2.0 * mu / alpha * (power[a] - total / 3.0)
            for b in range(3):
                own = power[a] if a == b else 0.0
                moduli[a, b] += 2.0 * mu * (own - (power[a] + power[b]) / 3.0 + total / 9.0)
    for a in range(3):
        S[a] = beta[a] / D[a, a]
        for i in range(3):
            n[i, a] = F[i, 0] * N[0, a] + F[i, 1] * N[1, a] + F[i, 2] * N[2, a]
    for i in range(3):
        for p in range(3):
            P[i, p] += S[0] * n[i, 0] * N[p, 0] + S[1] * n[i, 1] * N[p, 1] + S[2] * n[i, 2] * N[p, 2]
    if len(A) == 0:
        return
    for a in range(3):
        for b in range(3):
            moduli[a, b] = (moduli[a, b] - (2.0 * beta[a] if a == b else 0.0)) / (D[a, a] * D[b, b])
    for a in range(3):
        for b in range(3):
            apart = D[b, b] - D[a, a]
            if abs(apart) > 1e-6 * (D[a, a] + D[b, b]):
                geometric[a, b] = (S[b] - S[a]) / apart
            else:  # the limit of equal stretches
                geometric[a, b] = 0.25 * (moduli[a, a] + moduli[b, b] - moduli[a, b] - moduli[b, a])
    for pair in range(6):
        i, j = PAIRS[pair]
        for p in range(3):
            for q in range(3):
                value = 0.0
                for a in range(3):
                    if i == j:
                        value += S[a] * N[p, a] * N[q, a]
                    for b in range(3):
                        value += moduli[a, b] * n[i, a] * N[p, a] * n[j, b] * N[q, b]
                        if a != b:
                            value += geometric[a, b] * n[i, a] * N[p, b] * (
                                n[j, a] * N[q, b] + n[j, b] * N[q, a]
                            )
                A[pair, p, q] += scale * value


@_compiled
def _tangent(
    F: Array, C: Array, a: Array, g: Array, m: Array, h: Array, I1: float, I2: float,
    w1: float, w2: float, w11: float, pJ: float, A: Array,
) -> None:  # fmt: skip
    """A (6, 3, 3): d(scale P + p J F^-T)_iI / dF_jJ of the PAIRS (i, j); w = scale (W1 j1, W2 j2, W11); h is
    scratch."""
    aa = 4.0 / 9.0 * w1 * I1 + 16.0 / 9.0 * w2 * I2 + pJ
    cross = 2.0 / 3.0 * w1 * I1 + 4.0 / 3.0 * w2 * I2 - pJ
    for i in range(3):
        for p in range(3):
            h[i, p] = -4.0 / 3.0 * (w1 * F[i, p] + w2 * g[i, p])
    for n in range(6):
        i, j = PAIRS[n]
        left = -2.0 * w2 * (F[i, 0] * F[j, 0] + F[i, 1] * F[j, 1] + F[i, 2] * F[j, 2])
        for p in range(3):
            for q in range(3):
                value = 2.0 * w2 * (2.0 * F[i, p] * F[j, q] - F[i, q] * F[j, p])
                value += a[i, p] * (aa * a[j, q] + h[j, q]) + h[i, p] * a[j, q] + cross * a[i, q] * a[j, p]
                A[n, p, q] = value + w11 * m[i, p] * m[j, q]
            A[n, p, p] += left
        if i == j:
            for p in range(3):
                A[n, p, p] += 2.0 * w1 + 2.0 * w2 * I1
                for q in range(3):
                    A[n, p, q] -= 2.0 * w2 * C[p, q]


@_compiled
def _energy(C: Array, J: float, I1: float, I2: float, c: Array) -> float:
    """Isochoric energy of the law, N mm/mm3."""
    j1 = J ** (-2.0 / 3.0)
    x = j1 * I1 - 3.0
    W = (c[0] + (c[2] + c[3] * x) * x) * x + c[1] * (j1 * j1 * I2 - 3.0)
    if c[4] != 0.0:
        W -= 0.5 * c[4] * (math.log1p(-c[5] * x) / c[5] if c[5] != 0.0 else -x)
    if len(c) > 6:
        work = np.empty((2, 3, 3))
        D, N = work[0], work[1]
        _eigen(C, D, N)
        for k in range(6, len(c), 2):
            for a in range(3):
                W += 2.0 * c[k] / (c[k + 1] * c[k + 1]) * ((D[a, a] * j1) ** (0.5 * c[k + 1]) - 1.0)
    return W


@_compiled
def _softening(W: float, soft: Array, peak: float, side: int) -> tuple[float, float]:
    """What Mullins softening (amount, m, beta) takes off the scale, and the slope of the scale with W.

    side: 1 below the largest energy so far, 0 at it, -1 to be told from W.
    """
    if side == 0 or (side < 0 and peak <= W):
        return 0.0, 0.0
    width = soft[1] + soft[2] * peak
    x = (peak - W) / width
    return soft[0] * math.erf(x), soft[0] * 2.0 / math.sqrt(math.pi) * math.exp(-x * x) / width


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
    G: Array, rest: Array, connectivity: Integers, u: Array, c: Array, first: int, last: int, S: Array
) -> None:
    """Isochoric second Piola-Kirchhoff stress S (e, q, 3, 3) MPa at displacements u (n, 3) mm."""
    ue, work, none = np.empty((3, connectivity.shape[1])), np.empty((6, 3, 3)), np.empty((0, 3, 3))
    F, C, a, g, m, P = work[0], work[1], work[2], work[3], work[4], work[5]
    for e in range(first, last):
        _gathered(u, connectivity[e], ue)
        for q in range(G.shape[1]):
            _deformation(G[e, q], ue, rest, e, q, F)
            J, I1, I2 = _invariants(F, C, a)
            _stress(F, C, a, J, I1, I2, c[e], g, m, P)
            if c.shape[1] > 6:
                _ogden(F, C, J, 1.0, c[e], P, none)
            for i in range(3):
                for k in range(3):
                    S[e, q, i, k] = a[0, i] * P[0, k] + a[1, i] * P[1, k] + a[2, i] * P[2, k]


@_compiled
def _stiffened(P: Array, slope: float, A: Array) -> None:
    """Adds what the scale's slope with the energy, whose gradient is P, puts into the tangent A (6, 3, 3)."""
    for pair in range(6):
        i, j = PAIRS[pair]
        for p in range(3):
            for q in range(3):
                A[pair, p, q] += slope * P[i, p] * P[j, q]


@_compiled
def energies(
    G: Array, rest: Array, connectivity: Integers, u: Array, c: Array, first: int, last: int, W: Array
) -> None:
    """Isochoric energy W (e, q) N mm/mm3 of the law at displacements u (n, 3) mm."""
    ue, work = np.empty((3, connectivity.shape[1])), np.empty((3, 3, 3))
    F, C, a = work[0], work[1], work[2]
    for e in range(first, last):
        _gathered(u, connectivity[e], ue)
        for q in range(G.shape[1]):
            _deformation(G[e, q], ue, rest, e, q, F)
            J, I1, I2 = _invariants(F, C, a)
            W[e, q] = _energy(C, J, I1, I2, c[e])


@_compiled
def internal(
    G: Array, rest: Array, w: Array, connectivity: Integers, u: Array, S: Array, first: int, last: int,
    force: Array,
) -> None:  # fmt: skip
    """Element forces (e, n, 3) N of a second Piola-Kirchhoff stress S (e, q, 3, 3) MPa."""
    points, n = G.shape[1], connectivity.shape[1]
    ue, F, flux = np.empty((3, n)), np.empty((3, 3)), np.empty((points, 3, 3))
    for e in range(first, last):
        _gathered(u, connectivity[e], ue)
        for q in range(points):
            _deformation(G[e, q], ue, rest, e, q, F)
            for i in range(3):
                for k in range(3):
                    FS = F[i, 0] * S[e, q, 0, k] + F[i, 1] * S[e, q, 1, k] + F[i, 2] * S[e, q, 2, k]
                    flux[q, k, i] = w[e, q] * FS
        np.dot(G[e].reshape(3 * points, n).T, flux.reshape(3 * points, 3), force[e])


@_compiled
def residual(
    G: Array, rest: Array, w: Array, psi: Array, connectivity: Integers, u: Array, p: Array, c: Array,
    bulk: Array,
    scale: Array, carried: Array, soft: Array, peak: Array, sides: Flags, first: int, last: int,
    force: Array, gap: Array,
) -> None:  # fmt: skip
    """Element forces (e, n, 3) N and volume gaps (e, m) mm3.

    A history's: scale (e,) and carried (e or 1, q, 3, 3) MPa; and of Mullins softening, or empty: soft (e, 3)
    of amount, m, beta, the largest energy so far peak (e, q), and, where it is given, on which side of it
    each point is, sides (e, q).
    """
    points, n = G.shape[1], connectivity.shape[1]
    ue, work, flux = np.empty((3, n)), np.empty((6, 3, 3)), np.empty((points, 3, 3))
    none = np.empty((0, 3, 3))
    F, C, a, g, m, P = work[0], work[1], work[2], work[3], work[4], work[5]
    for e in range(first, last):
        _gathered(u, connectivity[e], ue)
        gap[e] = 0.0
        for q in range(points):
            _deformation(G[e, q], ue, rest, e, q, F)
            J, I1, I2 = _invariants(F, C, a)
            _stress(F, C, a, J, I1, I2, c[e], g, m, P)
            if c.shape[1] > 6:
                _ogden(F, C, J, 1.0, c[e], P, none)
            pressure = 0.0
            for k in range(psi.shape[2]):
                pressure += psi[e, q, k] * p[e, k]
            s = scale[e]
            if len(soft) > 0:
                side = int(sides[e, q]) if len(sides) > 0 else -1
                s -= _softening(_energy(C, J, I1, I2, c[e]), soft[e], peak[e, q], side)[0]
            _total(P, F, a, J * pressure, s, carried[e % len(carried), q])
            for k in range(psi.shape[2]):
                gap[e, k] += w[e, q] * (J - 1.0 - pressure / bulk[e]) * psi[e, q, k]
            for i in range(3):
                for k in range(3):
                    flux[q, k, i] = w[e, q] * P[i, k]
        np.dot(G[e].reshape(3 * points, n).T, flux.reshape(3 * points, 3), force[e])


@_compiled
def linearise(
    G: Array, rest: Array, w: Array, psi: Array, connectivity: Integers, u: Array, p: Array, c: Array,
    bulk: Array,
    scale: Array, carried: Array, soft: Array, peak: Array, sides: Flags, compliance: Array,
    first: int, last: int, force: Array, gap: Array, B: Array, places: Integers, data: Array,
    slots: Integers, kept: Array,
) -> None:  # fmt: skip
    """As `residual`, with the pressure eliminated by its compliance (e, m, m): condensed forces and the
    coupling B (e, n, 3, m).

    The blocks (n, 6, n) of the tangent's PAIRS are added to `data` at their `places` (e, n, 6, n), of those
    on the diagonal one half; those of elements with slots (e,) from 0 on are kept there, (k, n, 6, n).
    """
    points, n, modes = G.shape[1], connectivity.shape[1], psi.shape[2]
    ue, work, A = np.empty((3, n)), np.empty((7, 3, 3)), np.empty((6, 3, 3))
    F, C, a, g, m, P, h = work[0], work[1], work[2], work[3], work[4], work[5], work[6]
    flux, spread = np.empty((points, 3, 3)), np.empty((points, 3, 3, modes))
    T, rows = np.empty((points, 3, 6, n)), np.empty((3, modes, n))
    eliminated, given, K = np.empty(modes), np.empty((3, modes)), np.empty((n, 6, n))
    for e in range(first, last):
        _gathered(u, connectivity[e], ue)
        gap[e] = 0.0
        S = carried[e % len(carried)]
        for q in range(points):
            _deformation(G[e, q], ue, rest, e, q, F)
            J, I1, I2 = _invariants(F, C, a)
            W1, W11, j1, j2 = _stress(F, C, a, J, I1, I2, c[e], g, m, P)
            pressure = 0.0
            for k in range(modes):
                pressure += psi[e, q, k] * p[e, k]
            s, slope = scale[e], 0.0
            if len(soft) > 0:
                side = int(sides[e, q]) if len(sides) > 0 else -1
                drop, slope = _softening(_energy(C, J, I1, I2, c[e]), soft[e], peak[e, q], side)
                s -= drop
            _tangent(F, C, a, g, m, h, I1, I2, s * W1 * j1, s * c[e, 1] * j2, s * W11, J * pressure, A)
            if c.shape[1] > 6:
                _ogden(F, C, J, s, c[e], P, A)
            if slope != 0.0:
                _stiffened(P, slope, A)
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
                    same = w[e, q] if pair < 3 else 0.0  # what is carried couples a component with itself
                    t0 = w[e, q] * A[pair, k, 0] + same * S[q, k, 0]
                    t1 = w[e, q] * A[pair, k, 1] + same * S[q, k, 1]
                    t2 = w[e, q] * A[pair, k, 2] + same * S[q, k, 2]
                    for b in range(n):
                        T[q, k, pair, b] = t0 * G[e, q, 0, b] + t1 * G[e, q, 1, b] + t2 * G[e, q, 2, b]
        Gt = G[e].reshape(3 * points, n).T
        np.dot(Gt, flux.reshape(3 * points, 3), force[e])
        np.dot(Gt, T.reshape(3 * points, 6 * n), K.reshape(n, 6 * n))
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
            for i in range(3):
                for r in range(modes):
                    value = 0.0
                    for k in range(modes):
                        value += B[e, d, i, k] * compliance[e, k, r]
                    given[i, r] = value
            for pair in range(6):
                i, j = PAIRS[pair]
                half = d if pair < 3 else 0
                begin = 0 if slots[e] >= 0 else half
                if modes == 4:  # at once, or the row is read and written four times
                    x0, x1, x2, x3 = given[i, 0], given[i, 1], given[i, 2], given[i, 3]
                    for b in range(begin, n):
                        K[d, pair, b] += (
                            x0 * rows[j, 0, b] + x1 * rows[j, 1, b] + x2 * rows[j, 2, b] + x3 * rows[j, 3, b]
                        )
                else:
                    for r in range(modes):
                        for b in range(begin, n):
                            K[d, pair, b] += given[i, r] * rows[j, r, b]
                for b in range(half, n):
                    data[places[e, d, pair, b]] += K[d, pair, b]
        if slots[e] >= 0:
            kept[slots[e]] = K


@_compiled
def stresses(F: Array, c: Array, P: Array, a: Array, J: Array) -> None:
    """Fills P_iso, F^-T (k, 3, 3) and J (k,) at F (k, 3, 3) with one row of constants c."""
    C, g, m, none = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((0, 3, 3))
    for k in range(len(F)):
        J[k], I1, I2 = _invariants(F[k], C, a[k])
        _stress(F[k], C, a[k], J[k], I1, I2, c, g, m, P[k])
        _ogden(F[k], C, J[k], 1.0, c, P[k], none)


@_compiled
def tangents(F: Array, c: Array, scale: Array, pressure: Array, A: Array) -> None:
    """Fills A (k, 6, 3, 3) at F (k, 3, 3), `scale` (k,) and `pressure` (k,) with one row of constants c."""
    work = np.empty((6, 3, 3))
    C, a, g, m, P, h = work[0], work[1], work[2], work[3], work[4], work[5]
    for k in range(len(F)):
        J, I1, I2 = _invariants(F[k], C, a)
        W1, W11, j1, j2 = _stress(F[k], C, a, J, I1, I2, c, g, m, P)
        s = scale[k]
        _tangent(F[k], C, a, g, m, h, I1, I2, s * W1 * j1, s * c[1] * j2, s * W11, J * pressure[k], A[k])
        _ogden(F[k], C, J, s, c, P, A[k])


@_compiled
def places(
    indptr: Integers, indices: Integers, rows: Integers, columns: Integers, mirrored: bool, out: Integers
) -> None:
    """Fills out (e, a, b): see `Pattern.places`."""
    for e in range(len(rows)):
        for a in range(rows.shape[1]):
            for b in range(columns.shape[1]):
                r, c = rows[e, a], columns[e, b]
                if mirrored and r > c:
                    r, c = c, r
                if r < 0 or r > c:
                    out[e, a, b] = len(indices)
                    continue
                low, high = indptr[r], indptr[r + 1]
                while low < high:
                    middle = (low + high) // 2
                    if indices[middle] < c:
                        low = middle + 1
                    else:
                        high = middle
                out[e, a, b] = low


@_compiled
def scatter_add(place: Integers, values: Array, out: Array) -> None:
    """out[place] += values, both flat."""
    for k in range(len(values)):
        out[place[k]] += values[k]
