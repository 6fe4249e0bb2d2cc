"""The stages add and drop: the model with one effect more or less, refitted and compared."""

from typing import Any

import numpy as np

from twin.diagnosis.comparison import Comparison
from twin.diagnosis.intervals import estimates, fit_record
from twin.effects.library import effect
from twin.effects.protocol import Effect
from twin.model.prediction import Model
from twin.project import files
from twin.project.folder import Project, Say
from twin.review.numerals import in_words
from twin.review.states import Fields
from twin.stages import waterfall
from twin.stages.chain import kinds_writing
from twin.stages.comparing import compared
from twin.stages.fits import fresh, named_effects, newest_fit
from twin.stages.trusting import named_effect
from twin.stages.workbench import Workbench, own_of
from twin.targets import Array, Targets

SHOWN = 80  # film times at which the deformed model is stored for the review


def run_add(project: Project, say: Say, *, name: str | None = None) -> dict[str, Any]:
    """The model with one more effect, in the law that the newest diagnosis kept: refitted and compared.

    Without a name the effects are those that the newest diagnosis names together; where it names none,
    nothing is added.
    """
    names = [name] if name is not None else named_effects(project)
    if not names:
        say("The diagnosis names no effect: nothing is added.")
        return {"stage": "add", "status": "skipped", "named": names}
    laws = [law_of(project, one) for one in names]
    chosen, start = [law for law, _ in laws], {k: x for _, values in laws for k, x in values.items()}
    kept = [e for e in project.config.model.effects if e.partition(":")[0] not in {c.name for c in chosen}]
    before = fresh(project, kinds_writing("comparison.json"), "comparison.json")
    return _change(project, "add", (*kept, *(c.label for c in chosen)), start, say, before)


def law_of(project: Project, name: str) -> tuple[Effect, dict[str, float]]:
    """The effect, and where the newest diagnosis began the fit that it gave out for it."""
    name = named_effect(project, name)
    path, own = fresh(project, ("diagnose",), "diagnosis.json"), own_of(project)
    data = files.read_json(path) if path else {}
    kept = path.with_name("kept.json") if path else None
    laws = {label.partition(":")[0]: label for label in (data.get("law") or "").split(" + ")}
    if name in laws and kept and kept.exists():
        return effect(laws[name], own=own), files.read_json(kept)["start"]
    return effect(name, own=own), {}


def run_drop(project: Project, say: Say, *, name: str) -> dict[str, Any]:
    """The model without one of its effects: refitted and compared."""
    left = tuple(e for e in project.config.model.effects if e.partition(":")[0] != name.partition(":")[0])
    if len(left) == len(project.config.model.effects):
        raise ValueError(
            f"effect {name!r} is not in the model, which has "
            f"{', '.join(project.config.model.effects) or 'none'}"
        )
    before = fresh(project, kinds_writing("comparison.json"), "comparison.json")
    return _change(project, "drop", left, {}, say, before)


def _change(
    project: Project, kind: str, effects: tuple[str, ...], start: dict[str, float], say: Say, before: Any
) -> dict[str, Any]:
    bench, base = Workbench.of(project), newest_fit(project)
    then = files.read_json(before) if before else {}
    with project.new_run(kind, extra={"effects": list(effects)}) as run:
        model = bench.model(effects)
        known = {p.name: float(x) for p, x in zip(base.parameters, base.theta, strict=True)}
        theta = model.theta({**_nominal(model), **known, **start})
        say.progress(f"refit with {', '.join(effects) or 'no effect'}", 0, 1)
        judged = bench.judged(model, theta, say)
        fit, found = judged.fit, compared(run, judged, bench, say)
        run.write_json("fit.json", fit_record(fit, found) | {"effects": list(effects)})
        _fields(bench, judged.model, fit.theta).save(run.path("fields.npz"))
        run.note(model.extent)
    project.set_effects(effects)
    say(_error(then, found))
    way = waterfall.stairs(project)
    if len(way) > 2:
        say(waterfall.in_words(way))
    say(f"{in_words(estimates(fit, found))}.")
    say(found.where)
    say(f"Wrote {project.shown(run.folder)}/fit.json; twin.toml has effects = {list(effects)}")
    return {
        "stage": kind,
        "run": run.name,
        "rms_before_mm": then.get("rms_mm"),
        "rms_after_mm": found.rms_mm,
        "raw_rms_before_mm": then.get("raw_rms_mm"),
        "raw_rms_after_mm": found.raw_rms_mm,
        "noise_sd_mm": found.noise_sd_mm,
        "effects": list(effects),
        "fit": fit_record(fit, found),
        "steps": [row.to_dict() for row in way],
    }


def _error(then: dict[str, Any], now: Comparison) -> str:
    """The error before and after, in words; `then`: what comparison.json held, or nothing."""
    pairs = [(then.get(key), getattr(now, key)) for key in ("rms_mm", "raw_rms_mm")]
    left, raw = (f"{'' if a is None else f'from {a:.3f} mm '}to {b:.3f} mm rms" for a, b in pairs)
    return f"Error: {left}; with errors that many values share {raw}. The noise is {now.noise_sd_mm:.3f} mm."


def _nominal(model: Model) -> dict[str, float]:
    """Start values of effects of which nothing is known: half a typical step from null, the middle of the
    grid."""
    values: dict[str, float] = {}
    for e in model.effects:
        for p in e.parameters:
            values[p.name] = p.start if p.start is not None else (p.null or 0.0) + 0.5 * p.step
        tried = e.tries(model.test)
        entry = tried[len(tried) // 2]
        held = e.at(entry, model.test)
        if held is not e:
            raise ValueError(
                f"effect {e.label!r}: it must be stated which; wanted for example {held.label!r}, as "
                "the diagnosis names it"
            )
        values |= entry
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
