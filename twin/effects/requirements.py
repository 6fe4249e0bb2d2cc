"""Requirements of effects on the data, each with its test on targets."""

from collections.abc import Callable, Sequence
from enum import StrEnum

import numpy as np

from twin.targets import Targets

UNLOADED = 0.1  # of the top pressure is how far it must fall, for an effect that shows in unloading


class Requirement(StrEnum):
    """A property of the data without which an effect cannot be tested."""

    HISTORY = "history"
    UNLOADING = "unloading"
    GRAVITY = "gravity"


def unloads(targets: Targets) -> bool:
    """True if the pressure at some step is a tenth of its top or more below an earlier one."""
    p = np.interp(targets.time, targets.log_time, targets.log_pressure)
    return bool((np.maximum.accumulate(p) - p).max() >= UNLOADED * p.max())


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
}


def lacking(requires: Sequence[Requirement], targets: Targets) -> str:
    """The first requirement that targets do not meet, as a sentence for the ranking; empty if all are met."""
    for requirement, (met, sentence) in MEANING.items():
        if requirement in requires and not met(targets):
            return f"not testable: {sentence}"
    return ""
