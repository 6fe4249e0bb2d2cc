"""A fit along a model's response, and solved next to its end.

Between its whole solves a response answers in milliseconds with an error that it states. A descent along it
needs few of them: those far from every other, and the one next to its end, with the derivatives there.
"""

from collections.abc import Callable

import numpy as np

from twin.judging.fitting import noise_of
from twin.judging.judged import ENDS, SETTLED, Judged
from twin.model.nearmodel import NearModel
from twin.model.prediction import Model
from twin.targets import Array, Targets

SURE = 0.1  # of the noise, by which the response says that it may err at the end
ALONG = 0.1  # sd to which a fit is carried before its end is solved


def fitted_near(
    model: NearModel, targets: Targets, fit: Callable[[Model, Array, float], Judged], start: Array
) -> Judged:
    """The model, fitted and judged from start (d,) or (m, d) by `fit(model, start, tolerance)` along its
    response. At the end that errs by less than SURE of the noise, or a solve with derivatives is within
    SETTLED. Raises Unsolvable as `fit` does."""
    judged = fit(model, start, ALONG)
    limit = SURE * noise_of(targets, judged.errors.gauge)
    if model.error_mm(judged.theta) > limit:
        model.certify(judged.theta)
        judged = fit(model, judged.theta, ALONG)
    for _ in range(ENDS):
        model.certify(end := judged.theta, derivatives=True)
        judged = fit(model, end, SETTLED)
        settled = bool(np.all(np.abs(judged.theta - end) <= SETTLED * judged.fit.sd))
        if settled or model.error_mm(judged.theta) <= limit:
            break
    return judged
