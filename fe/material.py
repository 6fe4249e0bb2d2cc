"""Constants of an isotropic, nearly incompressible rubber (`Material`), and its energy.

W = C10 (I1 - 3) + C01 (I2 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3 - mu Jm / 2 ln(1 - (I1 - 3) / Jm)
    + mu sum a_i lambda_m^(2 - 2 i) (I1^i - 3^i)
    + sum 2 mu_k / alpha_k^2 (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3) + p (J - 1) - p^2 / (2 K)

with the isochoric invariants I1 = J^(-2/3) tr C, I2 = J^(-4/3) (tr(C)^2 - tr(C^2)) / 2 and stretches
l = J^(-1/3) lambda: neo-Hooke, Mooney (1940, doi 10.1063/1.1712836), Rivlin (1948, doi
10.1098/rsta.1948.0024), Yeoh (1993, doi 10.5254/1.3538343), Gent (1996, doi 10.5254/1.3538357), Arruda &
Boyce (1993, doi 10.1016/0022-5096(93)90013-6, a = 1/2, 1/20, 11/1050, 19/7000, 519/673750), Ogden (1972, doi
10.1098/rspa.1972.0026, in the form that Abaqus uses), and the pressure field p of the mixed form.

Creep is finite-strain Prony relaxation of the isochoric second Piola-Kirchhoff stress (Holzapfel 1996,
doi 10.1002/(SICI)1097-0207(19961130)39:22<3903::AID-NME34>3.0.CO;2-C). Mullins softening (Ogden & Roxburgh
1999, doi 10.1098/rspa.1999.0431, with Abaqus's beta) multiplies the isochoric stress by

eta = 1 - 1/r erf((W_max - W) / (m + beta W_max)),

W_max being the largest W so far at that point, from rest. With both, as in Abaqus, eta multiplies the
long-term part: S = (eta (1 - sum g) S0 + sum Q), where S0 and W are of the constants as given (instantaneous)
and the Q relax as without softening.

The kernel takes `Material.constants` to the loops over elements.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fe import terms
from fe.element import Array


@dataclass(frozen=True)
class Material:
    """Constants in MPa of the terms that a rubber has; those left out are 0.

    gent: mu in MPa and the limit Jm of I1 - 3 (infinite: none). chains: mu in MPa, and the stretch
    lambda_m at which eight chains lock. ogden: pairs (mu MPa, alpha). bulk_ratio: K / shear modulus, so that
    scaling all constants with the pressure leaves u unchanged. prony: pairs (g, tau s) of the relaxation
    G(t) = G0 [1 - sum g (1 - exp(-t / tau))]. mullins: 1/r (below 1), m in MPa, beta.
    density: tonne/mm3 at rest, felt where a path has gravity.
    """

    C10: float = 0.0
    C01: float = 0.0
    C20: float = 0.0
    bulk_ratio: float = 1000.0
    prony: tuple[tuple[float, float], ...] = ()
    C30: float = 0.0
    gent: tuple[float, float] | None = None
    ogden: tuple[tuple[float, float], ...] = ()
    mullins: tuple[float, float, float] | None = None
    density: float = 0.0
    chains: tuple[float, float] | None = None

    @property
    def shear(self) -> float:
        """Shear modulus in MPa at rest, 2 (C10 + C01) for Mooney-Rivlin.

        >>> Material(C10=0.25, C01=0.125).shear
        0.75
        >>> Material(ogden=((0.3, 2.0),)).shear
        0.3
        """
        gent = self.gent[0] if self.gent else 0.0
        return 2 * (self.C10 + self.C01) + gent + sum(mu for mu, _ in self.ogden) + 2 * self._chained(3.0)

    def _chained(self, I1: Any) -> Any:
        """Derivative in MPa of the eight-chain energy by I1."""
        mu, lock = self.chains or (0.0, np.inf)
        return mu * sum((i + 1) * a * (I1 / lock**2) ** i for i, a in enumerate(terms.CHAINS))

    def slopes(self, I1: Any) -> tuple[Any, Any]:
        """Derivatives dW/dI1 and d2W/dI1^2 in MPa of the terms in I1 alone; infinite beyond Gent's limit.

        >>> Material(C10=0.2, C20=0.01).slopes(4.0)
        (np.float64(0.22), np.float64(0.02))
        """
        x, (mu, limit), (chain, lock) = I1 - 3, self.gent or (0.0, np.inf), self.chains or (0.0, np.inf)
        inside = x < limit
        k = lock**-2.0
        more = sum(i * (i + 1) * a * k**i * I1 ** (i - 1) for i, a in enumerate(terms.CHAINS) if i)
        slope = self.C10 + (2 * self.C20 + 3 * self.C30 * x) * x + self._chained(I1)
        curvature = 2 * self.C20 + 6 * self.C30 * x + chain * more
        rest = np.where(inside, 1 - x / limit, 1.0)
        every = slope + mu / (2 * rest), curvature + mu / (2 * limit * rest**2)
        return np.where(inside, every[0], np.inf)[()], np.where(inside, every[1], np.inf)[()]

    @property
    def bulk(self) -> float:
        """Bulk modulus K in MPa.

        >>> Material(C10=0.25, bulk_ratio=1000.0).bulk
        500.0
        """
        return self.bulk_ratio * self.shear

    @property
    def instant(self) -> "Material":
        """The material without memory: neither creep nor softening."""
        return replace(self, prony=(), mullins=None)

    def stiffened(self, factor: float) -> "Material":
        """The material with all moduli multiplied; ratios, times, exponents and limits stay.

        >>> Material(C10=0.25, ogden=((0.5, 4.0),)).stiffened(2.0).ogden
        ((1.0, 4.0),)
        """
        return replace(
            self,
            C10=factor * self.C10,
            C01=factor * self.C01,
            C20=factor * self.C20,
            C30=factor * self.C30,
            gent=self.gent and (factor * self.gent[0], self.gent[1]),
            chains=self.chains and (factor * self.chains[0], self.chains[1]),
            ogden=tuple((factor * mu, alpha) for mu, alpha in self.ogden),
            mullins=self.mullins and (self.mullins[0], factor * self.mullins[1], self.mullins[2]),
        )

    def steadiness(self, stretch: float) -> float:
        """Smallest tangent modulus of shear up to a stretch, over the shear modulus at rest; 1 for neo-Hooke.
        Below 0 the rubber is unstable in shear (Baker & Ericksen 1954, doi 10.1007/978-3-642-88691-1_6).

        (t_i - t_j) / (l_i^2 - l_j^2), t the principal Kirchhoff stresses, in uniaxial, planar and equibiaxial
        tension at constant volume; Gent's law ends at its limit.

        >>> round(Material(C10=0.2).steadiness(3.0), 12)
        1.0
        >>> Material(C10=0.2, C20=-0.02).steadiness(3.0) < 0
        True
        """
        l = np.geomspace(1.0, stretch, 16)[1:, None]  # noqa: E741
        states = np.array([l ** np.array(powers) for powers in ((1, -0.5, -0.5), (1, 0, -1), (1, 1, -2))])
        a, b = states[..., (0, 1, 0)], states[..., (1, 2, 2)]  # pairs of stretches, and the third of each
        x = (states**2).sum(axis=-1, keepdims=True) - 3
        mu, limit = self.gent or (0.0, np.inf)
        inside = x < limit
        slope = self.C10 + 2 * self.C20 * x + 3 * self.C30 * x**2 + self.C01 / (a * b) ** 2
        slope = 2 * (slope + self._chained(x + 3)) + mu / np.where(inside, 1 - x / limit, 1.0)
        apart = ~np.isclose(a, b)
        between = np.where(apart, a**2 - b**2, 1.0)
        slope += sum(2 * m / k * (a**k - b**k) for m, k in self.ogden) / between
        return float(slope[apart & inside].min() / self.shear) if self.shear > 0 else -np.inf

    @property
    def constants(self) -> Array:
        """C10, C01, C20, C30, mu and 1/Jm of Gent, mu and 1/lambda_m^2 of eight chains, and the pairs of
        Ogden: the columns of `terms`.

        >>> Material(C10=0.25, ogden=((0.5, 4.0),)).constants
        array([0.25, 0.  , 0.  , 0.  , 0.  , 0.  , 0.  , 0.  , 0.5 , 4.  ])
        """
        mu, limit = self.gent or (0.0, np.inf)
        chain, lock = self.chains or (0.0, np.inf)
        fixed = [self.C10, self.C01, self.C20, self.C30, mu, 1 / limit, chain, 1 / lock**2]
        return np.array([*fixed, *(x for pair in self.ogden for x in pair)], float)


def scaled(table: Array, factor: float) -> Array:
    """Rows of constants (e, k) with all moduli multiplied; limits and exponents stay."""
    out = table.copy()
    out[:, : terms.GENT_INVERSE] *= factor
    out[:, terms.CHAIN] *= factor
    out[:, terms.OGDEN :: 2] *= factor
    return out


def relaxation(prony: Array, dt: float | Array) -> tuple[Array, Array]:
    """Decay exp(-dt/tau) and ramp weight (1 - exp(-dt/tau)) tau/dt (m, e) of Prony terms `prony` (m, e, 2);
    for one term (1, 2) and steps dt (t,) s, each (t,).

    With them a step in which the stress grows linearly is exact: Q1 = decay Q0 + g ramp (S1 - S0) (Taylor,
    Pister, Goudreau 1970, doi 10.1002/nme.1620020106).

    >>> decay, ramp = relaxation(np.array([[0.3, 2.0]]), np.array([2.0]))
    >>> decay.round(4), ramp.round(4)
    (array([0.3679]), array([0.6321]))
    """
    x = dt / prony[..., 1]
    return np.exp(-np.minimum(x, 300.0)), -np.expm1(-x) / x  # times a stress still a normal number
