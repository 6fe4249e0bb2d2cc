"""A judged model beside its targets, written into its run: comparison, prediction, held-out films.

The errors and derivatives that it was judged by are stored too, so that `compare` solves nothing again.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibrate import Fit
from twin import files
from twin.bench.engines import solved_by
from twin.bench.workbench import Workbench
from twin.coupons.pulltest import PullTest
from twin.judging.comparison import Comparison, compare, right_in_words
from twin.judging.fitrecord import MaterialTestRow, MaterialTestsRow, UnseenFilm
from twin.judging.fitting import ModelErrors
from twin.judging.heldout import unseen
from twin.judging.judged import Judged, free_names, judged_by
from twin.judging.lawerrors import LawError
from twin.judging.likelihood import down_weighted, prior_rows, weights_in_words
from twin.judging.whitening import LAW
from twin.messages import Say
from twin.model.arraycache import code_digest
from twin.project.folder import Project, Run
from twin.targets import Array, Targets

JUDGED = "judged.npz"
ARRAYS = ("code", "theta", "u", "jacobian", "gauge", "modes", "law", "crossed")  # in it


def compared(run: Run, theta: Array, judgement: "Judgement", bench: Workbench, say: Say) -> Comparison:
    """The comparison of a model at its fit theta (d,), written to comparison.json, prediction.npz and
    judged.npz of its run; prints the error of each held-out film."""
    keep(run, theta, judgement)
    held = foretold(bench, judgement)
    write_comparison(run, judgement.predicted, judgement.comparison, held)
    for row in held:
        say(f"Held out, {row.film}: {row.raw_rms_mm:.3f} mm rms, foretold by a fit that never saw it. "
            f"{right_in_words(row)}")
    return judgement.comparison


def foretold(bench: Workbench, judgement: "Judged | Judgement") -> tuple[UnseenFilm, ...]:
    """Errors of a fitted model in each film that was held out of its fit."""
    names = film_names(bench.project)
    return unseen(judgement.errors, judgement.predicted, judgement.jacobian, bench.targets, names)


def write_comparison(run: Run, predicted: Array, comparison: Comparison, held: Sequence[UnseenFilm]) -> None:
    run.write(comparison.record(held))
    write_prediction(run, predicted, comparison)
    run.summary["headline"] = comparison.where


def write_prediction(run: Run, predicted: Array, comparison: Comparison) -> None:
    """Write prediction.npz: displacements, residual and cleaned residual (`Comparison`), (s, p, 3) mm."""
    residual = {"residual": comparison.residual, "cleaned": comparison.cleaned}
    run.write_npz("prediction.npz", {"u": predicted} | residual)


def film_names(project: Project) -> dict[int, str]:
    """The name of the film in each block of the targets; none where one film was measured, or elsewhere."""
    return {film.block: film.name for film in project.source().films}


# -- the stored judgement of a fit ---------------------------------------------------------------------------


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
        """The judgement of a model that was judged in this process."""
        return Judgement(
            predicted=judged.predicted,
            comparison=judged.comparison,
            errors=judged.errors,
            jacobian=judged.jacobian,
            crossed=judged.model.values(judged.theta).solution.crossed,
        )


def keep(run: Run, theta: Array, judgement: Judgement, *, file: str = JUDGED) -> None:
    """Write judged.npz of a run: what a comparison needs of the model at its fit theta (d,)."""
    e = judgement.errors
    run.write_npz(
        file,
        {
            "code": np.array(code_digest()), "theta": theta, "u": judgement.predicted,
            "jacobian": judgement.jacobian, "gauge": e.gauge, "modes": e.modes,
            "names": np.array(e.names, dtype=str), "law": np.array(e.law),
            "crossed": np.array(judgement.crossed),
            **{f"{LAW}{law.effect}": law.modes for law in e.laws},
        },
    )  # fmt: skip


def kept(fit_file: Path, fit: Fit, targets: Targets, *, file: str = JUDGED) -> Judgement | None:
    """The judgement of the fit in fit.json, from the file beside it; None where that is missing, or another
    version of the code wrote it. The caller has checked that the fit is valid (`twin.bench.fits`)."""
    path = fit_file.with_name(file)
    if not path.is_file():
        return None
    arrays = files.read_npz(path, *ARRAYS)
    if str(arrays["code"]) != code_digest() or not np.array_equal(arrays["theta"], fit.theta):
        return None
    errors = ModelErrors(
        gauge=arrays["gauge"],
        modes=arrays["modes"],
        names=tuple(arrays["names"].tolist()),
        laws=tuple(LawError(k.removeprefix(LAW), rows) for k, rows in arrays.items() if k.startswith(LAW)),
        law=float(arrays["law"]),
    )
    judged_targets, w = judged_by(targets, arrays["u"], errors, errors.whitener(targets))
    jacobian = arrays["jacobian"]
    comparison = compare(
        judged_targets, arrays["u"], w, jacobian=jacobian, at_bound=len(fit.at_bound), names=free_names(fit)
    )
    return Judgement(
        predicted=arrays["u"], comparison=comparison, errors=errors, jacobian=jacobian,
        crossed=str(arrays["crossed"]),
    )  # fmt: skip


def kept_errors(fit_file: Path, fit: Fit, targets: Targets) -> ModelErrors | None:
    """The errors that the model of the fit in fit.json has there; None where `kept` has none."""
    judgement = kept(fit_file, fit, targets)
    return None if judgement is None else judgement.errors


PICTURE = "material-tests.png"


def told_of_tests(tests: Sequence[PullTest], agreement: MaterialTestsRow | None) -> Iterator[str]:
    """Sentences on the tests of the silicone that a fit has used; none without tests."""
    if agreement is None:
        return
    for test in tests:
        yield from test.remarks
    for row in agreement.tests:
        yield _row(row)
    yield agreement.sentence


def _row(row: MaterialTestRow) -> str:
    shared = ", ".join(f"{name} {size:+.1f} sd" for name, size in row.shared_sd.items())
    left_out = f"; {row.left_out} rows beyond are left out" if row.left_out else ""
    return (
        f"Material test {row.name}: {row.rms_MPa:.2g} MPa rms up to a stretch of {row.up_to:.2f} "
        f"({row.count} values{left_out}). Its chi2 is {row.chi2:.3g}; errors that all its "
        f"values share: {shared}."
    )


def write_curves(run: Run, agreement: MaterialTestsRow | None) -> None:
    """Write material-tests.png into a run: measured and fitted nominal stress; nothing without tests."""
    if agreement is not None:
        from twin.drawing.fitplots import draw_curves

        run.write_bytes(PICTURE, draw_curves(agreement.tests))


def fitted_by(bench: Workbench, fit: Fit, judgement: Judgement) -> dict[str, Any]:
    """Fields of fit.json on the provenance of a fit."""
    targets, residual = bench.targets, bench.targets.value - judgement.predicted
    w, priors = judgement.errors.whitener(targets), prior_rows(fit, targets)
    solver = solved_by(bench.project, bench.jobs)
    words = [f"{solver['release']} solved the model."] if solver["release"] else []
    words += [row.sentence for row in priors]
    words += filter(None, [weights_in_words(targets, residual, w)])
    return solver | {
        "carried_MPa": bench.carried and (bench.carried.fitted, bench.carried.held_out),
        "loss": bench.project.config.calibrate.loss, "priors": priors,
        "down_weighted": down_weighted(targets, residual, w), "said": tuple(words),
    }  # fmt: skip
