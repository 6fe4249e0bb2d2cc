"""What a fit was judged by, kept beside it: `compare` needs no solve for what calibrate or add has solved."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibrate import Fit
from twin.judging.comparison import Comparison, compare
from twin.judging.fitting import ModelErrors
from twin.judging.judged import Judged
from twin.model.arraycache import code_digest
from twin.project import files
from twin.project.folder import Run
from twin.targets import Array, Targets

JUDGED = "judged.npz"


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """A fit's prediction (s, p, 3) mm, the comparison with the targets, and where walls have crossed."""

    predicted: Array
    comparison: Comparison
    crossed: str

    @staticmethod
    def of(judged: Judged) -> "Judgement":
        """That of a model judged now."""
        crossed = judged.model.solution(judged.theta).crossed
        return Judgement(predicted=judged.predicted, comparison=judged.comparison, crossed=crossed)


def keep(run: Run, judged: Judged) -> None:
    """Write judged.npz of a run: what a comparison needs of the model at its fit."""
    e = judged.errors
    run.write_npz(
        JUDGED,
        {
            "code": np.array(code_digest()), "theta": judged.theta, "u": judged.predicted,
            "jacobian": judged.jacobian, "gauge": e.gauge, "modes": e.modes,
            "crossed": np.array(judged.model.solution(judged.theta).crossed),
        },
    )  # fmt: skip


def kept(fit_file: Path, fit: Fit, targets: Targets) -> Judgement | None:
    """The judgement of the fit in fit.json, from what lies beside it; None where it was not kept, or not by
    the code of now. Whether the fit still holds is asked before (`twin.bench.fits`)."""
    path = fit_file.with_name(JUDGED)
    if not path.is_file():
        return None
    found = files.read_npz(path)
    if str(found["code"]) != code_digest() or not np.array_equal(found["theta"], fit.theta):
        return None
    errors = ModelErrors(gauge=found["gauge"], modes=found["modes"])
    bound = len(fit.at_bound)
    w, jacobian = errors.whitener(targets), found["jacobian"]
    made = compare(targets, found["u"], w, jacobian=jacobian, at_bound=bound)
    return Judgement(predicted=found["u"], comparison=made, crossed=str(found["crossed"]))
