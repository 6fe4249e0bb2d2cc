"""Named constants and a deformation gradient -> stress and tangent of an isotropic, nearly incompressible
rubber.

W = C10 (I1 - 3) + C01 (I2 - 3) + C20 (I1 - 3)^2 + p (J - 1) - p^2 / (2 K) with the isochoric invariants
I1 = J^(-2/3) tr C, I2 = J^(-4/3) (tr(C)^2 - tr(C^2)) / 2 (Mooney 1940, doi 10.1063/1.1712836; Rivlin 1948,
doi 10.1098/rsta.1948.0024) and the pressure field p of the mixed form. Creep is finite-strain Prony
relaxation of the isochoric second Piola-Kirchhoff stress (Holzapfel 1996,
doi 10.1002/(SICI)1097-0207(19961130)39:22<3903::AID-NME34>3.0.CO;2-C).
"""

from dataclasses import dataclass

import numpy as np

from fe import compiled
from fe.element import Array


@dataclass(frozen=True)
class Material:
    """Mooney-Rivlin constants in MPa, an optional stiffening term and an optional Prony series.

    bulk_ratio: K / mu with mu = 2 (C10 + C01), so that scaling C10 and C01 with the pressure leaves u
    unchanged. prony: pairs (g, tau s) of the relaxation G(t) = G0 [1 - sum g (1 - exp(-t / tau))].
    """

    C10: float
    C01: float
    C20: float = 0.0
    bulk_ratio: float = 1000.0
    prony: tuple[tuple[float, float], ...] = ()

    @property
    def bulk(self) -> float:
        """Bulk modulus K in MPa."""
        return self.bulk_ratio * 2 * (self.C10 + self.C01)


def stress(F: Array, C10: Array, C01: Array, C20: Array) -> tuple[Array, Array, Array]:
    """Isochoric first Piola-Kirchhoff stress (..., 3, 3) MPa, F^-T (..., 3, 3) and J (...) at F (..., 3, 3).

    Constants broadcast against the leading axes. J must be positive.
    """
    shape = F.shape[:-2]
    P, a, J = np.empty((*shape, 3, 3)), np.empty((*shape, 3, 3)), np.empty(shape)
    c = np.stack(np.broadcast_arrays(C10, C01, C20, J)[:3], axis=-1)
    compiled.stresses(_flat(F), c.reshape(-1, 3), _flat(P), _flat(a), J.reshape(-1))
    return P, a, J


def tangent(F: Array, p: Array, scale: Array, C10: Array, C01: Array, C20: Array) -> Array:
    """d(scale P_iso + p J F^-T)/dF, shape (..., 3, 3, 3, 3) MPa, at F (..., 3, 3).

    `scale` (...) multiplies the isochoric part (1 without a Prony series); `p` (...) MPa is the pressure
    field.
    """
    shape = F.shape[:-2]
    half = np.empty((*shape, 6, 3, 3))
    c = np.stack(np.broadcast_arrays(C10, C01, C20, scale, p, np.empty(shape))[:5], axis=-1)
    compiled.tangents(_flat(F), c.reshape(-1, 5), half.reshape(-1, 6, 3, 3))
    A = np.empty((*shape, 3, 3, 3, 3))
    for n, (i, j) in enumerate(compiled.PAIRS):
        A[..., i, :, j, :] = half[..., n, :, :]
        A[..., j, :, i, :] = np.swapaxes(half[..., n, :, :], -1, -2)
    return A


def _flat(x: Array) -> Array:
    return np.ascontiguousarray(x).reshape(-1, 3, 3)


def relaxation(prony: Array, dt: float) -> tuple[Array, Array]:
    """Decay exp(-dt/tau) and ramp weight (1 - exp(-dt/tau)) tau/dt (m, e) of Prony terms `prony` (m, e, 2).

    With them one step that is linear in the stress is exact: Q1 = decay Q0 + g ramp (S1 - S0)
    (Taylor, Pister, Goudreau 1970, doi 10.1002/nme.1620020106).
    """
    x = dt / prony[..., 1]
    return np.exp(-x), -np.expm1(-x) / x
