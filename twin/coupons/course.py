"""The course of a test: rows in reverse, a specimen that slips or tears, and strains that are held."""

import numpy as np

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
