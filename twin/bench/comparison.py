"""A judged model beside its targets, written into its run: comparison, prediction, held-out films.

What it was judged by is kept too, so that `compare` needs no solve for what calibrate or add has solved.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibrate import Fit
from twin import files
from twin.bench.workbench import Workbench
from twin.judging.comparison import Comparison, compare, right_in_words
from twin.judging.fitrecord import UnseenFilm
from twin.judging.fitting import ModelErrors
from twin.judging.heldout import unseen
from twin.judging.judged import Judged, judged_by
from twin.judging.lawerrors import LawError
from twin.judging.whitening import LAW
from twin.messages import Say
from twin.model.arraycache import code_digest
from twin.project.folder import Project, Run
from twin.targets import Array, Targets

JUDGED = "judged.npz"
ARRAYS = ("code", "theta", "u", "jacobian", "gauge", "modes", "law", "crossed")  # in it


def compared(run: Run, theta: Array, one: "Judgement", bench: Workbench, say: Say) -> Comparison:
    """The comparison of a model at its fit theta (d,), written to comparison.json, prediction.npz and
    judged.npz of its run; what it foretells of held-out films is said."""
    keep(run, theta, one)
    held = foretold(bench, one)
    write_comparison(run, one.predicted, one.comparison, held)
    for row in held:
        say(f"Held out, {row.film}: {row.raw_rms_mm:.3f} mm rms, foretold by a fit that never saw it. "
            f"{right_in_words(row)}")
    return one.comparison


def foretold(bench: Workbench, one: "Judged | Judgement") -> tuple[UnseenFilm, ...]:
    """What a fitted model is off from each film that was held out of its fit."""
    return unseen(one.errors, one.predicted, one.jacobian, bench.targets, film_names(bench.project))


def write_comparison(run: Run, predicted: Array, found: Comparison, held: Sequence[UnseenFilm]) -> None:
    run.write(found.record(held))
    write_prediction(run, predicted, found)
    run.summary["headline"] = found.where


def write_prediction(run: Run, predicted: Array, found: Comparison) -> None:
    """Write prediction.npz: displacements, residual and cleaned residual (`Comparison`), (s, p, 3) mm."""
    run.write_npz("prediction.npz", {"u": predicted, "residual": found.residual, "cleaned": found.cleaned})


def film_names(project: Project) -> dict[int, str]:
    """The name of the film in each block of the targets; none where one film was measured, or elsewhere."""
    return {film.block: film.name for film in project.source().films}


# -- what a fit was judged by --------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """A fit's prediction (s, p, 3) mm, the comparison with the targets, the errors that its model states, the
    derivatives (f, s, p, 3) by what is free, and where walls have crossed."""

    predicted: Array
    comparison: Comparison
    errors: ModelErrors
    jacobian: Array
    crossed: str

    @staticmethod
    def of(judged: Judged) -> "Judgement":
        """That of a model judged now."""
        return Judgement(
            predicted=judged.predicted,
            comparison=judged.comparison,
            errors=judged.errors,
            jacobian=judged.jacobian,
            crossed=judged.model.solution(judged.theta).crossed,
        )


def keep(run: Run, theta: Array, one: Judgement, *, file: str = JUDGED) -> None:
    """Write judged.npz of a run: what a comparison needs of the model at its fit theta (d,)."""
    e = one.errors
    run.write_npz(
        file,
        {
            "code": np.array(code_digest()), "theta": theta, "u": one.predicted, "jacobian": one.jacobian,
            "gauge": e.gauge, "modes": e.modes, "law": np.array(e.law), "crossed": np.array(one.crossed),
            **{f"{LAW}{law.effect}": law.modes for law in e.laws},
        },
    )  # fmt: skip


def kept(fit_file: Path, fit: Fit, targets: Targets, *, file: str = JUDGED) -> Judgement | None:
    """The judgement of the fit in fit.json, from what lies beside it; None where it was not kept, or not by
    the code of now. Whether the fit still holds is asked before (`twin.bench.fits`)."""
    path = fit_file.with_name(file)
    if not path.is_file():
        return None
    found = files.read_npz(path, *ARRAYS)
    if str(found["code"]) != code_digest() or not np.array_equal(found["theta"], fit.theta):
        return None
    errors = ModelErrors(
        gauge=found["gauge"],
        modes=found["modes"],
        laws=tuple(LawError(k.removeprefix(LAW), rows) for k, rows in found.items() if k.startswith(LAW)),
        law=float(found["law"]),
    )
    own, w = judged_by(targets, found["u"], errors, errors.whitener(targets))
    jacobian = found["jacobian"]
    made = compare(own, found["u"], w, jacobian=jacobian, at_bound=len(fit.at_bound))
    return Judgement(
        predicted=found["u"], comparison=made, errors=errors, jacobian=jacobian, crossed=str(found["crossed"])
    )


def kept_errors(fit_file: Path, fit: Fit, targets: Targets) -> ModelErrors | None:
    """The errors that the model of the fit in fit.json has there; None where `kept` has none."""
    judgement = kept(fit_file, fit, targets)
    return None if judgement is None else judgement.errors
