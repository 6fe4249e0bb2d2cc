"""Nominal stress of a homogeneous specimen of any `Material`: uniaxial, planar, equibiaxial, simple shear.

Closed form. With the isochoric stretches b_i = J^(-1/3) l_i and beta_i = b_i dW/db_i, the principal Kirchhoff
stresses are t_i = beta_i - (beta_1 + beta_2 + beta_3) / 3 + J p with p = K (J - 1) (Ogden 1972, doi
10.1098/rspa.1972.0026). The free side has t_3 = 0, which gives J; the nominal stress is t_1 / l_1. In simple
shear by an amount g the principal stretches are l and 1/l with l - 1/l = g, and the shear stress is (t_1 -
t_2) / (l + 1/l).
"""

from typing import Literal, get_args

import numpy as np

from fe.element import Array
from fe.material import Material, relaxation

Kind = Literal["uniaxial", "planar", "equibiaxial", "shear"]
KINDS: tuple[Kind, ...] = get_args(Kind)
# Slope of the stress at rest over the shear modulus.
SLOPES: dict[Kind, float] = {"uniaxial": 3.0, "planar": 4.0, "equibiaxial": 6.0, "shear": 1.0}
TURNS, SETTLED, NUDGE = 20, 1e-10, 1e-7  # of the search for J


def principal_stretches(strain: Array, kind: Kind, volume: Array | float = 1.0) -> Array:
    """Principal stretches (k, 3) of a specimen at nominal strains (k,), in shear at amounts of shear.

    The first is along the pull, the last free. volume: J, (k,) or one for all; in shear it is 1.

    >>> principal_stretches(np.array([3.0]), "uniaxial")
    array([[4. , 0.5, 0.5]])
    >>> principal_stretches(np.array([1.5]), "shear")
    array([[2. , 0.5, 1. ]])
    """
    if kind == "shear":
        stretch = strain / 2 + np.hypot(1.0, strain / 2)
        return np.stack([stretch, 1 / stretch, np.ones_like(stretch)], axis=1)
    x = 1.0 + strain
    across = {"uniaxial": np.sqrt(volume / x), "planar": np.ones_like(x), "equibiaxial": x}[kind]
    return np.stack([x, across, volume / (x * across)], axis=1)


def nominal_stress(material: Material, strain: Array, kind: Kind, *, time: Array | None = None) -> Array:
    """Nominal stress (k,) MPa, force over the area at rest, at nominal strains (k,) in a pull from rest.

    uniaxial: a strip or a dumbbell, or a lubricated cylinder at negative strain; planar: a wide sheet of
    constant width; equibiaxial: a sheet pulled equally both ways, or a bubble; shear: amounts of shear of a
    thin block. time: (k,) s since the pull began from rest, rising; required by a material that creeps.
    Mullins softening has no effect in a first pull. NaN where the law has no stress (Gent beyond its limit),
    or no volume frees that side. Raises ValueError for creep without times, or in shear.

    A neo-Hookean bar at twice its length: 2 C10 (l - 1 / l^2) = 0.35 MPa, less 0.05 % by its compressibility.

    >>> rubber = Material(C10=0.1)
    >>> nominal_stress(rubber, np.array([0.0, 1.0]), "uniaxial").round(3)
    array([0.  , 0.35])
    >>> nominal_stress(rubber, np.array([0.5]), "shear").round(6)  # 2 C10 g
    array([0.1])
    """
    if material.prony and (time is None or kind == "shear"):
        raise ValueError(
            "the stress of a silicone that creeps depends on time: wanted the times of a uniaxial, planar or "
            f"equibiaxial pull, not {'shear' if kind == 'shear' else 'strains alone'}"
        )
    strain = np.asarray(strain, float)
    if kind == "shear":
        l = principal_stretches(strain, kind)  # noqa: E741
        t = _stresses(material, l, None)
        return np.asarray((t[:, 0] - t[:, 1]) / (l[:, 0] + l[:, 1]), float)
    J = np.ones_like(strain)
    for _ in range(TURNS):  # Newton's method
        side, aside = (_free_side(material, strain, kind, volume, time) for volume in (J, J * (1 + NUDGE)))
        step = side * J * NUDGE / (aside - side)
        J = J - step
        if not (np.abs(step) > SETTLED).any():
            break
    l = principal_stretches(strain, kind, J)  # noqa: E741
    t = _stresses(material, l, time)
    return np.where(np.abs(step) <= SETTLED, (t[:, 0] - t[:, 2]) / l[:, 0], np.nan)


def _free_side(material: Material, strain: Array, kind: Kind, J: Array, time: Array | None) -> Array:
    """Kirchhoff stress (k,) MPa normal to the free side at volumes J (k,)."""
    t = _stresses(material, principal_stretches(strain, kind, J), time)
    return np.asarray(t[:, 2] + material.bulk * J * (J - 1), float)


def _stresses(material: Material, l: Array, time: Array | None) -> Array:  # noqa: E741
    """Isochoric principal Kirchhoff stresses (k, 3) MPa at stretches l (k, 3)."""
    b2 = (l / np.cbrt(l.prod(axis=1, keepdims=True))) ** 2
    slope = material.slopes(b2.sum(axis=1, keepdims=True))[0]
    slope = np.where(np.isfinite(slope), slope, np.nan)
    beta = 2 * slope * b2 - 2 * material.C01 / b2
    beta += sum(2 * m / alpha * b2 ** (alpha / 2) for m, alpha in material.ogden)
    deviator = beta - beta.mean(axis=1, keepdims=True)
    return _relaxed(deviator, l, material.prony, time) if time is not None and material.prony else deviator


def _relaxed(t: Array, l: Array, prony: tuple[tuple[float, float], ...], time: Array) -> Array:  # noqa: E741
    """Stresses t (k, 3) after relaxation at times (k,) s since rest: the second Piola-Kirchhoff stress t /
    l^2 relaxes, linear in time between the strains (`fe.material`)."""
    S = np.vstack([np.zeros(3), t / l**2])
    out, dt = S[1:].copy(), np.diff(time, prepend=0.0)
    for g, tau in prony:
        Q, (decay, ramp) = np.zeros(3), relaxation(np.array([[g, tau]]), dt)
        for k in range(len(dt)):
            Q = decay[k] * Q + g * ramp[k] * (S[k + 1] - S[k])
            out[k] += Q - g * S[k + 1]
    return out * l**2
