"""Which steps of targets are not quasi-static: where inertia moves the finger off its equilibrium."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.targets import Array, Targets

FITTED = 1 / 3  # of a period, over which a parabola is fitted to the motion
FRAMES = 5  # in it, at least
FEWEST = 6.0  # frames a period, from which such a vibration can be seen
COUNTS = 1.0  # sds of a value, from which inertia counts
SURE = 4.0  # sds of its own noise, from which it is one
SHOWN = 3  # spans that a sentence tells
MAD_SD = 1.4826  # sds of noise in its median size
POLYGON = 30  # times of a course, up to which its corners are meant
BESIDE = 0.25  # of a period, beside which the ringing goes through its equilibrium


def inertia(targets: Targets, hz: float) -> tuple[Array, Array]:
    """How far the inertia moves the finger off its equilibrium at each step (s,) mm, and the sd (s,) of that.

    In a vibration of `hz` the error of statics x - u obeys x'' + omega^2 (x - u) = 0, so that it is x'' /
    omega^2; x'' is that of a parabola through the measured motion. Largest over the points of the finger; 0
    where the steps are too few to show such a vibration.
    """
    moved, sd = np.zeros(len(targets.time)), np.zeros(len(targets.time))
    value = np.where(targets.valid, targets.value, np.nan)[:, ~targets.fixed]
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3)[:, ~targets.fixed]
    for block in np.unique(targets.block):
        rows = np.flatnonzero(targets.block == block)
        size, noise, k = _accelerations(targets.time[rows], value[rows], hz)
        moved[rows] = size
        sd[rows] = noise * np.sqrt(np.nansum(variance[rows, k], axis=-1))
    omega2 = (2 * np.pi * hz) ** 2
    return moved / omega2, sd / omega2


def _accelerations(time: Array, value: Array, hz: float) -> tuple[Array, Array, NDArray[np.intp]]:
    """The largest acceleration (s,) mm/s2 of points (s, p, 3) mm, the noise (s,) of one value's in it, and
    which point (s,) has it, by parabolas through FITTED of a period; 0 where times are too few."""
    size, noise, which = np.zeros(len(time)), np.zeros(len(time)), np.zeros(len(time), np.intp)
    step = float(np.median(np.diff(time))) if len(time) >= FRAMES else np.inf
    if step * hz * FEWEST > 1:
        return size, noise, which
    half = max(FITTED / hz / 2, step * (FRAMES - 1) / 2) + step / 100
    for row, now in enumerate(time):
        near = np.flatnonzero(np.abs(time - now) <= half)
        if len(near) < FRAMES:
            continue
        dt = time[near] - now
        weight = 2 * np.linalg.pinv(np.column_stack([np.ones_like(dt), dt, dt**2]))[2]
        sizes = np.linalg.norm(np.nan_to_num(np.tensordot(weight, value[near], axes=1)), axis=1)
        which[row] = sizes.argmax()
        size[row], noise[row] = sizes[which[row]], np.linalg.norm(weight)
    return size, noise, which


def not_static(targets: Targets, hz: float) -> NDArray[np.bool_]:
    """Flags (s,) of the steps that inertia moves by more than their sd, and of those within a quarter of a
    period of one: a ringing finger goes through its equilibrium."""
    moved, noise = inertia(targets, hz)
    sd = typical_sd(targets)
    counts = targets.time[(moved > COUNTS * sd) & (moved > SURE * noise)]
    if not len(counts):
        return np.zeros(len(moved), bool)
    return np.asarray(np.abs(targets.time[:, None] - counts[None]).min(axis=1) <= BESIDE / hz)


def typical_sd(targets: Targets) -> float:
    """The sd in mm that the finger's displacements typically have."""
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3)[:, ~targets.fixed]
    return float(np.sqrt(np.nanmedian(np.where(variance > 0, variance, np.nan))))


def fast_times(targets: Targets, time: Array, pressure: Array, hz: float) -> Array:
    """The times (k,) s of a course of pressures (t,) MPa at (t,) s, at which inertia would move the finger by
    more than the sd of the targets: by the measure of `not_static`, as far as the film shows it to move a
    MPa. The noise of the log, by its fourth differences, is no motion."""
    high, low = (np.where(targets.valid, targets.value, bound) for bound in (-np.inf, np.inf))
    reach = float((high.max(axis=0) - low.min(axis=0))[~targets.fixed].max())
    range_MPa = float(np.ptp(targets.pressure))
    if not range_MPa:
        return np.zeros(0)
    grid = np.arange(time[0] - 1 / hz, time[-1] + 1 / hz, 1 / (2 * FEWEST * hz))
    motion = np.interp(grid, time, pressure) * reach / range_MPa
    size, noise, _ = _accelerations(grid, motion[:, None, None], hz)
    rough = float(np.median(np.abs(np.diff(pressure, 4)))) if len(pressure) > POLYGON else 0.0
    noise *= MAD_SD * rough / np.sqrt(70) * reach / range_MPa
    least = COUNTS * typical_sd(targets) * (2 * np.pi * hz) ** 2
    return np.asarray(grid[(size > least) & (size > SURE * noise)])


def without_ringing(targets: Targets, hz: float) -> Targets:
    """The targets whose steps that are not quasi-static are no data."""
    return replace(targets, valid=targets.valid & ~not_static(targets, hz)[:, None, None])


def spans(time: Array, flags: Sequence[bool] | NDArray[np.bool_]) -> list[tuple[float, float]]:
    """First and last time of each run of flagged steps.

    >>> spans(np.array([0.0, 0.1, 0.2, 0.3]), [False, True, True, False])
    [(0.1, 0.2)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, int), [0]])))
    return [(float(time[a]), float(time[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def said(targets: Targets, hz: float, source: str) -> str:
    """A sentence on the steps that are not quasi-static, and what statics make of them; "" for none.

    source: where the frequency comes from.
    """
    flags = not_static(targets, hz)
    if not flags.any():
        return ""
    moved = inertia(targets, hz)[0]
    where = [f"{a:.2f} to {b:.2f} s" for a, b in spans(targets.time, flags)]
    more = f" and {len(where) - SHOWN} more" if len(where) > SHOWN else ""
    return (
        f"{int(flags.sum())} of {len(flags)} steps are not quasi-static ({', '.join(where[:SHOWN])}{more}): "
        f"inertia moves the finger by up to {moved.max():.2g} mm off its equilibrium there, as it rings at "
        f"{hz:.3g} Hz ({source}). Fits take that for statics. To leave these steps out, write ringing_Hz = "
        f"{hz:.3g} under [calibrate] of twin.toml; to follow them, effects = [\"inertia\"] under [model]."
    )

