"""The diagnose stage: which physical effect the model lacks, and what these data cannot tell."""

from dataclasses import replace
from typing import Any

from twin.diagnosis.candidates import Candidate
from twin.diagnosis.comparison import compare
from twin.diagnosis.intervals import fit_record
from twin.diagnosis.procedure import diagnose
from twin.diagnosis.verdicts import Diagnosis
from twin.effects.library import all_effects, effect
from twin.effects.protocol import Effect
from twin.model.prediction import Model
from twin.parallel import WORKERS
from twin.project.folder import Project, Run, Say
from twin.stages.comparing import write_prediction
from twin.stages.fits import newest_fit
from twin.stages.workbench import Workbench, own_of

TOP = 3  # effects of the ranking that are said; all stand in diagnosis.json


def run_diagnose(project: Project, say: Say) -> dict[str, Any]:
    """Which effect of the library the data ask for, and what they cannot tell."""
    bench, fit = Workbench.of(project), newest_fit(project)
    seed = project.config.diagnose.seed
    with project.new_run("diagnose", seed=seed) as run:
        model = bench.model()
        found = diagnose(
            model,
            _candidates(project),
            bench.targets,
            seed=seed,
            start=fit.theta,
            mesh=bench.mesh(fit.theta, model, say),
            settle=lambda kept: _settled(bench, kept, say),
            workers=WORKERS,
            progress=say.progress,
        )
        _write(run, project, model, found)
        for line in (model.extent, *map(_row, found.ranking)):
            run.note(line)
    say(f"Verdict: {found.verdict}")
    say(found.sentence)
    if found.ranking:
        say(f"Ranking: {', '.join(map(_score, found.ranking[:TOP]))}.")
    if found.next_test:
        say(f"Next test: {found.next_test}.")
    say(f"Wrote {project.shown(run.folder)}/diagnosis.json")
    return {"stage": "diagnose", "run": run.name} | found.to_dict()


def _candidates(project: Project) -> tuple[Effect, ...]:
    """The effects that twin.toml names, or the whole library; those of the project's own files always."""
    own = own_of(project)
    named = [effect(label, own=own) for label in project.config.diagnose.candidates] or all_effects()
    return (*named, *(e for e in own if e.name not in [n.name for n in named]))


def _settled(bench: Workbench, kept: Candidate, say: Say) -> Candidate:
    """The kept effect with the fit that `twin add` gives: of a new model, under the errors at its start."""
    assert kept.fit is not None
    names = [p.name for p in kept.fit.parameters]
    values = dict(zip(names, map(float, kept.fit.theta), strict=True))
    model = bench.model((*bench.project.config.model.effects, kept.effect.label))
    fit, w = bench.refitted(model, model.theta(values), say)
    found = compare(bench.targets, model.predict(fit.theta), w, jacobian=model.jacobian(fit.theta))
    return replace(kept, fit=fit, settled=found, start=values)


def _write(run: Run, project: Project, model: Model, found: Diagnosis) -> None:
    """Write diagnosis.json, the base model's prediction.npz and, of the kept effect, kept.json."""
    run.write_json("diagnosis.json", found.to_dict())
    run.summary["headline"] = found.verdict
    if found.base is not None and found.base_fit is not None:
        write_prediction(run, model.predict(found.base_fit.theta), found.base)
    kept = found.kept
    if kept is not None and kept.fit is not None and kept.final is not None:
        effects = [*project.config.model.effects, found.law]
        record = fit_record(kept.fit, kept.final) | {"effects": effects, "start": kept.start}
        run.write_json("kept.json", record)


def _score(c: Candidate) -> str:
    """One effect of the ranking, in a few words."""
    if c.delta_bic is None:
        return f"{c.effect.label} ({'not visible' if c.note else 'not refitted'})"
    return f"{c.effect.label} (BIC gain {c.delta_bic:.0f})"


def _row(c: Candidate) -> str:
    """One effect of the ranking, with all that is known of it."""
    gain = "not refitted" if c.delta_bic is None else f"BIC gain {c.delta_bic:.0f}"
    return f"{c.effect.label}: score {c.z:.1f}, {gain}" + (f" ({c.note})" if c.note else "")
