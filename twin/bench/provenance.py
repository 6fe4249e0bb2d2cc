"""Provenance of a fit, for fit.json: the engine that solved, priors, and the loss."""

from typing import Any

from calibrate import Fit
from twin.bench.comparison import Judgement
from twin.bench.engines import solved_by
from twin.bench.workbench import Workbench
from twin.judging.likelihood import down_weighted, prior_rows, weights_in_words


def fitted_by(bench: Workbench, fit: Fit, judgement: Judgement) -> dict[str, Any]:
    """Fields of fit.json on the provenance of a fit."""
    targets, residual = bench.targets, bench.targets.value - judgement.predicted
    w, priors = judgement.errors.whitener(targets), prior_rows(fit, targets)
    solver = solved_by(bench.project, bench.jobs)
    words = [f"{solver['release']} solved the model."] if solver["release"] else []
    words += [row.sentence for row in priors]
    words += filter(None, [weights_in_words(targets, residual, w)])
    return solver | {
        "loss": bench.project.config.calibrate.loss, "priors": priors,
        "down_weighted": down_weighted(targets, residual, w), "said": tuple(words),
    }  # fmt: skip
