"""How far the rms of pulls (error over stated sd) may lie from 1 for its number of values alone."""

import numpy as np


def band(count: float, sds: float = 3.0) -> tuple[float, float]:
    """Least and largest rms of so many independent pulls: their sd is 1 / sqrt(2 count).

    Values that share an error count as one: say beside the call how many there are, and why.
    """
    spread = sds / np.sqrt(2.0 * count)
    return max(1.0 - spread, 0.0), 1.0 + spread
