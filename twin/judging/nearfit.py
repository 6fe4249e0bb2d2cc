"""A fit along a model's response, and solved next to its end.

Between its whole solves a response answers in milliseconds with an error that it states. A descent along it
needs few of them: those far from every other, and the one next to its end, with the derivatives there.
"""

from dataclasses import replace

from twin.judging.fitting import noise_of
from twin.judging.judged import ENDS, SETTLED, Judged, judge
from twin.model.nearmodel import NearModel
from twin.targets import Array, Targets

SURE = 0.1  # of the noise, by which the response may err where derivatives are solved first


def fitted_near(
    model: NearModel, targets: Targets, start: Array, *, seed: int = 0, law: float = 0.0
) -> Judged:
    """The model, fitted and judged from start (d,) or (m, d) along its response, with seed and law as in
    `judge`. It ends at a solve with derivatives from where it would go less than SETTLED, or nowhere that is
    likelier: weights by errors that depend on the parameters do not know that. Raises Unsolvable as `judge`
    does."""
    judged = judge(model, targets, starts=start, seed=seed, law=law)
    if model.error_mm(judged.theta) > SURE * noise_of(targets, judged.errors.gauge):
        model.certify(judged.theta)
        judged = judge(model, targets, starts=judged.theta, seed=seed, law=law)
    for _ in range(ENDS):
        model.certify(judged.theta, derivatives=True)
        end = judge(model, targets, starts=judged.theta, seed=seed, law=law, evaluations=1, turns=0)
        judged = judge(model, targets, starts=end.theta, seed=seed, law=law, tolerance=SETTLED)
        if judged.deviance >= end.deviance:
            last = judged.fit
            fit = replace(end.fit, evaluations=last.evaluations, converged=last.converged, reason=last.reason)
            return replace(end, fit=fit)
    return judged
