"""Energy, stress and tangent of a law at single points, by which each term is tested, and what a tensile test
measures."""

from typing import Literal

import numpy as np

from fe import Material
from fe.element import Array
from fe.terms import PAIRS, in_invariants, invariants, machine_code, new_point, ogden
from fe.terms import energy as energy_at
from fe.terms import tangent as tangent_at


def energy(F: Array, m: Material) -> Array:
    """Isochoric energy W (...) in N mm/mm3 at deformation gradients F (..., 3, 3)."""
    W = np.empty(F.shape[:-2])
    _energies(_flat(F), m.constants, W.reshape(-1))
    return W


def stress(F: Array, m: Material) -> tuple[Array, Array, Array]:
    """Isochoric first Piola-Kirchhoff stress (..., 3, 3) MPa, F^-T (..., 3, 3) and J (...) at F (..., 3, 3).

    J must be positive.
    """
    shape = F.shape[:-2]
    P, a, J = np.empty((*shape, 3, 3)), np.empty((*shape, 3, 3)), np.empty(shape)
    _stresses(_flat(F), m.constants, _flat(P), _flat(a), J.reshape(-1))
    return P, a, J


def tangent(F: Array, m: Material, p: Array, scale: Array) -> Array:
    """d(scale P_iso + p J F^-T)/dF, shape (..., 3, 3, 3, 3) MPa, at F (..., 3, 3).

    `scale` (...) multiplies the isochoric part (1 without a Prony series); `p` (...) MPa is the pressure
    field.
    """
    shape = F.shape[:-2]
    half = np.empty((*shape, 6, 3, 3))
    p, scale = (np.ascontiguousarray(np.broadcast_to(x, shape), float).reshape(-1) for x in (p, scale))
    _tangents(_flat(F), m.constants, scale, p, half.reshape(-1, 6, 3, 3))
    A = np.empty((*shape, 3, 3, 3, 3))
    for n, (i, j) in enumerate(PAIRS):
        A[..., i, :, j, :] = half[..., n, :, :]
        A[..., j, :, i, :] = np.swapaxes(half[..., n, :, :], -1, -2)
    return A


def nominal_stress(m: Material, stretch: Array, mode: Literal["uniaxial", "equibiaxial", "planar"]) -> Array:
    """Nominal stress (k,) MPa in the direction of `stretch` (k,) of an incompressible sheet that is free
    across it: what a tensile, a bubble or a pure-shear test measures."""
    x = np.asarray(stretch, float)
    across = {"uniaxial": x**-0.5, "equibiaxial": x, "planar": np.ones_like(x)}[mode]
    F = np.zeros((len(x), 3, 3))
    F[:, 0, 0], F[:, 1, 1], F[:, 2, 2] = x, across, 1 / (x * across)
    P, _, _ = stress(F, m)
    # the pressure is such that the free side is free
    return np.asarray(P[:, 0, 0] - P[:, 2, 2] * F[:, 2, 2] / x, float)


@machine_code
def _energies(F: Array, c: Array, W: Array) -> None:
    """Fills the energy W (k,) N mm/mm3 at F (k, 3, 3) with one row of constants c."""
    at = new_point()
    for k in range(len(F)):
        at.F[:] = F[k]
        J, I1, I2 = invariants(at)
        W[k] = energy_at(at, J, I1, I2, c)


@machine_code
def _stresses(F: Array, c: Array, P: Array, a: Array, J: Array) -> None:
    """Fills P_iso, F^-T (k, 3, 3) and J (k,) at F (k, 3, 3) with one row of constants c."""
    at, none = new_point(), np.empty((0, 3, 3))
    for k in range(len(F)):
        at.F[:] = F[k]
        J[k], I1, I2 = invariants(at)
        in_invariants(at, J[k], I1, I2, c)
        ogden(at, J[k], 1.0, c, none)
        P[k], a[k] = at.P, at.a


@machine_code
def _tangents(F: Array, c: Array, scale: Array, pressure: Array, A: Array) -> None:
    """Fills A (k, 6, 3, 3) at F (k, 3, 3), `scale` (k,) and `pressure` (k,) with one row of constants c."""
    at = new_point()
    for k in range(len(F)):
        at.F[:] = F[k]
        J, I1, I2 = invariants(at)
        w1, w2, w11 = in_invariants(at, J, I1, I2, c)
        s = scale[k]
        tangent_at(at, I1, I2, s * w1, s * w2, s * w11, J * pressure[k], A[k])
        ogden(at, J, s, c, A[k])


def _flat(x: Array) -> Array:
    return np.ascontiguousarray(x).reshape(-1, 3, 3)
