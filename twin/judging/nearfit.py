"""A fit along a model's response, and solved at its end.

Between its whole solves a response answers in milliseconds with an error that it states. A descent along it
needs few of them: those far from every other, and the one at its end, with the derivatives there.
"""

from collections.abc import Callable
from dataclasses import replace

from twin.judging.fitting import noise_of
from twin.judging.judged import Judged
from twin.model.nearmodel import NearModel
from twin.targets import Array, Targets

NEARBY = 0.25  # of the noise: a response that states so small an error serves for a whole solve
EXACT = 0.02  # of the noise, by which the response may err at the end: of the demo 0.8 um
ENDS = 4  # ends that are solved at most


def fitted_near(
    model: NearModel, targets: Targets, fit: Callable[[NearModel, Array], Judged], start: Array
) -> Judged:
    """The whole model, fitted and judged from start (d,) or (m, d) by `fit`, along its response. What that
    answers at the end errs by less than EXACT of the noise. Raises Unsolvable as `fit` does."""
    judged = fit(model, start)
    model.certify(judged.theta)
    judged = fit(model, judged.theta)
    for _ in range(ENDS):
        model.certify(judged.theta, derivatives=True)
        judged = fit(model, judged.theta)
        if model.error_mm(judged.theta) <= EXACT * noise_of(targets, judged.errors.gauge):
            break
    return replace(judged, model=model.whole)
