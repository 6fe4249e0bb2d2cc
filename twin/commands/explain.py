"""The stage explain: the evidence for one effect, in the model or not, without a change of the project."""

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from typer import Argument

from twin import files
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
    own = [label for label in labels if name_of(label) in names]
    if own and len(own) < len(names):
        raise ValueError(f"{name!r}: of these the model has {AND.join(own)} alone; wanted all or none")
    check_embedded(project, "twin explain")
    check_least_squares(project, "twin explain")
    bench, fit = Workbench.of(project).of_film, newest_fit(project)
    told = AND.join(own or [e.label for e in chosen])
    with project.new_run("explain", extra={"effects": list(labels), "effect": told}) as run:
        model = bench.model()
        now = bench.judged_fit(model, fit, say)
        say.progress(f"refit for {told}", 0, 1)
        if own:
            other, chosen = _without(bench, now, own, say), tuple(e for e in model.effects if e.label in own)
        else:
            other, chosen = _with(bench, now, chosen, start, say)
        before, after = (other, now) if own else (now, other)
        mimics = _mimics(project, names)
        made = explained(chosen, before=before, after=after, targets=bench.targets, mimics=mimics)
        run.write(made.record)
        run.write_npz("evidence.npz", made.maps)
        found = made.record
        change = f"{found.rms_before_mm:.4f} -> {found.rms_after_mm:.4f}"
        run.summary["headline"] = f"{found.effect}: {change} mm rms"
    for line in (*table(found), "", f"{in_words(found.parameters)}."):
        say(line)
    for name, row in found.parameters.items():
        say(f"{name} is {row.plausible}." if row.plausible else f"{name}: no plausible range is declared.")
    say(f"Wrote {project.shown(run.folder)}/evidence.json and evidence.npz")
    return {"stage": "explain", "run": run.name} | files.plain(found)


def _without(bench: Workbench, now: Judged, labels: Sequence[str], say: Say) -> Judged:
    """The model without some of its effects, fitted from where it is now."""
    model = bench.model([e for e in bench.project.config.model.effects if e not in labels])
    return bench.judged(model, model.theta(now.values), say)


def _with(
    bench: Workbench, now: Judged, chosen: Sequence[Effect], start: Theta, say: Say
) -> tuple[Judged, tuple[Effect, ...]]:
    """The model with more effects, fitted from a start or, without one, from where their tangents lead."""
    if not start:
        own = [begun(now, e) for e in chosen]
        chosen, start = [e for e, _ in own], {k: x for _, values in own for k, x in values.items()}
    model = bench.model([*bench.project.config.model.effects, *(e.label for e in chosen)])
    theta = model.theta(begun_from(model, now.values, start))
    low, high = (np.array([getattr(p, end) for p in model.parameters]) for end in ("low", "high"))
    return bench.judged(model, np.clip(theta, low, high), say), tuple(chosen)


def _mimics(project: Project, names: Sequence[str]) -> list[tuple[str, float]]:
    """What the newest diagnosis says that could mimic effects, and how much of its signature."""
    found = newest(project, DiagnosisRecord) or NONE
    own = [row.members for row in found.classes if name_of(row.effect) in names]
    return [pair for members in own for pair in members.items() if name_of(pair[0]) not in names]
