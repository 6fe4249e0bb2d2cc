"""Requirements of effects on the data, each with its test on targets."""

from collections.abc import Callable, Sequence
from enum import StrEnum

import numpy as np

from fe.dynamics.onevibration import driven
from twin.targets import Array, Targets

UNLOADED = 0.1  # of the top pressure is how far it must fall, for an effect that shows in unloading
SLOWEST_Hz = 2.0  # of fingers: what does not swing at it swings at no faster one; it sags by 60 mm or more
FRAMES = 4.0  # a period, from which a vibration is not taken for a slower one
DENSE = 12  # frames that are as near to each other as that: three periods
OCTAVE = 2.0  # times SLOWEST_Hz: a film that shows no more of the frequencies of fingers cannot tell them
SWING = 0.02  # of the range of the pressure, by which the slowest finger must swing: 1 mm of 50
LITTLE = 0.05  # of a damping ratio, of such a finger


class Requirement(StrEnum):
    """A property of the data without which an effect cannot be tested."""

    HISTORY = "history"
    UNLOADING = "unloading"
    GRAVITY = "gravity"
    FAST = "fast"


def unloads(targets: Targets) -> bool:
    """True if the pressure at some step is a tenth of its top or more below an earlier one."""
    p = np.interp(targets.time, targets.log_time, targets.log_pressure)
    return bool((np.maximum.accumulate(p) - p).max() >= UNLOADED * p.max())


def fastest_Hz(time: Array) -> float:
    """The highest frequency of which times (s,) s show DENSE frames, FRAMES in a period; 0 for fewer times.

    >>> import numpy as np
    >>> round(fastest_Hz(np.append(np.arange(0.0, 50.0, 0.5), 50.0 + np.arange(0.02, 1.0, 0.02))), 6)
    12.5
    """
    gaps = np.sort(np.diff(time))
    return float(1 / (FRAMES * gaps[DENSE - 1])) if len(gaps) >= DENSE else 0.0


def swings(targets: Targets) -> bool:
    """True if the slowest finger would swing by SWING of the range of the pressure, as its course is, at a
    step of a film with frames enough to tell at which frequency."""
    time = targets.time[targets.valid.any(axis=(1, 2))]
    if not targets.has_log or fastest_Hz(time) < OCTAVE * SLOWEST_Hz:
        return False
    p, omega = targets.log_pressure, 2 * np.pi * SLOWEST_Hz
    off = driven(targets.log_time, p, omega=omega, damping=LITTLE) - p
    return bool(np.abs(np.interp(time, targets.log_time, off)).max() > SWING * np.ptp(p))


MEANING: dict[Requirement, tuple[Callable[[Targets], bool], str]] = {
    Requirement.HISTORY: (
        lambda targets: bool(targets.has_log),
        "needs the pressure between the steps (targets/pressure.csv)",
    ),
    Requirement.GRAVITY: (
        lambda targets: targets.gravity is not None,
        "needs the direction of gravity (twin.toml [model], or targets.toml by block)",
    ),
    Requirement.UNLOADING: (unloads, "needs steps at which the pressure has fallen"),
    Requirement.FAST: (
        swings,
        "needs a fast change of the pressure, and steps at 16 frames a second or more after it",
    ),
}


def lacking(requires: Sequence[Requirement], targets: Targets) -> str:
    """The first requirement that targets do not meet, as a sentence for the ranking; empty if all are met."""
    for requirement, (met, sentence) in MEANING.items():
        if requirement in requires and not met(targets):
            return f"not testable: {sentence}"
    return ""
