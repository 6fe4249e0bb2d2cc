"""How plain a hidden truth is in a measurement: its non-centrality, and the size that has a given one."""

import numpy as np

from twin.judging.whitening import whitener
from twin.targets import Array, Targets


def plainness(change: Array, targets: Targets, fitted: Array, slope: Array) -> float:
    """The non-centrality of a change (s, p, 3) mm of all points that is hidden in targets: its length in sds
    of the noise once the fitted parameters, derivatives fitted (d, s, p, 3), took what they can of it.

    slope (s, p, 3): dU/dp in mm per MPa, for the gauge's noise. A test of one parameter finds a change of 3
    in half of the films at a level of 0.3 %.
    """
    nothing = np.zeros((0, *targets.value.shape))
    w = whitener(targets, prediction_modes=nothing, gauge=slope * targets.pressure_sd[:, None, None])
    rows = w.whiten(fitted).T
    z = w.whiten(_relative(change, targets))
    return float(np.linalg.norm(z - rows @ np.linalg.lstsq(rows, z, rcond=1e-12)[0]))


def _relative(change: Array, targets: Targets) -> Array:
    return change - change[targets.reference].mean(axis=0)
