"""Answers over a range of parameters -> how much of each target's variance each parameter makes.

The first-order index of a parameter is the share of the variance that goes if it alone is known. Its total
index is the share that is left if all others are known:

    S_i = V[E(y | x_i)] / V(y),    T_i = E[V(y | all x but x_i)] / V(y)

(Sobol 2001, doi:10.1016/S0378-4754(00)00270-6), by the estimators of Saltelli et al. 2010
(doi:10.1016/j.cpc.2009.09.018) as SALib has them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.targets import Array

DRAWS = 512
STILL = 1e-9  # of a target's size: it does not change at all


@dataclass(frozen=True)
class SobolIndices:
    """First-order and total indices (t, d) of targets by parameters, without unit, each with the half width
    of its 95 % interval (t, d). A target that nothing changes has 0."""

    first: Array
    total: Array
    first_half: Array
    total_half: Array


def sobol_indices(
    answers: Callable[[Array], Array], low: Array, high: Array, *, draws: int = DRAWS, seed: int = 0
) -> SobolIndices:
    """The indices of targets, where every parameter is alike likely between low (d,) and high (d,).

    answers: targets (t,) at theta (d,); it is asked draws (d + 2) times. draws: a power of 2.

    Raises ValueError for other draws, and where SALib is not installed.
    """
    if draws < 2 or draws & (draws - 1):
        raise ValueError(f"draws = {draws}: wanted a power of 2, such as {DRAWS}")
    try:
        from SALib.analyze import sobol as analysis
        from SALib.sample import sobol as sampling
    except ImportError:
        raise ValueError("Sobol indices need SALib, which is not installed; run pip install SALib") from None
    names = [f"x{k}" for k in range(len(low))]
    problem = {"num_vars": len(low), "names": names, "bounds": np.stack([low, high], axis=1).tolist()}
    points = sampling.sample(problem, draws, calc_second_order=False, seed=seed)
    y = np.array([answers(theta) for theta in points])
    rows = np.zeros((4, y.shape[1], len(low)))
    for k, target in enumerate(y.T):
        if np.ptp(target) > STILL * np.abs(target).max():
            indices = analysis.analyze(problem, target, calc_second_order=False, seed=seed)
            rows[:, k] = [indices[key] for key in ("S1", "ST", "S1_conf", "ST_conf")]
    return SobolIndices(*rows)
