"""Faults of a pressure log while the film ran: gaps, dropped samples, a logger that stopped."""

import numpy as np
from numpy.typing import NDArray

from twin.gauge.pressurelog import Log

GAP, GAP_S = 10.0, 0.25  # times the usual spacing, and s, from which samples are missing
CHANGES = 0.1  # share of the log's range by which the pressure may change in a gap
ALONE = 0.2  # share of it by which one sample may lie off both its neighbours
NOISES = 20.0  # times what samples usually lie off both neighbours: 12 sds of white noise
FAST_S = 0.05  # between samples: no chamber fills and empties within two of them
STUCK, STUCK_S = 20, 0.5  # equal samples, and s
NOISY = 0.3  # share of the steps of a log that turn back: two thirds of white noise, hardly one without noise
RESTS = 0.05  # share of the range that a gauge may read while the finger rests


def check_signal(log: Log, *, start: float, end: float) -> tuple[str, ...]:
    """Sentences on a log between the times (s) at which the film starts and ends; ValueError where its
    pressures are wrong."""
    inside = (log.time >= start) & (log.time <= end)
    if inside.sum() < 3 or not np.ptp(log.pressure):
        return ()
    _check_gaps(log, inside)
    return (*_alone(log, inside), *_stuck(log, inside))


def rest_remark(log: Log, *, start: float, rest_s: float) -> str:
    """A sentence where the gauge does not read zero while the finger rests, "" where it does."""
    inside = (log.time >= start) & (log.time <= start + rest_s)
    if not inside.any():
        return ""
    mean, log_range = float(log.pressure[inside].mean()), float(np.ptp(log.pressure))
    if abs(mean) <= RESTS * log_range:
        return ""
    return (
        f"{log.path.name} reads {mean:.2g} MPa while the finger rests ({start:.1f} to {start + rest_s:.1f} "
        f"s), {100 * abs(mean) / log_range:.0f} % of its range; wanted 0, vented. If the gauge's zero "
        "is off, subtract it from the log; if the film starts later than film_start_s says, correct that."
    )


def _check_gaps(log: Log, inside: NDArray[np.bool_]) -> None:
    """Raise ValueError where samples are missing while the pressure changes."""
    step, rise = np.diff(log.time), np.abs(np.diff(log.pressure))
    missing = step > max(GAP * float(np.median(step)), GAP_S)
    bad = np.flatnonzero(missing & (rise > CHANGES * np.ptp(log.pressure)) & (inside[1:] | inside[:-1]))
    if len(bad):
        k = int(bad[0])
        raise ValueError(
            f"{log.path.name} has no sample between {log.time[k]:.2f} and {log.time[k + 1]:.2f} s, while the "
            f"pressure goes from {log.pressure[k]:.3g} to {log.pressure[k + 1]:.3g} MPa; wanted a log "
            "without gaps: restore the missing rows, or record the test again"
        )


def _alone(log: Log, inside: NDArray[np.bool_]) -> tuple[str, ...]:
    """A sentence on samples far off both neighbours; ValueError where samples are so dense that no pressure
    does so."""
    before, after = log.pressure[1:-1] - log.pressure[:-2], log.pressure[1:-1] - log.pressure[2:]
    least = np.minimum(np.abs(before), np.abs(after))
    far = max(ALONE * float(np.ptp(log.pressure)), NOISES * float(np.median(least)))
    off = (before * after > 0) & (least > far) & (np.abs(before - after) < least / 2)
    rows = 1 + np.flatnonzero(off & inside[1:-1])
    if not len(rows):
        return ()
    k = int(rows[0])
    what = (
        f"{log.path.name}: {len(rows)} samples lie far off their neighbours, the first at {log.time[k]:.2f} "
        f"s: {log.pressure[k]:.3g} MPa between {log.pressure[k - 1]:.3g} and {log.pressure[k + 1]:.3g} MPa"
    )
    if float(np.median(np.diff(log.time))) > FAST_S:
        return (f"{what}. Are they real, or has the logger dropped some?",)
    raise ValueError(
        f"{what}; no finger is filled and vented so fast: remove the rows that the logger has dropped"
    )


def _stuck(log: Log, inside: NDArray[np.bool_]) -> tuple[str, ...]:
    """A sentence where a log with noise repeats one value, above its lowest, for long."""
    same, above = np.diff(log.pressure) == 0, log.pressure[1:] > log.pressure.min()
    begin, end = _longest(same & above)
    long = end - begin >= STUCK and log.time[end] - log.time[begin] >= STUCK_S
    if not long or not inside[begin : end + 1].any():
        return ()
    steps = np.delete(np.diff(log.pressure), np.arange(begin, end))[np.delete(above, np.arange(begin, end))]
    if not len(steps) > STUCK or (steps[1:] * steps[:-1] < 0).mean() < NOISY:
        return ()
    return (
        f"{log.path.name} repeats {log.pressure[begin]:.6g} MPa from {log.time[begin]:.2f} to "
        f"{log.time[end]:.2f} s, while its last digits change elsewhere. Has the logger stopped, or has "
        "the gauge reached the end of its range?",
    )


def _longest(flags: NDArray[np.bool_]) -> tuple[int, int]:
    """First and one past the last index of the longest run of flags, (0, 0) without one."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags.astype(np.int8), 0]))
    if not len(edges):
        return 0, 0
    runs = edges.reshape(-1, 2)
    begin, end = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
    return int(begin), int(end)
