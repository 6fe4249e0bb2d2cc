"""The compare stage: whether the model agrees with the measurement within the noise, and where not."""

from typing import Any

from twin.diagnosis.blindtest import unseen
from twin.diagnosis.comparison import Comparison
from twin.diagnosis.judging import Judged
from twin.project import files
from twin.project.folder import Project, Run, Say
from twin.stages.fits import fit_file, newest_fit
from twin.stages.judgements import Judgement, keep, kept
from twin.stages.several import film_names
from twin.stages.workbench import Workbench
from twin.targets import Array

COMPARISON = "comparison.json"


def run_compare(project: Project, say: Say) -> dict[str, Any]:
    """Whether the calibrated model agrees with the measurement within the noise, and where not."""
    bench, file, fit = Workbench.of(project), fit_file(project), newest_fit(project)
    with project.new_run("compare") as run:
        model = bench.model()
        made = kept(file, fit, bench.targets) or Judgement.of(bench.judged_fit(model, fit, say))
        found = made.comparison
        beside = files.read_json(file.with_name(COMPARISON)) if file.with_name(COMPARISON).is_file() else {}
        _write(run, made.predicted, found, beside.get("held_out", []))
        for line in (*bench.remarks, model.extent, *_lines(found)):
            run.note(line)
    say(found.where)
    if made.crossed:
        say(f"{made.crossed}; the model knows no such contact.")
    say(f"Wrote {project.shown(run.folder)}/comparison.json, with tables by marker, pressure and direction.")
    return {"stage": "compare", "run": run.name} | found.to_dict()


def compared(run: Run, judged: Judged, bench: Workbench, say: Say) -> Comparison:
    """The comparison of a judged model, written to comparison.json, prediction.npz and judged.npz of its
    run; what it foretells of held-out films is said."""
    keep(run, judged)
    held = foretold(bench, judged)
    _write(run, judged.predicted, judged.comparison, held)
    for row in held:
        say(f"Held out, {row['film']}: {row['rms_mm']:.3f} mm rms, foretold by a fit that never saw it.")
    return judged.comparison


def foretold(bench: Workbench, judged: Judged) -> list[dict[str, Any]]:
    """What a fitted model is off from each film that was held out of its fit: a row a film."""
    names = film_names(bench.project)
    return [
        {"film": names.get(row.block, f"block {row.block}")} | row.to_dict()
        for row in unseen(judged, bench.targets)
    ]


def _write(run: Run, predicted: Array, found: Comparison, held: list[dict[str, Any]]) -> None:
    run.write_json(COMPARISON, found.to_dict() | {"held_out": held})
    write_prediction(run, predicted, found)
    run.summary["headline"] = found.where


def write_prediction(run: Run, predicted: Array, found: Comparison) -> None:
    """Write prediction.npz: displacements, residual and cleaned residual, (s, p, 3) mm each."""
    run.write_npz("prediction.npz", {"u": predicted, "residual": found.residual, "cleaned": found.cleaned})


def _lines(found: Comparison) -> list[str]:
    """The root mean square in mm by marker, direction, pressure and branch, a line each."""
    return [f"rms in mm by {kind}: {', '.join(map(_measured, rows))}" for kind, rows in found.maps.items()]


def _measured(row: dict[str, Any]) -> str:
    return f"{row['name']} {row['rms_mm']:.3f}" if row["count"] else f"{row['name']} nothing measured"
