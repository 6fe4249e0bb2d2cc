"""The stage explain: the evidence for one effect, in the model or not, without a change of the project."""

from typing import Any

import numpy as np

from twin.bench.fits import newest, newest_fit
from twin.bench.laws import law_of
from twin.bench.workbench import Workbench
from twin.diagnosis.explanation import explained, table
from twin.diagnosis.record import NONE, DiagnosisRecord
from twin.effects.protocol import Effect, Theta
from twin.judging.judged import Judged
from twin.numerals import in_words
from twin.project import files
from twin.project.folder import Project, Say
from twin.targets import Array


def run_explain(project: Project, say: Say, *, name: str) -> dict[str, Any]:
    """What speaks for an effect: the model as it is now beside the model with it, or, of an effect in the
    model, without it."""
    chosen, start = law_of(project, name)
    labels = project.config.model.effects
    own = next((label for label in labels if label.partition(":")[0] == chosen.name), None)
    bench, fit = Workbench.of(project), newest_fit(project)
    with project.new_run("explain", extra={"effects": list(labels), "effect": own or chosen.label}) as run:
        model = bench.model()
        now = bench.judged_fit(model, fit, say)
        say.progress(f"refit for {own or chosen.label}", 0, 1)
        if own:
            other = _without(bench, now, own, say)
            chosen = next(e for e in model.effects if e.label == own)
        else:
            other, chosen = _with(bench, now, chosen, start, say)
        before, after = (other, now) if own else (now, other)
        rivals = _rivals(project, chosen.name)
        made = explained([chosen], before=before, after=after, targets=bench.targets, rivals=rivals)
        made.write(run)
        found = made.record
        change = f"{found.rms_before_mm:.4f} -> {found.rms_after_mm:.4f}"
        run.summary["headline"] = f"{found.effect}: {change} mm rms"
    for line in (*table(found), "", f"{in_words(found.parameters)}."):
        say(line)
    for name, row in found.parameters.items():
        say(f"{name} is {row.plausible}." if row.plausible else f"{name}: no plausible range is declared.")
    say(f"Wrote {project.shown(run.folder)}/evidence.json and evidence.npz")
    return {"stage": "explain", "run": run.name} | files.plain(found)


def _without(bench: Workbench, now: Judged, label: str, say: Say) -> Judged:
    """The model without one of its effects, fitted from where it is now."""
    model = bench.model([e for e in bench.project.config.model.effects if e != label])
    return bench.judged(model, model.theta(now.values), say)


def _with(
    bench: Workbench, now: Judged, effect: Effect, start: Theta, say: Say
) -> tuple[Judged, Effect]:
    """The model with one more effect, fitted from a start or, without one, from where its tangents lead."""
    if not start:
        effect, start = _begun(now, effect)
    label, labels = effect.label, bench.project.config.model.effects
    model = bench.model([*labels, label])
    theta = model.theta({**now.values, **start})
    low, high = (np.array([getattr(p, end) for p in model.parameters]) for end in ("low", "high"))
    return bench.judged(model, np.clip(theta, low, high), say), effect


def _begun(now: Judged, effect: Effect) -> tuple[Effect, dict[str, float]]:
    """The effect with values to begin a fit at: of its narrowest law, where a step along its tangents lowers
    chi2 most, carried on to the wider ones."""
    laws, test = effect.laws(), now.model.test
    law = laws[0] if effect.label in [one.label for one in laws] else effect
    tried, rows = law.tries(test), now.model.tangents(now.theta, [law])[law.label]
    steps = [_step(now, law, row) for row in rows]
    best = min(range(len(tried)), key=lambda k: steps[k][0])
    values = {**now.values, **tried[best], **steps[best][1]}
    if effect.label == law.label:
        return law.at(tried[best], test), values
    for wider in laws[1:]:
        values = dict(wider.start(values))
        if wider.label == effect.label:
            break
    return effect, values


def _step(now: Judged, law: Effect, row: Array) -> tuple[float, dict[str, float]]:
    """chi2 to first order with amplitudes by least squares, cut at their bounds; and these amplitudes."""
    columns = now.whitener.whiten(row).T
    both = np.hstack([now.fitted, columns])
    scale = np.linalg.norm(both, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    step = np.linalg.lstsq(both / scale, now.z, rcond=1e-10)[0] / scale
    values = {}
    for p, x in zip(law.amplitudes, step[now.fitted.shape[1] :], strict=True):
        assert p.null is not None
        size = x if abs(x) > 0.02 * p.step else 0.1 * p.step
        values[p.name] = float(np.clip(p.null + size, p.low, p.high))
    moved = np.array([values[p.name] - (p.null or 0.0) for p in law.amplitudes])
    left = now.z - columns @ moved
    left = left - now.fitted @ np.linalg.lstsq(now.fitted, left, rcond=1e-12)[0]
    return float(left @ left), values


def _rivals(project: Project, name: str) -> list[tuple[str, float]]:
    """What the newest diagnosis says that could mimic an effect, and how much of its signature."""
    found = newest(project, DiagnosisRecord) or NONE
    own = [row.members for row in found.classes if row.effect.partition(":")[0] == name]
    return [pair for members in own for pair in members.items()]
