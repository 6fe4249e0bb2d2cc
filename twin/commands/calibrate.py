"""The calibrate stage: targets in, the genetic algorithm's history and a least-squares fit out."""

from collections.abc import Callable
from itertools import count
from typing import Annotated, Any

import numpy as np
from typer import Option

from calibrate import Fit
from twin import files
from twin.batches.former import former_of
from twin.bench.comparison import Judgement, compared, fitted_by, told_of_tests, write_curves
from twin.bench.effectchange import change_effects
from twin.bench.engines import check_embedded
from twin.bench.filmedge import FilmEdge
from twin.bench.fits import former_fit
from twin.bench.workbench import Workbench, as_far_as_it_carries
from twin.calibrated.problem import reached_stretch
from twin.commands.calibratelaws import run_laws
from twin.judging.intervals import fit_record
from twin.judging.jointfit import doubt_of_tests
from twin.laws.law import Constants
from twin.messages import Say
from twin.model.prediction import Model
from twin.project.folder import Project, Run
from twin.sanity import doubts, fit_fault, silicone_doubt, stability_doubt
from twin.study.carrying import carried, cut, in_words
from twin.study.fullsolves import full_solves
from twin.study.generations import Generation, evaluations, search
from twin.study.identifiability import identifiability_of
from twin.study.loadpathfit import OnPaths
from twin.study.multistart import LEAST, MOST, PICTURE, several_starts
from twin.targets import Array

FAR = 3.0  # times the objective is what constants leave of all data where that is told


def run_calibrate(
    project: Project,
    say: Say,
    *,
    laws: Annotated[str, Option(
        help="laws of the silicone to fit and compare, between commas such as yeoh,gent, or all")] = "",
    starts: Annotated[int, Option(
        help="also least squares from so many starts, over all of the bounds, with a picture of their ends"
    )] = 0,
) -> dict[str, Any]:
    """The fitted constants: a genetic algorithm, then bounded least squares on all targets, from the best end
    of all starts; and from there the effects that twin.toml has, in a run of their own."""
    if laws:
        return run_laws(project, say, laws=laws)
    _check_starts(project, starts)
    effects = project.config.model.effects
    bench = Workbench.of(project, whole=True)
    bench.model()  # names an effect that cannot be, before any work is done for it
    start = _former_values(project, effects, bench.law.names)
    for sentence in doubts(bench.targets, bench.case):
        say(sentence)
    seed, extra = project.config.calibrate.seed, {"starts": starts} if starts else {}
    with project.new_run("calibrate", seed=seed, extra=extra) as run:
        on = OnPaths.of(bench, say)
        if starts and on.of_one_shape:
            raise ValueError(f"--starts: {bench.law.title} is fitted by whole solves, too dear for it; "
                             "leave it out")  # fmt: skip
        highest, most = float(bench.targets.pressure.max()), carried(on)
        on = on if most is None else cut(on, most)
        best = _scaled(on, run, say) if on.of_one_shape else _searched(on, run, say)
        if most is None:
            _check_explained(on, best.best)
        tried = several_starts(on, best.best, starts, run, say) if starts else None
        more = [tried.best] if tried else []
        bench, judged = as_far_as_it_carries(
            on.bench, lambda b: OnPaths.on(b, on.paths).least(best.best, say, *more)
        )
        model, fit, tests = judged.model, judged.fit, bench.agreement(judged)
        comparison = compared(run, fit.theta, Judgement.of(judged), bench, say)
        FilmEdge(bench).keep(judged)
        words = identifiability_of(
            on.holding(fit, say), best.best, fit, doubt_of_tests(tests) or comparison.doubt
        )
        beside = fitted_by(bench, fit, Judgement.of(judged)) | {"material_tests": tests}
        if tried is not None:
            beside |= {"starts": tried.rows, "said": (*beside["said"], tried.words)}
        if bench.carried is not None:
            limit = in_words(min(on.limit(fit.theta), highest), highest, bench.carried.fitted)
            beside["said"] = (*beside["said"], limit)
        initial = on.initial(judged)
        run.write(fit_record(fit, comparison, effects=(), identifiability=words, initial=initial, **beside))
        write_curves(run, tests)
        run.summary["headline"] = words.split(". ")[0]
        crossed = model.solution(fit.theta).crossed
        for line in (*bench.remarks, model.extent, fit.reason):
            run.note(line)
    say(_ended(fit))
    if initial.raw_rms_mm is not None and comparison.raw_rms_mm > initial.raw_rms_mm:
        say(f"Nominal constants miss the film by {initial.raw_rms_mm:.3f} mm, the fit by "
            f"{comparison.raw_rms_mm:.3f} mm: the fit weighs every value by its errors, so that this may be "
            "where a model lacks something.")  # fmt: skip
    say(words)
    for sentence in (*beside["said"], *told_of_tests(bench.tests, tests)):
        say(sentence)
    constants = bench.elasticity.constants(model.named(fit.theta))
    if doubt := silicone_doubt(constants, end=_end(fit)):
        say(doubt)
    if doubt := _stability(bench, model, fit, constants):
        say(doubt)
    if crossed:
        say(f"{crossed}. Set self_contact = true in [model] of twin.toml: then they push on each other.")
    drawn = f", generations.npz and {PICTURE}" if starts else " and generations.npz"
    say(f"Wrote {project.shown(run.folder)}/fit.json{drawn}")
    result = {
        "stage": "calibrate",
        "run": run.name,
        "rms_mm": best.rms_mm,
        "fit": files.plain(fit_record(fit, comparison, **beside)),
        "identifiability": words,
    }
    if effects:
        say(f"twin.toml has effects = {list(effects)}: the model is fitted with them, too.")
        result["with_effects"] = change_effects(bench, "add", effects, start, say, base=fit)
    return result


def _check_starts(project: Project, starts: int) -> None:
    if not starts:
        return
    if not LEAST <= starts <= MOST:
        raise ValueError(f"--starts {starts}: wanted {LEAST} to {MOST} starts, such as 10")
    check_embedded(project, "twin calibrate --starts")


def _former_values(
    project: Project, effects: tuple[str, ...], law: tuple[str, ...]
) -> dict[str, float]:
    """Parameters of the effects by the newest fit with them, of this project or of its former batch; empty
    without such a fit. law: names of the constants of the base model."""
    if not effects:
        return {}
    if (fit := former_fit(project, effects)) is None:
        try:
            former = former_of(project)
            fit = None if former is None else former_fit(former, effects)
        except files.UNREADABLE:  # it is gone, or broken: a fit begins elsewhere
            return {}
    return {} if fit is None else {n: row.value for n, row in fit.parameters.items() if n not in law}


def _stability(bench: Workbench, model: Model, fit: Fit, constants: Constants) -> str:
    """A sentence where a C01 below zero is no silicone's, or not stable as far as the model is stretched."""
    if "C01" not in (names := [p.name for p in fit.parameters]) or bench.jobs is not None:
        return stability_doubt(constants)
    row = names.index("C01")
    if fit.theta[row] >= 0.0:
        return ""
    scale = max(fit.chi2 / max(fit.degrees_of_freedom, 1), 1.0)  # what is not understood is taken for noise
    sd = float(np.sqrt(np.nan_to_num(fit.covariance[row, row], nan=np.inf) * scale))
    return stability_doubt(constants, sd=sd, stretch=reached_stretch(model, fit.theta))


def _ended(fit: Fit) -> str:
    """A sentence on the end of the least squares."""
    if fit.converged:
        return f"Least squares converged after {fit.evaluations} evaluations."
    return f"Least squares did not converge in {fit.evaluations} evaluations: {fit.reason}."


def _end(fit: Fit) -> int:
    """1 where all parameters end at their upper bounds, -1 at their lower ones, else 0."""
    if not fit.parameters or len(fit.at_bound) < len(fit.parameters):
        return 0
    high = [value > (p.low + p.high) / 2 for value, p in zip(fit.theta, fit.parameters, strict=True)]
    return 1 if all(high) else 0 if any(high) else -1


def _scaled(on: OnPaths, run: Run, say: Say) -> Generation:
    """The nominal constants at the scale that fits best, where load paths do not serve the shapes of a law:
    one generation, written into the run."""
    law = on.bench.law
    say(f"The {law.title} law has {len(law.shapes)} numbers of shape, more than load paths serve. "
        "Least squares with whole solves finds them, without a genetic algorithm.")  # fmt: skip
    x, costs = on.over_scales(on.bench.elasticity.initial.shape)
    k = int(costs.argmin())
    generation = Generation(1, x[k], float(costs[k]), x, costs)
    _written(on, [generation], run, say)
    return generation


def _searched(on: OnPaths, run: Run, say: Say) -> Generation:
    """The last generation of the genetic algorithm; all candidates and generations are written into the
    run."""
    settings, parameters = on.bench.project.config.calibrate, on.bench.elasticity.parameters
    generations = search(
        parameters, _logged(on, run, say), run, seed=settings.seed, size=settings.population,
        generations=settings.generations, tell=say.progress, ahead=on.ahead,
    )  # fmt: skip
    candidates = _written(on, generations, run, say)
    say(f"Genetic algorithm: the best of {candidates} candidates has {generations[-1].rms_mm:.3f} mm RMS.")
    if whole := _of_all(on, generations[-1].best):
        say(whole)
    return generations[-1]


def _of_all(on: OnPaths, theta: Array) -> str:
    """A sentence where constants (d,) leave far more of all data than of the objective; "" elsewhere."""
    t, u, named = on.bench.targets, on.predicted(theta), on.bench.project.config.calibrate.objective_points
    if u is None or (rms := t.rms(t.value - u)) < FAR * on.cost(on.bench.model(()).named(theta)):
        return ""
    return f"That is of {' and '.join(named)} at the top pressure; of all data they leave {rms:.3f} mm RMS."


def _written(on: OnPaths, generations: list[Generation], run: Run, say: Say) -> int:
    """Number of candidates of a search; all of them are written into the run."""
    if not np.isfinite(generations[-1].rms_mm):
        jobs = on.bench.jobs
        told = f": {jobs.reasons()}; their files are in {jobs.folder}" if jobs and jobs.failed else ""
        raise ValueError(
            f"no candidate of the genetic algorithm has an equilibrium{told}; widen [calibrate] bounds, or "
            "correct the unit of the pressure log (top_kPa under [pressure] tells a wrong one)"
        )
    full_solves(on, generations, say).save(run.path("generations.npz"))
    candidates = np.concatenate([g.candidates for g in generations])
    run.write_npz(
        "candidates.npz", {"x": candidates, "rms_mm": np.concatenate([g.costs for g in generations])}
    )
    return len(candidates)


def _logged(on: OnPaths, run: Run, say: Say) -> Callable[[dict[str, float]], float]:
    """The cost of a candidate. Of a job its end is told, and why it failed, where it did, goes into the run's
    log."""
    jobs, settings, done = on.bench.jobs, on.bench.project.config.calibrate, count(1)
    if jobs is None:
        return on.cost
    name, total = jobs.engine.name, evaluations(settings.population, settings.generations)
    say(f"{jobs.release} solves the model: {total} jobs for the genetic algorithm, less those already done.")

    def cost(values: dict[str, float]) -> float:
        before = len(jobs.failed)
        rms_mm = on.cost(values)
        say.progress(f"jobs of {name}", min(next(done), total), total)
        for reason in jobs.failed[before:]:
            run.append({"event": "failed job", "values": values, "reason": reason})
        return rms_mm

    return cost


def _check_explained(on: OnPaths, theta: Array) -> None:
    """Raise ValueError where the model with its best constants (d,) moves otherwise than the finger."""
    u = on.predicted(theta)
    fault = "" if u is None else fit_fault(on.bench.targets, on.bench.targets.value - u)
    if fault:
        raise ValueError(fault)
