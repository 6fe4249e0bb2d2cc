"""The calibrate stage: targets in, the genetic algorithm's history and a least-squares fit out."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from calibrate import Fit, identifiability
from fe import Case, Path, solve
from fe.element import triangles
from twin.bench.comparison import compared
from twin.bench.workbench import Workbench
from twin.effects.baselaw import NAMES
from twin.gravity import under
from twin.judging.comparison import Comparison
from twin.judging.intervals import fit_record
from twin.judging.judged import Judged
from twin.judging.record import InitialRow
from twin.model.loadpaths import Turned
from twin.project import files
from twin.project.folder import Project, Run, Say
from twin.review.states import Generations
from twin.sanity import doubts, fit_fault
from twin.study.generations import Generation, Objective, search
from twin.study.loadpathfit import constants_of, least, load_paths_of, objective_of, predicted
from twin.study.ridges import difference
from twin.targets import Array


def run_calibrate(project: Project, say: Say) -> dict[str, Any]:
    """Genetic algorithm on the study's objective, then bounded least squares on all targets."""
    if project.config.model.effects:
        raise ValueError(
            f"model.effects = {list(project.config.model.effects)}: calibrate fits the base model; "
            "twin add refits with effects, twin drop takes one out"
        )
    bench = Workbench.of(project)
    for sentence in doubts(bench.targets, bench.case):
        say(sentence)
    with project.new_run("calibrate", seed=project.config.calibrate.seed) as run:
        paths, points = load_paths_of(bench, say)
        best = _searched(bench, paths, points, run, say)
        say(f"Genetic algorithm: the best of {best.tried} candidates has {best.rms_mm:.3f} mm RMS.")
        _check_explained(bench, paths, points, best.theta)
        judged = least(bench, paths, points, best.theta, say)
        model, fit, found = judged.model, judged.fit, compared(run, judged, bench, say)
        words = _words(project, fit, found, _apart(bench, paths, points, best, fit))
        initial = _initial(bench, paths, points, judged)
        run.write(fit_record(fit, found, effects=(), identifiability=words, initial=initial))
        run.summary["headline"] = words.split(". ")[0]
        crossed = model.solution(fit.theta).crossed
        for line in (*bench.remarks, model.extent, fit.reason):
            run.note(line)
    say(_ended(fit))
    say(words)
    if crossed:
        say(f"{crossed}; the model knows no such contact.")
    say(f"Wrote {project.shown(run.folder)}/fit.json and generations.npz")
    return {
        "stage": "calibrate",
        "run": run.name,
        "rms_mm": best.rms_mm,
        "fit": files.plain(fit_record(fit, found)),
        "identifiability": words,
    }


def _initial(bench: Workbench, paths: Turned, points: Array, judged: Judged) -> InitialRow:
    """Nominal constants and what they leave, mm, under the errors of the fit: from the load paths."""
    nominal = np.array([p.start for p in bench.elasticity.parameters])
    u = predicted(paths, points, bench.targets, constants_of(bench.elasticity, nominal))
    values = {p.name: p.start or 0.0 for p in bench.elasticity.parameters}
    if u is None:
        return InitialRow(values=values, rms_mm=None, raw_rms_mm=None)
    w, residual = judged.whitener, bench.targets.value - u
    raw = float(np.sqrt((w.pick(residual)[w.valid] ** 2).mean()))
    return InitialRow(values=values, rms_mm=w.rms(residual), raw_rms_mm=raw)


def _ended(fit: Fit) -> str:
    """How the least squares ended, in words."""
    if fit.converged:
        return f"Least squares converged after {fit.evaluations} evaluations."
    return f"Least squares did not converge in {fit.evaluations} evaluations: {fit.reason}."


@dataclass(frozen=True, kw_only=True)
class Searched:
    """What the genetic algorithm found: its best candidate (d,), that one's RMS in mm, how many it tried."""

    theta: Array
    rms_mm: float
    tried: int


def _searched(bench: Workbench, paths: Turned, points: Any, run: Run, say: Say) -> Searched:
    """The best of the genetic algorithm; all candidates and generations are written into the run."""
    settings = bench.project.config.calibrate
    objective = objective_of(bench)
    generations = search(
        bench.elasticity.parameters,
        lambda v: objective.cost(v, paths, points),
        run,
        seed=settings.seed,
        size=settings.population,
        generations=settings.generations,
        tell=say.progress,
    )
    if not np.isfinite(generations[-1].rms_mm):
        raise ValueError("no candidate of the genetic algorithm has an equilibrium; widen [calibrate] bounds")
    full_solves(bench, objective, generations, say).save(run.path("generations.npz"))
    candidates = np.concatenate([g.candidates for g in generations])
    costs = np.concatenate([g.costs for g in generations])
    run.write_npz("candidates.npz", {"x": candidates, "rms_mm": costs})
    return Searched(theta=generations[-1].best, rms_mm=generations[-1].rms_mm, tried=len(candidates))


def _check_explained(bench: Workbench, paths: Turned, points: Any, theta: Array) -> None:
    """Raise ValueError where the model with its best constants (d,) moves otherwise than the finger."""
    u = predicted(paths, points, bench.targets, constants_of(bench.elasticity, theta))
    fault = "" if u is None else fit_fault(bench.targets, bench.targets.value - u)
    if fault:
        raise ValueError(fault)


def full_solves(
    bench: Workbench, objective: Objective, generations: list[Generation], say: Say
) -> Generations:
    """The best individual of every generation by full finite elements at the first arrival at top
    pressure; where it has weight relative to its rest, as it is measured."""
    t, rows = bench.targets, np.flatnonzero(~bench.targets.fixed)
    points = t.places(bench.case.position)[rows]
    whole, path = _to_the_top(bench, objective)
    fields: dict[bytes, Array] = {}
    start = None
    for k, g in enumerate(generations):
        say.progress("best of each generation by full FE", k, len(generations))
        if g.best.tobytes() not in fields:
            constants = constants_of(bench.elasticity, g.best)
            start = solve(whole.with_material(**constants.named), path, start=start, count=4)
            if not start.converged:
                raise ValueError(f"the best of generation {g.number} ({constants.named}) {start.reason}")
            *rest, top = start.fields(range(len(path.output)))[:, : len(bench.case.nodes)]
            fields[g.best.tobytes()] = top - rest[0] if rest else top
    u = np.array([fields[g.best.tobytes()] for g in generations])
    assert start is not None
    near = np.argmin(np.linalg.norm(bench.case.nodes[None] - points[:, None], axis=2), axis=1)
    return Generations(
        generation=np.arange(1, len(generations) + 1),
        names=tuple(p.name for p in bench.elasticity.parameters),
        best=np.array([g.best for g in generations]),
        rms_mm=np.array([g.rms_mm for g in generations]),
        nodes=bench.case.nodes,
        triangles=triangles(bench.structure.outside),
        u=u.astype(np.float32),
        point_names=tuple(t.names[r] for r in rows),
        points=points,
        u_points=u[:, near],
        u_measured=t.value[objective.steps[0], rows],
        film_time_s=float(t.time[objective.steps[0]] - t.time[0]),
        film_frame=int(objective.steps[0]),
    )


def _to_the_top(bench: Workbench, objective: Objective) -> tuple[Case, Path]:
    """The case, and its load from rest to the first arrival at top pressure; where it has weight, the rest is
    an output, too."""
    gravities, of_step = bench.gravities
    top, rest = (bench.path.under(g) for g in gravities[of_step[objective.steps[:2]]])
    load = np.array([0.0, objective.pressure[0]])
    if not gravities.any():
        return bench.case, Path(load, load, load[1:])
    both = {name: np.stack([rest[name], top[name]]) for name in ("gravity", "pulls")}
    path = Path(np.array([0.0, 1.0]), load, np.array([0.0, 1.0]), places=rest["places"], **both)
    return under(bench.case, path), path


def _apart(bench: Workbench, paths: Turned, points: Array, best: "Searched", fit: Fit) -> str:
    """Why the genetic algorithm and least squares end apart, where neither is better."""
    if bench.elasticity.fixed:
        return ""
    objective = objective_of(bench)
    values = dict(zip((p.name for p in fit.parameters), map(float, best.theta), strict=True))
    said, flat = difference(
        values, fit, lambda v: objective.cost(dict(v), paths, points), sd_mm=objective.sd_mm(bench.targets)
    )
    return f" {said}" if flat else ""


def _at_all_bounds(fit: Fit) -> str:
    """A sentence where all constants end at their largest, or all at their smallest: a unit is likelier
    wrong."""
    high = {2 * x > p.low + p.high for p, x in zip(fit.parameters, fit.theta, strict=True)}
    if len(high) > 1 or {p.name for p in fit.parameters} != set(fit.at_bound):
        return ""
    return (
        f" All constants end at the {'stiffest' if high.pop() else 'softest'} that [calibrate] bounds allow: "
        "are pressures in MPa and displacements in mm, and are the finger's dimensions right? If they are, "
        "widen the bounds."
    )


def _words(project: Project, fit: Fit, found: Comparison, apart: str) -> str:
    """What the data say of the constants, in words."""
    names = [p.name for p in fit.parameters]
    words = (
        identifiability(fit, NAMES, fits=found.adequate)
        if set(NAMES) <= set(names)
        else "One constant was held fixed."
    )
    words += _at_all_bounds(fit)
    if found.doubt:
        words += f" No interval: {found.doubt}."
    words += apart
    study = project.config.study
    if study is not None and study.other_pressure_MPa is not None:
        top = float(project.targets().pressure.max())
        ratio = top / study.other_pressure_MPa
        words += (
            f" The two pressures of this study contradict each other ({top:g} MPa in its table, "
            f"{study.other_pressure_MPa:g} MPa in its text): displacements depend on pressure / C, so the "
            f"other pressure would divide C10 and C01 by {ratio:.3g}."
        )
    return words
