"""The stages compare, diagnose, add and drop: what the model misses, which effect it lacks, and with that
added."""

from typing import Any

import numpy as np

from calibrate import Fit
from twin.diagnosis.comparison import Comparison, compare
from twin.diagnosis.fitting import fit_model, whitener_of, with_mesh
from twin.diagnosis.procedure import diagnose
from twin.diagnosis.whitening import Whitener
from twin.effects.library import all_effects, effect
from twin.effects.protocol import Effect
from twin.model.prediction import Model
from twin.parallel import WORKERS
from twin.project import files
from twin.project.folder import Project, Run, Say
from twin.review.states import Fields
from twin.stages.workbench import Workbench, newest_fit
from twin.targets import Array, Targets

SHOWN = 80  # film times at which the deformed model is stored for the review


def run_compare(project: Project, say: Say) -> dict[str, Any]:
    """Whether the calibrated model agrees with the measurement within the noise, and where not."""
    bench, fit = Workbench.of(project), newest_fit(project)
    with project.new_run("compare") as run:
        model = bench.model()
        w = whitener_of(model, fit.theta, bench.targets, bench.mesh(fit.theta, model, say))
        found = _compared(run, bench, model, fit, w)
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


def _compared(run: Run, bench: Workbench, model: Model, fit: Fit, w: Whitener) -> Comparison:
    predicted = model.predict(fit.theta)
    found = compare(bench.targets, predicted, w, jacobian=model.jacobian(fit.theta))
    run.write_json("comparison.json", found.to_dict())
    _write_prediction(run, predicted, found)
    run.summary["headline"] = found.where
    return found


def _write_prediction(run: Run, predicted: Array, found: Comparison) -> None:
    """prediction.npz, (s, p, 3) mm each."""
    run.write_npz("prediction.npz", {"u": predicted, "residual": found.residual, "cleaned": found.cleaned})


def _lines(found: Comparison) -> list[str]:
    """The residual's table, a line for each marker, direction, pressure and branch."""
    lines = []
    for kind, rows in found.maps.items():
        cells = ", ".join(f"{r['name']} {r['rms_mm']:.3f}" for r in rows)
        lines.append(f"compare:   by {kind} (mm rms): {cells}")
    return lines


def run_diagnose(project: Project, say: Say) -> dict[str, Any]:
    """Which effect of the library the data ask for, and what they cannot tell."""
    bench, fit = Workbench.of(project), newest_fit(project)
    seed = project.config.diagnose.seed
    with project.new_run("diagnose", seed=seed) as run:
        model = bench.model()
        mesh = bench.mesh(fit.theta, model, say)
        found = diagnose(
            model,
            _candidates(project),
            bench.targets,
            seed=seed,
            start=fit.theta,
            mesh=mesh,
            workers=WORKERS,
            progress=say.progress,
        )
        data = found.to_dict()
        run.write_json("diagnosis.json", data)
        if found.base is not None and found.base_fit is not None:
            _write_prediction(run, model.predict(found.base_fit.theta), found.base)
        if found.kept is not None and found.kept.fit is not None:
            effects = [*project.config.model.effects, found.law]
            run.write_json("kept.json", found.kept.fit.to_dict() | {"effects": effects})
        run.summary["headline"] = found.verdict
    say(f"diagnose: {model.extent}")
    say(f"diagnose: {found.verdict}")
    say(f"diagnose: {found.sentence}")
    for c in found.ranking:
        gain = "not refitted" if c.delta_bic is None else f"BIC gain {c.delta_bic:.0f}"
        say(f"diagnose:   {c.effect.label}: score {c.z:.1f}, {gain}" + (f" ({c.note})" if c.note else ""))
    if found.next_test:
        say(f"diagnose: next test: {found.next_test}")
    say(f"diagnose: wrote {project.shown(run.folder)}/diagnosis.json")
    return {"stage": "diagnose", "run": run.name} | data


def _candidates(project: Project) -> tuple[Effect, ...]:
    wanted = project.config.diagnose.candidates
    return tuple(effect(name) for name in wanted) if wanted else all_effects()


def run_add(project: Project, name: str, say: Say) -> dict[str, Any]:
    """The model with one more effect, in the law that the newest diagnosis kept: refitted and compared."""
    chosen, start = _law(project, name)
    kept = [e for e in project.config.model.effects if e.partition(":")[0] != chosen.name]
    before = project.newest(("calibrate", "compare", "add", "drop"), "comparison.json")
    return _change(project, "add", (*kept, chosen.label), start, say, before)


def _law(project: Project, name: str) -> tuple[Effect, dict[str, float]]:
    """The effect, and the parameters that the newest diagnosis found for it."""
    path = project.newest("diagnose", "diagnosis.json")
    data = files.read_json(path) if path else {}
    kept = path.with_name("kept.json") if path else None
    if (
        ":" not in name
        and data.get("law")
        and data["law"].partition(":")[0] == name
        and kept
        and kept.exists()
    ):
        values = {k: float(v["value"]) for k, v in files.read_json(kept)["parameters"].items()}
        return effect(data["law"]), values
    return effect(name), {}


def run_drop(project: Project, name: str, say: Say) -> dict[str, Any]:
    """The model without one of its effects: refitted and compared."""
    left = tuple(e for e in project.config.model.effects if e.partition(":")[0] != name.partition(":")[0])
    if len(left) == len(project.config.model.effects):
        raise ValueError(
            f"effect {name!r} is not in the model, which has {list(project.config.model.effects)}"
        )
    before = project.newest(("calibrate", "compare", "add", "drop"), "comparison.json")
    return _change(project, "drop", left, {}, say, before)


def _change(
    project: Project, kind: str, effects: tuple[str, ...], start: dict[str, float], say: Say, before: Any
) -> dict[str, Any]:
    bench, base = Workbench.of(project), newest_fit(project)
    old = files.read_json(before) if before else {}
    with project.new_run(kind, extra={"effects": list(effects)}) as run:
        model = bench.model(effects)
        known = {p.name: float(x) for p, x in zip(base.parameters, base.theta, strict=True)}
        theta = model.theta({**_nominal(model), **known, **start})
        mesh = bench.mesh(theta, model, say)
        w = whitener_of(model, theta, bench.targets, mesh)
        say.progress(f"refit with {', '.join(effects) or 'no effect'}", 0, 1)
        fit = with_mesh(fit_model(model, bench.targets, w, start=theta), mesh)
        run.write_json("fit.json", fit.to_dict() | {"effects": list(effects)})
        found = _compared(run, bench, model, fit, w)
        _fields(bench, model, fit.theta).save(run.path("fields.npz"))
    project.set_effects(effects)
    was = old.get("rms_mm")
    text = f"{was:.3f} mm -> " if was is not None else ""
    say(
        f"{kind}: error {text}{found.rms_mm:.3f} mm rms; noise {found.noise_sd_mm:.3f} mm "
        f"({found.rms_mm / found.noise_sd_mm:.2f} of it)"
    )
    for p, x, s in zip(fit.parameters, fit.theta, fit.sd, strict=True):
        say(f"{kind}:   {p.name} = {x:.4g} +- {s:.2g} {p.unit}".rstrip())
    say(f"{kind}: {model.extent}")
    say(f"{kind}: {found.where}")
    say(f"{kind}: wrote {project.shown(run.folder)}/fit.json; twin.toml has effects = {list(effects)}")
    return {
        "stage": kind,
        "run": run.name,
        "rms_before_mm": was,
        "rms_after_mm": found.rms_mm,
        "noise_sd_mm": found.noise_sd_mm,
        "effects": list(effects),
        "fit": fit.to_dict(),
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
        t.time[steps] - t.time[0],
        t.pressure[steps],
        (u - rest)[:, :shown].astype(np.float32),
        predicted[steps][:, rows],
        t.value[steps][:, rows],
    )
