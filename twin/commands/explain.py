"""The stage explain: the evidence for one effect, in the model or not, without a change of the project."""

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from typer import Argument

from twin import files
from twin.bench.effectchange import without
from twin.bench.effectlaws import laws_of
from twin.bench.engines import check_embedded
from twin.bench.fits import newest, newest_fit
from twin.bench.priors import check_least_squares
from twin.bench.workbench import Workbench
from twin.calibrated.effectstarts import begun, begun_from
from twin.diagnosis.diagnosisrecord import NONE, DiagnosisRecord
from twin.diagnosis.explanation import explained, table
from twin.effects.labels import AND, name_of
from twin.effects.protocol import Effect, Theta
from twin.judging.judged import Judged
from twin.messages import Say
from twin.numerals import in_words
from twin.project.folder import Project


def run_explain(
    project: Project,
    say: Say,
    name: Annotated[str, Argument(
        metavar="EFFECT", help="name of the effect, in the model or not, such as creep")],
) -> dict[str, Any]:
    """Evidence for an effect, or for those that a verdict names together: the model as it is now beside the
    model with them, or, of effects in the model, without them."""
    chosen, start = laws_of(project, name, say)
    names, labels = [e.name for e in chosen], project.config.model.effects
    present = [label for label in labels if name_of(label) in names]
    if present and len(present) < len(names):
        raise ValueError(f"{name!r}: of these the model has {AND.join(present)} alone; wanted all or none")
    check_embedded(project, "twin explain")
    check_least_squares(project, "twin explain")
    bench, fit = Workbench.of(project).of_film, newest_fit(project)
    label = AND.join(present or [e.label for e in chosen])
    with project.new_run("explain", extra={"effects": list(labels), "effect": label}) as run:
        model = bench.model()
        now = bench.judged_fit(model, fit, say)
        say.progress(f"refit for {label}", 0, 1)
        if present:
            refit, chosen = (
                without(bench, now, present, say),
                tuple(e for e in model.effects if e.label in present),
            )
        else:
            refit, chosen = _with(bench, now, chosen, start, say)
        before, after = (refit, now) if present else (now, refit)
        mimics = _mimics(project, names)
        explanation = explained(chosen, before=before, after=after, targets=bench.targets, mimics=mimics)
        run.write(explanation.record)
        run.write_npz("evidence.npz", explanation.maps)
        record = explanation.record
        change = f"{record.raw_rms_before_mm:.3f} -> {record.raw_rms_after_mm:.3f}"
        run.summary["headline"] = f"{record.effect}: {change} mm rms"
    for line in (*table(record), "", f"{in_words(record.parameters)}."):
        say(line)
    for name, row in record.parameters.items():
        say(f"{name} is {row.plausible}." if row.plausible else f"{name}: no plausible range is declared.")
    say(f"Wrote {project.shown(run.folder)}/evidence.json and evidence.npz")
    return {"stage": "explain", "run": run.name} | files.plain(record)


def _with(
    bench: Workbench, now: Judged, chosen: Sequence[Effect], start: Theta, say: Say
) -> tuple[Judged, tuple[Effect, ...]]:
    """The model with more effects, fitted from a start or, without one, from where their tangents lead."""
    if not start:
        guesses = [begun(now, e) for e in chosen]
        chosen, start = [e for e, _ in guesses], {k: x for _, values in guesses for k, x in values.items()}
    model = bench.model([*bench.project.config.model.effects, *(e.label for e in chosen)])
    theta = model.theta(begun_from(model, now.values, start))
    low, high = (np.array([getattr(p, end) for p in model.parameters]) for end in ("low", "high"))
    return bench.judged(model, np.clip(theta, low, high), say), tuple(chosen)


def _mimics(project: Project, names: Sequence[str]) -> list[tuple[str, float]]:
    """Effects that could mimic these by the newest diagnosis, each with the share of the signature."""
    diagnosis = newest(project, DiagnosisRecord) or NONE
    members_of = [row.members for row in diagnosis.classes if name_of(row.effect) in names]
    return [pair for members in members_of for pair in members.items() if name_of(pair[0]) not in names]
