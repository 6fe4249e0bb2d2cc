"""The stages add and drop: the model with one effect more or less, refitted and compared."""

from typing import Any

import numpy as np

from twin.diagnosis.intervals import estimates, fit_record
from twin.effects.library import effect
from twin.effects.protocol import Effect
from twin.model.prediction import Model
from twin.project import files
from twin.project.folder import Project, Say
from twin.review.numerals import in_words
from twin.review.states import Fields
from twin.stages.chain import kinds_writing
from twin.stages.comparing import compared
from twin.stages.fits import fresh, named_effects, newest_fit
from twin.stages.workbench import Workbench, own_of
from twin.targets import Array, Targets

SHOWN = 80  # film times at which the deformed model is stored for the review


def run_add(project: Project, say: Say, *, name: str | None = None) -> dict[str, Any]:
    """The model with one more effect, in the law that the newest diagnosis kept: refitted and compared.

    Without a name the effect is the one that the newest diagnosis names; where it names none or several,
    nothing is added.
    """
    if name is None:
        named = named_effects(project)
        if len(named) != 1:
            say(f"The diagnosis names {' or '.join(named) or 'no effect'}: nothing is added.")
            return {"stage": "add", "status": "skipped", "named": named}
        (name,) = named
    chosen, start = _law(project, name)
    kept = [e for e in project.config.model.effects if e.partition(":")[0] != chosen.name]
    before = fresh(project, kinds_writing("comparison.json"), "comparison.json")
    return _change(project, "add", (*kept, chosen.label), start, say, before)


def _law(project: Project, name: str) -> tuple[Effect, dict[str, float]]:
    """The effect, and where the newest diagnosis began the fit that it gave out for it."""
    path, own = fresh(project, ("diagnose",), "diagnosis.json"), own_of(project)
    data = files.read_json(path) if path else {}
    kept = path.with_name("kept.json") if path else None
    if (
        ":" not in name
        and data.get("law")
        and data["law"].partition(":")[0] == name
        and kept
        and kept.exists()
    ):
        return effect(data["law"], own=own), files.read_json(kept)["start"]
    return effect(name, own=own), {}


def run_drop(project: Project, say: Say, *, name: str) -> dict[str, Any]:
    """The model without one of its effects: refitted and compared."""
    left = tuple(e for e in project.config.model.effects if e.partition(":")[0] != name.partition(":")[0])
    if len(left) == len(project.config.model.effects):
        raise ValueError(
            f"effect {name!r} is not in the model, which has {list(project.config.model.effects)}"
        )
    before = fresh(project, kinds_writing("comparison.json"), "comparison.json")
    return _change(project, "drop", left, {}, say, before)


def _change(
    project: Project, kind: str, effects: tuple[str, ...], start: dict[str, float], say: Say, before: Any
) -> dict[str, Any]:
    bench, base = Workbench.of(project), newest_fit(project)
    was = files.read_json(before).get("rms_mm") if before else None
    with project.new_run(kind, extra={"effects": list(effects)}) as run:
        model = bench.model(effects)
        known = {p.name: float(x) for p, x in zip(base.parameters, base.theta, strict=True)}
        theta = model.theta({**_nominal(model), **known, **start})
        say.progress(f"refit with {', '.join(effects) or 'no effect'}", 0, 1)
        fit, w = bench.refitted(model, theta, say)
        found = compared(run, bench, model, fit, w)
        run.write_json("fit.json", fit_record(fit, found) | {"effects": list(effects)})
        _fields(bench, model, fit.theta).save(run.path("fields.npz"))
        run.note(model.extent)
    project.set_effects(effects)
    text = f"from {was:.3f} mm to " if was is not None else ""
    say(f"Error: {text}{found.rms_mm:.3f} mm rms; the noise is {found.noise_sd_mm:.3f} mm.")
    say(f"{in_words(estimates(fit, found))}.")
    say(found.where)
    say(f"Wrote {project.shown(run.folder)}/fit.json; twin.toml has effects = {list(effects)}")
    return {
        "stage": kind,
        "run": run.name,
        "rms_before_mm": was,
        "rms_after_mm": found.rms_mm,
        "noise_sd_mm": found.noise_sd_mm,
        "effects": list(effects),
        "fit": fit_record(fit, found),
    }


def _nominal(model: Model) -> dict[str, float]:
    """Start values of effects of which nothing is known: half a typical step from null, the middle of the
    grid."""
    values: dict[str, float] = {}
    for e in model.effects:
        for p in e.parameters:
            values[p.name] = p.start if p.start is not None else (p.null or 0.0) + 0.5 * p.step
        if e.grid:
            values |= e.grid[len(e.grid) // 2]
    return {p.name: float(np.clip(values[p.name], p.low, p.high)) for p in model.parameters}


def _fields(bench: Workbench, model: Model, theta: Array) -> Fields:
    """The fitted model at evenly spread film times, for the review."""
    t: Targets = bench.targets
    steps = np.unique(np.linspace(0, len(t.time) - 1, min(SHOWN, len(t.time))).round().astype(int))
    rows = np.flatnonzero(~t.fixed)
    u, predicted = model.solution(theta).fields(list(steps)), model.predict(theta)
    rest = model.solution(theta).fields(list(t.reference[:: max(1, len(t.reference) // 3)])).mean(axis=0)
    shown = len(bench.case.nodes)  # of a whole made of a half, the half comes first
    return Fields(
        time_s=t.time[steps] - t.time[0],
        pressure=t.pressure[steps],
        u=(u - rest)[:, :shown].astype(np.float32),
        u_points=predicted[steps][:, rows],
        u_measured=t.value[steps][:, rows],
    )
