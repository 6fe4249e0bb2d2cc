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
        crossed = model.solution(fit.theta).crossed
    for sentence in (*bench.remarks, model.extent):
        say(f"compare: {sentence}")
    say(f"compare: {found.where}")
    if crossed:
        say(f"compare: {crossed}; the model knows no such contact")
    for line in _lines(found):
        say(line)
    say(f"compare: wrote {project.shown(run.folder)}/comparison.json")
    return {"stage": "compare", "run": run.name} | found.to_dict()


def compared(run: Run, bench: Workbench, model: Model, fit: Fit, w: Whitener) -> Comparison:
    predicted = model.predict(fit.theta)
    found = compare(bench.targets, predicted, w, jacobian=model.jacobian(fit.theta))
    run.write_json("comparison.json", found.to_dict())
    write_prediction(run, predicted, found)
    run.summary["headline"] = found.where
    return found


def write_prediction(run: Run, predicted: Array, found: Comparison) -> None:
    """prediction.npz, (s, p, 3) mm each."""
    run.write_npz("prediction.npz", {"u": predicted, "residual": found.residual, "cleaned": found.cleaned})


def _lines(found: Comparison) -> list[str]:
    """The residual's table, a line for each marker, direction, pressure and branch."""
    lines = []
    for kind, rows in found.maps.items():
        cells = ", ".join(f"{r['name']} {r['rms_mm']:.3f}" for r in rows)
        lines.append(f"compare:   by {kind} (mm rms): {cells}")
    return lines
