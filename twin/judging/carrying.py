"""A model and where its fit begins -> the fit carried to its end, with law errors as the data ask for them.

A response answers on the way, and every end is certified by a whole solve with its derivatives: what that is
off is learnt, until the fit stays where it was certified.
"""

import numpy as np

from twin.judging.judged import Judged, judge, judge_fit
from twin.judging.lawlevels import with_laws
from twin.model.prediction import Model
from twin.model.response import Surrogate
from twin.targets import Array, Targets

STAYS = 0.1  # sd by which a certified fit may still move: no interval of 2 sds shows it
ENDS = 6  # that are certified


def carried(model: Model, targets: Targets, *, start: Array, seed: int) -> Judged:
    """The judged model at the end of its fit from start (d,). Raises Unsolvable where it has no
    equilibrium."""
    if isinstance(model, Surrogate) and not model.reaches(start):
        model = model.certified(start)
    judged = with_laws(judge(model, targets, starts=start, seed=seed), targets)
    for _ in range(ENDS):
        if not isinstance(model, Surrogate):
            break
        model, fit = model.certified(judged.theta), judged.fit
        judged = with_laws(judge(model, targets, starts=fit.theta, seed=seed), targets)
        moved, free = judged.theta - fit.theta, [n not in judged.at_bound for n in judged.values]
        sd = np.sqrt(np.diag(judged.fit.covariance))
        if np.all(np.abs(moved[free]) < STAYS * sd[free]):
            return judge_fit(model.whole, targets, fit, law=judged.errors.law)
    return judged
