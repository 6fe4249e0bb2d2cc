"""The compare stage: whether the model agrees with the measurement within the noise, and where not."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from typer import Argument

from twin import files
from twin.bench.comparison import Judgement, kept, write_comparison
from twin.bench.fits import fit_file, newest_fit
from twin.bench.workbench import Workbench
from twin.judging.comparison import Comparison
from twin.judging.fitrecord import ComparisonRecord, MapRow
from twin.messages import Say
from twin.project.folder import Project, Run
from twin.targets import Array


def run_compare(
    project: Project | None,
    say: Say,
    two: Annotated[Sequence[Path], Argument(
        metavar="[A B]",
        help="two project folders, or two run folders with a fit.json, to lay side by side; without them the "
        "model of this project and its measurement are compared")] = (),
) -> dict[str, Any]:
    """Misfit in mm of the calibrated model by marker, direction, pressure and branch, and where it is larger
    than noise and known errors explain.

    project: None where two folders are compared.
    """
    if two or project is None:
        from twin.commands.comparetwo import run_side_by_side

        return run_side_by_side(two, say)
    bench, file, fit = Workbench.of(project), fit_file(project), newest_fit(project)
    model = bench.model()  # names what cannot be, before any work is done for it
    with project.new_run("compare") as run:
        judgement = kept(file, fit, bench.targets) or Judgement.of(bench.judged_fit(model, fit, say))
        comparison = judgement.comparison
        beside = file.with_name(ComparisonRecord.file)
        held = files.read(ComparisonRecord, beside).held_out if beside.is_file() else ()
        write_comparison(run, judgement.predicted, comparison, held)
        outline = _outline(bench, run, fit.theta, judgement.predicted)
        for line in (*bench.remarks, model.extent, *_lines(comparison)):
            run.note(line)
    for sentence in filter(None, (comparison.where, comparison.leans, *outline)):
        say(sentence)
    if judgement.crossed:
        say(
            f"{judgement.crossed}. Set self_contact = true in [model] of twin.toml: then they push "
            "on each other."
        )
    say(f"Wrote {project.shown(run.folder)}/comparison.json, with tables by marker, pressure and direction.")
    return {"stage": "compare", "run": run.name} | files.plain(comparison.record())


def _outline(bench: Workbench, run: Run, theta: Array, predicted: Array) -> tuple[str, ...]:
    """Sentences on the outline of the finger beside the fitted model's, written into the run; none where
    twin.toml does not ask for it."""
    table = bench.project.config.outline
    if table is None or not table.use:
        return ()
    from twin.inputs.outlinechecks import checked_by_outline

    try:
        check = checked_by_outline(bench, theta, predicted, count=table.moments)
    except ValueError as error:
        return (f"The outline is not compared with the model: {error}.",)
    run.write(check.record)
    run.write_text("outline.csv", check.csv)
    run.write_bytes("outline.png", check.drawn())
    return check.said


def _lines(comparison: Comparison) -> list[str]:
    """The root mean square in mm by marker, direction, pressure and branch, a line each."""
    return [
        f"rms in mm by {kind}: {', '.join(map(_measured, rows))}" for kind, rows in comparison.maps.items()
    ]


def _measured(row: MapRow) -> str:
    return f"{row.name} {row.rms_mm:.3f}" if row.count else f"{row.name} nothing measured"
