"""A recording of one step of pressure whose top alone is known: how its points stand before and in the hold.

How the pressure rises, and how the body rings after it, is not known. So the rest and the mean of the hold
are taken. What still moves in the hold, by a regulator that settles or a silicone that creeps, is an error
that all its values share, and the pressure of the hold has an sd.
"""

from dataclasses import dataclass

import numpy as np

from twin.targets import Array

HOLD = 1 / 3  # of a recording, at its end, is taken for the hold
TOP_SD = 0.02  # of a nominal pressure: what regulators of laboratories keep


@dataclass(frozen=True)
class SettledStep:
    """Places (p, 3) mm at rest and in the hold, by how much they still move in it, and its first row."""

    rest: Array
    hold: Array
    drift: Array
    begins: int


def settled_step(place: Array, rest_steps: int = 1) -> SettledStep:
    """The step that places (s, p, 3) mm show: the mean of the first rows, and of the last third.

    >>> rise = np.concatenate([np.zeros(4), np.linspace(0.8, 1.0, 6), np.ones(5)])
    >>> found = settled_step(rise[:, None, None] * np.ones((1, 1, 3)))
    >>> float(found.hold[0, 0]), float(found.drift[0, 0]), found.begins
    (1.0, 0.0, 10)
    """
    begins = len(place) - max(1, round(HOLD * len(place)))
    held = place[begins:]
    half = len(held) // 2
    drift = np.nanmean(held[half:], axis=0) - np.nanmean(held[: half or 1], axis=0)
    return SettledStep(np.nanmean(place[:rest_steps], axis=0), np.nanmean(held, axis=0), drift, begins)
