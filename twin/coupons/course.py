"""The course of a test: rows in reverse, a specimen that slips or tears, strains that are held, and likely
faults: a wrong unit, true stress, a preload."""

from collections.abc import Mapping

import numpy as np

from fe.homogeneous import SLOPES, Kind
from twin.targets import Array

DROP = 0.1  # share of its largest by which no stress of a sound specimen falls while the strain rises
NOISES = 8.0  # times the noise of a stress, that a fall is
TORN = 0.3  # share of the stress before it, below which a torn specimen stays
STILL = 0.002  # of the strain's range, that a held strain varies by
HELD = 5  # rows at least
RELAXES = 0.02  # share of the stress that it falls by in a hold


def is_reversed(load: Array, time: Array | None) -> bool:
    """True for rows (k,) that stand newest first: the load falls from its largest value to none, or times,
    where there are any, fall.

    >>> is_reversed(np.array([2.0, 1.0, 0.0]), None), is_reversed(np.array([2.0, 1.0, 0.0]), np.arange(3.0))
    (True, False)
    """
    if time is not None and len(time) > 1 and not (np.diff(time) <= 0).all():
        return False
    most = float(np.abs(load).max())
    falls = abs(float(load[0])) >= 0.9 * most and abs(float(load[-1])) <= 0.1 * most
    return bool(most > 0 and (falls or (time is not None and time[0] > time[-1])))


def noise_of(stress: Array) -> float:
    """The sd of white noise in a smooth curve (k,), from its second differences; robust against steps."""
    return float(np.median(np.abs(np.diff(stress, 2)))) * 1.4826 / np.sqrt(6) if len(stress) > 4 else 0.0


def find_drop(strain: Array, stress: Array) -> tuple[int, float, bool] | None:
    """The row before the first fall of a stress (k,) on a loading branch, by which share it falls, and True
    where it stays down as in a torn specimen; None without a fall.

    >>> strain = np.linspace(0, 1, 101)
    >>> find_drop(strain, np.where(strain > 0.4, 0.7, 1.0) * strain)[0]
    40
    >>> find_drop(strain, strain) is None
    True
    """
    most, noise = np.maximum.accumulate(stress), NOISES * noise_of(stress)
    low = (stress < (1 - DROP) * most - noise) & (strain > 0) & (most > 0)
    for k in np.flatnonzero(low).tolist():
        top = int(np.argmax(stress[:k]))
        after = stress[k : k + 3]
        if strain[k] <= strain[top] + STILL * float(strain.max()) or np.median(after) > (1 - DROP) * most[k]:
            continue  # a hold, or one odd row
        ends = float(np.abs(stress[k:]).max()) < TORN * most[k]
        return top, float(1 - np.min(after) / most[k]), ends
    return None


def find_holds(strain: Array, stress: Array) -> list[tuple[int, int]]:
    """First and last row of each hold: rows whose strain (k,) stays while the stress (k,) relaxes.

    >>> strain = np.repeat([0.1, 0.2], 20)
    >>> find_holds(strain, strain * (1 - 0.1 * (1 - np.exp(-np.tile(np.arange(20), 2) / 5))))
    [(0, 19), (20, 39)]
    """
    near, out, begin = STILL * float(np.ptp(strain) or 1.0), [], 0
    for k in range(1, len(strain) + 1):
        if k < len(strain) and abs(strain[k] - strain[begin]) <= near:
            continue
        size = np.abs(stress[begin:k])
        if k - begin >= HELD and abs(strain[begin]) > 10 * near:
            top = begin + int(np.argmax(size[: max(len(size) // 3, 1)]))
            fall, noise = (
                float(np.abs(stress[top]) - np.median(size[-3:])),
                float(np.std(np.diff(size[-len(size) // 2 :]))),
            )
            if fall > max(RELAXES * float(np.abs(stress[top])), 3 * noise):
                out.append((top, k - 1))
        begin = k
    return out


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
