"""The law at one point, compiled to machine code by numba: invariants, and the energy, stress and tangent of
each of its terms. The formulas are those of `fe.material`.

A row of constants holds what the columns below name. A new term in I1 alone is a column, an energy that
`energy` adds and two slopes that `_slopes` adds. Arrays of a `Point` are scratch, filled and read in turn.
"""

import hashlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np

from fe.element import Array

# Columns of a row of constants; from OGDEN on pairs of mu and alpha.
C10, C01, C20, C30, GENT, GENT_INVERSE, CHAIN, CHAIN_INVERSE, OGDEN = range(9)
# The energy of eight chains, mu sum a_i k^(i-1) (I1^i - 3^i), k = 1 / lambda_m^2: the series of the inverse
# Langevin function to its fifth term.
CHAINS = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)
# Component blocks (i, j) of an element matrix, i <= j.
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

# Sums may be reordered; NaN stays NaN, as it marks a cell turned inside out.
_OPTIONS: dict[str, Any] = {"nogil": True, "fastmath": {"contract", "reassoc"}, "error_model": "numpy"}
_OWN_SOURCE = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()


def machine_code(function: Callable[..., Any], *, inline: bool = False) -> Any:
    """The function, compiled by numba at its first call and kept on the disk.

    numba compiles anew where the function's own file has changed. The loops hold the law of this file in
    their machine code, so a change here must count too; and what was kept may name classes that are no more,
    so it must not even be read then: both stand in the version of what is kept, which numba reads first.
    Where numba has no place for that, nothing is kept.
    """
    compiled: Any = numba.njit(function, cache=True, forceinline=inline, **_OPTIONS)
    try:
        file = compiled._cache._cache_file
        file._version = (file._version, file._source_stamp, _OWN_SOURCE)
    except AttributeError:
        return numba.njit(function, **_OPTIONS)
    return compiled


def part(function: Callable[..., Any]) -> Any:
    """The function compiled into its callers, for code that runs at every point: a record is expensive to
    pass."""
    return machine_code(function, inline=True)


class Point(NamedTuple):
    """Scratch at one point, (3, 3) each: the deformation gradient F, C = F^T F, a = F^-T, g = dI2/dF,
    m = d(J^(-2/3) I1)/dF, the stress P, and h of the tangent."""

    F: Array
    C: Array
    a: Array
    g: Array
    m: Array
    P: Array
    h: Array


@machine_code
def new_point() -> Point:
    """A Point with uninitialised arrays."""
    w = np.empty((7, 3, 3))
    return Point(w[0], w[1], w[2], w[3], w[4], w[5], w[6])


@part
def invariants(point: Point) -> tuple[float, float, float]:
    """J, tr C and (tr(C)^2 - tr(C^2)) / 2 of F; fills C and a. NaN where J <= 0."""
    F, C, a = point.F, point.C, point.a
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


@machine_code
def _gent(c: Array, x: float) -> tuple[float, float]:
    """The two slopes of Gent's term at I1 - 3 = x; NaN beyond its limit."""
    rest = 1.0 - c[GENT_INVERSE] * x
    if not rest > 0.0:
        rest = np.nan
    return 0.5 * c[GENT] / rest, 0.5 * c[GENT] * c[GENT_INVERSE] / (rest * rest)


@machine_code
def _chain(c: Array, x: float) -> tuple[float, float]:
    """The two slopes of the eight chains' term at I1 - 3 = x."""
    I1, power = x + 3.0, c[CHAIN]
    W1, W11 = CHAINS[0] * power, 0.0
    for i in range(2, 6):  # power: mu (k I1)^(i - 2)
        term = i * CHAINS[i - 1] * c[CHAIN_INVERSE] * power
        W1 += term * I1
        W11 += (i - 1) * term
        power *= c[CHAIN_INVERSE] * I1
    return W1, W11


@part
def _slopes(c: Array, x: float) -> tuple[float, float]:
    """W1 = dW/dI1 and W11 = dW1/dI1 of the terms in I1 at I1 - 3 = x."""
    W1 = c[C10] + (2.0 * c[C20] + 3.0 * c[C30] * x) * x
    W11 = 2.0 * c[C20] + 6.0 * c[C30] * x
    if c[GENT] != 0.0:
        more = _gent(c, x)
        W1 += more[0]
        W11 += more[1]
    if c[CHAIN] != 0.0:
        more = _chain(c, x)
        W1 += more[0]
        W11 += more[1]
    return W1, W11


@part
def in_invariants(point: Point, J: float, I1: float, I2: float, c: Array) -> tuple[float, float, float]:
    """The weights w1 = W1 J^(-2/3), w2 = W2 J^(-4/3), W11 of the terms in invariants; fills P, their
    isochoric stress, g and m."""
    F, C, a, g, m, P = point.F, point.C, point.a, point.g, point.m, point.P
    j1 = J ** (-2.0 / 3.0)
    j2 = j1 * j1
    W1, W11 = _slopes(c, j1 * I1 - 3.0)
    for i in range(3):
        for k in range(3):
            FC = F[i, 0] * C[0, k] + F[i, 1] * C[1, k] + F[i, 2] * C[2, k]
            g[i, k] = 2.0 * (I1 * F[i, k] - FC)
            m[i, k] = j1 * (2.0 * F[i, k] - 2.0 / 3.0 * I1 * a[i, k])
            P[i, k] = W1 * m[i, k] + c[C01] * j2 * (g[i, k] - 4.0 / 3.0 * I2 * a[i, k])
    return W1 * j1, c[C01] * j2, W11


@machine_code
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


@machine_code
def _principal(stretch: Array, c: Array, beta: Array, moduli: Array) -> None:
    """Fills beta_a = dW/d ln l_a (3,) of Ogden's terms and its derivative moduli (3, 3) by ln l_b, at squared
    isochoric stretches (3,)."""
    power = np.empty(3)
    beta[:] = 0.0
    moduli[:, :] = 0.0
    for k in range(OGDEN, len(c), 2):
        mu, alpha, total = c[k], c[k + 1], 0.0
        if mu == 0.0:
            continue
        for a in range(3):
            power[a] = stretch[a] ** (0.5 * alpha)
            total += power[a]
        for a in range(3):
            beta[a] += 2.0 * mu / alpha * (power[a] - total / 3.0)
            for b in range(3):
                diagonal = power[a] if a == b else 0.0
                moduli[a, b] += 2.0 * mu * (diagonal - (power[a] + power[b]) / 3.0 + total / 9.0)


@machine_code
def ogden(point: Point, J: float, scale: float, c: Array, A: Array) -> None:
    """Adds Ogden's terms to P, and `scale` times their tangent to A (6 or 0, 3, 3), by principal stretches
    (Holzapfel 2000, Nonlinear Solid Mechanics, section 6.6)."""
    F, P, work = point.F, point.P, np.empty((4, 3, 3))
    D, N, n, moduli = work[0], work[1], work[2], work[3]
    beta, S, stretch = np.empty(3), np.empty(3), np.empty(3)
    _eigen(point.C, D, N)
    for a in range(3):
        stretch[a] = D[a, a] * J ** (-2.0 / 3.0)
    _principal(stretch, c, beta, moduli)
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
    _ogden_tangent(D, N, n, S, moduli, scale, A)


@machine_code
def _ogden_tangent(D: Array, N: Array, n: Array, S: Array, moduli: Array, scale: float, A: Array) -> None:
    """Adds `scale` times the tangent of squared stretches D, their directions N, n at rest and deformed, and
    stresses S (3,) with their derivatives moduli (3, 3) to A (6, 3, 3)."""
    geometric = np.empty((3, 3))
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


@part
def tangent(
    point: Point, I1: float, I2: float, w1: float, w2: float, w11: float, pJ: float, A: Array
) -> None:
    """A (6, 3, 3): d(scale P + p J F^-T)_iI / dF_jJ of the PAIRS (i, j), by `scale` times the weights of
    `in_invariants`."""
    F, C, a, g, m, h = point.F, point.C, point.a, point.g, point.m, point.h
    aa = 4.0 / 9.0 * w1 * I1 + 16.0 / 9.0 * w2 * I2 + pJ
    cross = 2.0 / 3.0 * w1 * I1 + 4.0 / 3.0 * w2 * I2 - pJ
    for i in range(3):
        for p in range(3):
            h[i, p] = -4.0 / 3.0 * (w1 * F[i, p] + w2 * g[i, p])
    for n in range(6):
        i, j = PAIRS[n]
        geometric = -2.0 * w2 * (F[i, 0] * F[j, 0] + F[i, 1] * F[j, 1] + F[i, 2] * F[j, 2])
        for p in range(3):
            for q in range(3):
                value = 2.0 * w2 * (2.0 * F[i, p] * F[j, q] - F[i, q] * F[j, p])
                value += a[i, p] * (aa * a[j, q] + h[j, q]) + h[i, p] * a[j, q] + cross * a[i, q] * a[j, p]
                A[n, p, q] = value + w11 * m[i, p] * m[j, q]
            A[n, p, p] += geometric
        if i == j:
            for p in range(3):
                A[n, p, p] += 2.0 * w1 + 2.0 * w2 * I1
                for q in range(3):
                    A[n, p, q] -= 2.0 * w2 * C[p, q]


@machine_code
def energy(point: Point, J: float, I1: float, I2: float, c: Array) -> float:
    """Isochoric strain energy density of the law, N mm/mm3."""
    j1 = J ** (-2.0 / 3.0)
    x = j1 * I1 - 3.0
    W = (c[C10] + (c[C20] + c[C30] * x) * x) * x + c[C01] * (j1 * j1 * I2 - 3.0)
    if c[GENT] != 0.0:
        limited = c[GENT_INVERSE] != 0.0
        W -= 0.5 * c[GENT] * (math.log1p(-c[GENT_INVERSE] * x) / c[GENT_INVERSE] if limited else -x)
    if c[CHAIN] != 0.0:
        for i in range(1, 6):
            rise = (x + 3.0) ** i - 3.0**i
            W += c[CHAIN] * CHAINS[i - 1] * c[CHAIN_INVERSE] ** (i - 1) * rise
    if len(c) > OGDEN:
        work = np.empty((2, 3, 3))
        D, N = work[0], work[1]
        _eigen(point.C, D, N)
        for k in range(OGDEN, len(c), 2):
            for a in range(3):
                W += 2.0 * c[k] / (c[k + 1] * c[k + 1]) * ((D[a, a] * j1) ** (0.5 * c[k + 1]) - 1.0)
    return W


@machine_code
def softened(W: float, soft: Array, peak: float, side: int) -> tuple[float, float]:
    """Reduction of the stress scale by Mullins softening (amount, m, beta), and its slope by W.

    side: 1 on the unloading branch, 0 on the primary one, -1 to decide by W.
    """
    if side == 0 or (side < 0 and peak <= W):
        return 0.0, 0.0
    width = soft[1] + soft[2] * peak
    x = (peak - W) / width
    return soft[0] * math.erf(x), soft[0] * 2.0 / math.sqrt(math.pi) * math.exp(-x * x) / width
