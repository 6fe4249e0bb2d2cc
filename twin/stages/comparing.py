"""The compare stage: whether the model agrees with the measurement within the noise, and where not."""

from typing import Any

from calibrate import Fit
from twin.diagnosis.comparison import Comparison, compare
from twin.diagnosis.fitting import whitener_of
from twin.diagnosis.whitening import Whitener
from twin.model.prediction import Model
from twin.project.folder import Project, Run, Say
from twin.stages.fits import newest_fit
from twin.stages.workbench import Workbench
from twin.targets import Array


def run_compare(project: Project, say: Say) -> dict[str, Any]:
    """Whether the calibrated model agrees with the measurement within the noise, and where not."""
    bench, fit = Workbench.of(project), newest_fit(project)
    with project.new_run("compare") as run:
        model = bench.model()
        w = whitener_of(model, fit.theta, bench.targets, bench.mesh(fit.theta, model, say))
        found = compared(run, bench, model, fit, w)
        for line in (*bench.remarks, model.extent, *_lines(found)):
            run.note(line)
        crossed = model.solution(fit.theta).crossed
    say(found.where)
    if crossed:
        say(f"{crossed}; the model knows no such contact.")
    say(f"Wrote {project.shown(run.folder)}/comparison.json, with tables by marker, pressure and direction.")
    return {"stage": "compare", "run": run.name} | found.to_dict()


def compared(run: Run, bench: Workbench, model: Model, fit: Fit, w: Whitener) -> Comparison:
    """The comparison of a fit, written to comparison.json and prediction.npz of its run."""
    predicted = model.predict(fit.theta)
    found = compare(bench.targets, predicted, w, jacobian=model.jacobian(fit.theta))
    run.write_json("comparison.json", found.to_dict())
    write_prediction(run, predicted, found)
    run.summary["headline"] = found.where
    return found


def write_prediction(run: Run, predicted: Array, found: Comparison) -> None:
    """Write prediction.npz: displacements, residual and cleaned residual, (s, p, 3) mm each."""
    run.write_npz("prediction.npz", {"u": predicted, "residual": found.residual, "cleaned": found.cleaned})


def _lines(found: Comparison) -> list[str]:
    """The root mean square in mm by marker, direction, pressure and branch, a line each."""
    return [f"rms in mm by {kind}: {', '.join(map(_measured, rows))}" for kind, rows in found.maps.items()]


def _measured(row: dict[str, Any]) -> str:
    return f"{row['name']} {row['rms_mm']:.3f}" if row["count"] else f"{row['name']} nothing measured"
