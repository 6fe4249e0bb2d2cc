"""A judged model beside its targets, written into its run: comparison, prediction, held-out films."""

from typing import Any

from twin.bench.judgements import keep
from twin.bench.workbench import Workbench
from twin.judging.blindtest import unseen
from twin.judging.comparison import Comparison
from twin.judging.judged import Judged
from twin.project import files
from twin.project.folder import Project, Run, Say
from twin.targets import Array

COMPARISON = "comparison.json"


def compared(run: Run, judged: Judged, bench: Workbench, say: Say) -> Comparison:
    """The comparison of a judged model, written to comparison.json, prediction.npz and judged.npz of its
    run; what it foretells of held-out films is said."""
    keep(run, judged)
    held = foretold(bench, judged)
    write_comparison(run, judged.predicted, judged.comparison, held)
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


def write_comparison(run: Run, predicted: Array, found: Comparison, held: list[dict[str, Any]]) -> None:
    run.write_json(COMPARISON, found.to_dict() | {"held_out": held})
    write_prediction(run, predicted, found)
    run.summary["headline"] = found.where


def write_prediction(run: Run, predicted: Array, found: Comparison) -> None:
    """Write prediction.npz: displacements, residual and cleaned residual, (s, p, 3) mm each."""
    run.write_npz("prediction.npz", {"u": predicted, "residual": found.residual, "cleaned": found.cleaned})


def film_names(project: Project) -> dict[int, str]:
    """The name of the film in each block of the targets; none where one film was measured, or elsewhere."""
    path = project.targets_folder / "source.json"
    rows = files.read_json(path).get("films", []) if path.is_file() else []
    return {row["block"]: row["name"] for row in rows}
