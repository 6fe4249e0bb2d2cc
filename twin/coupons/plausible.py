"""Likely faults of a test of the silicone: a wrong unit, true stress, a preload."""

from collections.abc import Mapping

import numpy as np

from fe.homogeneous import SLOPES, Kind
from twin.targets import Array

SHEAR_MPA = 0.004, 10.0  # shear modulus at rest of anything that a finger is cast of: Ecoflex 00-10 has 0.01
USUAL_MPA = 0.2  # of silicones that fingers are cast of, within a factor of 3
LEAST, MOST = 0.03, 20.0  # largest strain of a test of rubber that says something; Ecoflex 00-30 breaks at 16
NEAR = 0.5  # of the largest strain, and strain, up to which the slope at rest is read
FEW = 8  # values there, at least
OTHER = {"kPa read as MPa": 1e-3, "Pa read as MPa": 1e-6, "MPa read as kPa": 1e3, "a share read as %": 0.01,
         "% read as a share": 100.0, "cm2 read as mm2": 0.01}  # fmt: skip


def strain_fault(strain: Array) -> str:
    """Fault of the largest strain of a test, "" without one.

    >>> strain_fault(np.array([0.0, 0.5, 1.0]))
    ''
    >>> strain_fault(np.array([0.0, 50.0, 100.0]))
    'the largest strain is 100 (1e+04 %); wanted 0.03 to 20; likely % read as a share, or mm read as strain'
    """
    most = float(np.abs(strain).max())
    if LEAST <= most <= MOST:
        return ""
    likely = "a share read as %" if most < LEAST else "% read as a share, or mm read as strain"
    advice = f"wanted {LEAST:g} to {MOST:g}; likely {likely}"
    return f"the largest strain is {most:.3g} ({100 * most:.3g} %); {advice}"


def stiffness_fault(strain: Array, stress: Array, kind: Kind) -> str:
    """Fault of the shear modulus (MPa) at the beginning of a curve, "" without one."""
    shear = beginning(strain, stress)[0] / SLOPES[kind]
    low, high = SHEAR_MPA
    if low <= shear <= high:
        return ""
    text = f"its beginning has a shear modulus of {shear:.3g} MPa; silicones have {low:g} to {high:g} MPa"
    if shear <= 0:
        return f"{text}; wanted stress that rises with strain: correct the columns or their signs"
    likely = min(OTHER, key=lambda name: abs(np.log(shear * OTHER[name] / USUAL_MPA)))
    if low <= shear * OTHER[likely] <= high:
        return f"{text}; likely {likely}"
    return f"{text}; are its columns and units right?"


def preload_doubt(strain: Array, stress: Array, sd: Array) -> str:
    """A sentence where the beginning of a curve does not lead to 0 stress at 0 strain, "" where it does."""
    _, offset, offset_sd = beginning(strain, stress)
    top = float(np.abs(stress).max())
    if abs(offset) < max(0.03 * top, 3 * float(np.median(sd)), 3 * offset_sd):
        return ""
    return (
        f"its beginning leads to {offset:.2g} MPa at no strain, {abs(offset) / top:.0%} of the largest "
        "stress: a preload, a slack specimen or a load cell that was not zeroed; set both to zero where the "
        "stress begins, or state how well the zero of the strain is known with zero_percent"
    )


def beginning(strain: Array, stress: Array) -> tuple[float, float, float]:
    """Slope at rest in MPa, stress in MPa at no strain, and the sd of that, of a cubic through the beginning
    of a curve; of few points, of a polynomial through 0 and all of them."""
    x, sign = np.abs(strain), -1.0 if strain.sum() < 0 else 1.0
    near = x <= NEAR * min(float(x.max()), 1.0)
    if near.sum() < FEW:
        A = x[:, None] ** np.arange(1.0, 1 + min(4, (len(x) + 1) // 2))
        return float(np.linalg.lstsq(A, sign * stress, rcond=None)[0][0]), 0.0, 0.0
    y, scale = sign * stress[near], float(x[near].max())
    A = (x[near, None] / scale) ** np.arange(4)
    coefficients, *_ = np.linalg.lstsq(A, y, rcond=None)
    variance = float(((y - A @ coefficients) ** 2).sum() / (len(y) - 4))
    sd = float(np.sqrt(variance * np.linalg.pinv(A.T @ A)[0, 0]))
    return float(coefficients[1] / scale), float(coefficients[0]), sd


def true_stress_doubt(headings: Mapping[str, bool]) -> str:
    """Contradiction between a heading that names a true or an engineering quantity and twin.toml, "" without
    one. headings: True for each that is to be read as true."""
    for heading, true in headings.items():
        words = heading.lower()
        if ("true" in words or "log" in words.split()) and not true:
            return f"column {heading!r} seems to be true, not over the size at rest; say so, or name another"
        if any(word in words for word in ("engineering", "nominal")) and true:
            return f"column {heading!r} seems to be over the size at rest, and not true; correct one of them"
    return ""
