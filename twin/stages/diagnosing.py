"""The diagnose stage: which physical effect the model lacks, and what these data cannot tell."""

from typing import Any

from twin.diagnosis.procedure import diagnose
from twin.effects.library import all_effects, effect
from twin.effects.protocol import Effect
from twin.parallel import WORKERS
from twin.project.folder import Project, Say
from twin.stages.comparing import write_prediction
from twin.stages.fits import newest_fit
from twin.stages.workbench import Workbench, own_of


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
            write_prediction(run, model.predict(found.base_fit.theta), found.base)
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
    """The effects that twin.toml names, or the library and the project's own."""
    wanted, own = project.config.diagnose.candidates, own_of(project)
    return tuple(effect(name, own=own) for name in wanted) if wanted else (*all_effects(), *own)
