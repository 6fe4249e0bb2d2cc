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


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...iI,...iI->...", a, b)


def _cofactor(F: Array) -> Array:
    """The cofactors J F^-T (..., 3, 3): cross products of the rows, ten times faster than inverting small
    matrices."""
    out = np.empty_like(F)
    for i in range(3):
        b, c = F[..., (i + 1) % 3, :], F[..., (i + 2) % 3, :]
        for k in range(3):
            m, n = (k + 1) % 3, (k + 2) % 3
            out[..., i, k] = b[..., m] * c[..., n] - b[..., n] * c[..., m]
    return out


def stress(F: Array, C10: Array, C01: Array, C20: Array) -> tuple[Array, Array, Array]:
    """Isochoric first Piola-Kirchhoff stress (..., 3, 3) MPa, F^-T (..., 3, 3) and J (...) at F (..., 3, 3).

    Constants broadcast against the leading axes. J must be positive.
    """
    parts = _parts(F, C10, C01, C20)
    return parts[0], parts[1], parts[2]


def _parts(F: Array, C10: Array, C01: Array, C20: Array) -> tuple[Array, ...]:
    cofactor = _cofactor(F)
    J = (F[..., 0, :] * cofactor[..., 0, :]).sum(-1)
    a = cofactor / np.where(J > 0, J, np.nan)[..., None, None]
    I1 = _dot(F, F)
    C = np.swapaxes(F, -1, -2) @ F
    I2 = 0.5 * (I1 * I1 - _dot(C, C))
    j1 = np.where(J > 0, J, np.nan) ** (-2 / 3)  # a cell turned inside out shows as NaN, in silence
    j2 = j1 * j1
    g2 = 2 * (I1[..., None, None] * F - F @ C)
    W1 = C10 + 2 * C20 * (j1 * I1 - 3)
    m1 = j1[..., None, None] * (2 * F - (2 / 3) * I1[..., None, None] * a)
    m2 = j2[..., None, None] * (g2 - (4 / 3) * I2[..., None, None] * a)
    P = W1[..., None, None] * m1 + (C01 + 0 * W1)[..., None, None] * m2
    return P, a, J, C, I1, I2, j1, j2, g2, W1, m1


def tangent(F: Array, p: Array, scale: Array, C10: Array, C01: Array, C20: Array) -> tuple[Array, ...]:
    """(P_iso, F^-T, J, A): as `stress`, and A = d(scale P_iso + p J F^-T)/dF, shape (..., 3, 3, 3, 3) MPa.

    `scale` (...) multiplies the isochoric part (1 without a Prony series); `p` (...) MPa is the pressure
    field.
    """
    P, a, J, C, I1, I2, j1, j2, g2, W1, m1 = _parts(F, C10, C01, C20)
    w1, w2, C20 = scale * W1 * j1, scale * C01 * j2, scale * C20
    pJ = p * J
    shape = F.shape[:-2]
    f, b, g, m = (x.reshape(*shape, 9) for x in (F, a, g2, m1))
    v = np.stack([f, b, g, m], axis=-1)  # (..., 9, 4)
    M = np.zeros((*shape, 4, 4))
    M[..., 0, 0] = 4 * w2
    M[..., 0, 1] = M[..., 1, 0] = -4 / 3 * w1
    M[..., 1, 1] = 4 / 9 * w1 * I1 + 16 / 9 * w2 * I2 + pJ
    M[..., 1, 2] = M[..., 2, 1] = -4 / 3 * w2
    M[..., 3, 3] = 2 * C20
    A = (v @ M @ np.swapaxes(v, -1, -2)).reshape(*shape, 3, 3, 3, 3)
    cross = (2 / 3 * w1 * I1 + 4 / 3 * w2 * I2 - pJ)[..., None, None, None, None]
    A += cross * np.einsum("...iJ,...jI->...iIjJ", a, a)
    A -= (2 * w2)[..., None, None, None, None] * np.einsum("...iJ,...jI->...iIjJ", F, F)
    eye = np.eye(3)
    inner = (2 * w1 + 2 * w2 * I1)[..., None, None] * eye - (2 * w2)[..., None, None] * C
    left = (-2 * w2)[..., None, None] * (F @ np.swapaxes(F, -1, -2))
    for i in range(3):
        A[..., i, :, i, :] += inner
        A[..., :, i, :, i] += left
    return P, a, J, A


def relaxation(prony: Array, dt: float) -> tuple[Array, Array]:
    """Decay exp(-dt/tau) and ramp weight (1 - exp(-dt/tau)) tau/dt (m, e) of Prony terms `prony` (m, e, 2).

    With them one step that is linear in the stress is exact: Q1 = decay Q0 + g ramp (S1 - S0)
    (Taylor, Pister, Goudreau 1970, doi 10.1002/nme.1620020106).
    """
    x = dt / prony[..., 1]
    return np.exp(-x), -np.expm1(-x) / x
