"""The study stage: a calibration by a few displacements as the reference study published its own, and what it means.

Its seven figures, its table, the ridge along which C10 and C01 trade off, and the readings that would tell them
apart. Without a calibration that still holds it calibrates first, and it ends with the report.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq

from calibrate import Fit
from twin.diagnosis.fitting import whitener_of
from twin.diagnosis.separation import Knowledge, Outcomes, Spot, outcomes, readings
from twin.diagnosis.whitening import whitener
from twin.effects.baselaw import NAMES, Constants
from twin.model.loadpaths import Turned
from twin.project import files
from twin.project.folder import Project, Run, Say
from twin.review import studyplots
from twin.review.states import Generations
from twin.stages.calibrating import load_paths_of, objective_of, run_calibrate
from twin.stages.findings import Curve, Plan, Side, Study
from twin.stages.fits import BESIDE, fresh
from twin.stages.reviewing import run_review
from twin.stages.ridges import difference, ridge
from twin.stages.searching import Objective
from twin.stages.workbench import Workbench
from twin.targets import Array

FIGURES = ("5a", "5b", "5c", "6a", "6b", "6c", "6d")
RECORD = "study.json"
CURVE = 61  # pressures of a curve
ALONG = 8  # spots along the line on which the markers sit
STARTS = (0.7, 0.8, 0.9, 0.95, 1.05, 1.1, 1.25, 1.5, 2.0)  # initial C10 + C01 over the final one


def file_of(figure: str) -> str:
    """The file of a figure in its run."""
    return f"figure-{figure}.svg"


def run_study(project: Project, say: Say) -> dict[str, Any]:
    """study.json and the study's seven figures; ValueError where the project has no such study."""
    _check(project)
    if fresh(project, ("calibrate",), "candidates.npz") is None:
        run_calibrate(project, say)
    maker = _Maker.of(project, say)
    with project.new_run("study") as run:
        found = maker.study()
        record = found.to_dict() | {"figures": [file_of(name) for name in FIGURES]}
        run.write_json(RECORD, record)
        _draw(run, maker.generations, maker.candidates, found)
        run.summary["headline"] = found.headline
    say(found.headline)
    for sentence in found.sentences:
        say(sentence)
    say(f"Wrote {project.shown(run.folder)}/{RECORD} and figures {', '.join(FIGURES)} (figure-5a.svg ..).")
    run_review(project, say)
    return {"stage": "study", "run": run.name} | record


def _check(project: Project) -> None:
    """Raise ValueError where the seven figures cannot be made of a project."""
    config = project.config
    if config.model.fixed:
        raise ValueError(
            f"model.fixed holds {', '.join(config.model.fixed)}: twin study shows how C10 and C01 trade off, so both must "
            "be free; set fixed = {} in twin.toml"
        )
    points = config.calibrate.objective_points
    if len(points) != 2:
        raise ValueError(
            f"calibrate.objective_points names {len(points)} point(s): figures 6a and 6b are of two; name two in twin.toml"
        )


@dataclass(frozen=True)
class _Maker:
    """What the findings are made from: the base model, its load paths, and the search that was run."""

    bench: Workbench
    paths: Turned
    rows: Array  # rows of the targets that the load paths belong to
    objective: Objective
    generations: Generations
    candidates: Mapping[str, Array]
    fit: Fit

    @staticmethod
    def of(project: Project, say: Say) -> "_Maker":
        """From the newest calibration that holds."""
        found = fresh(project, ("calibrate",), "candidates.npz")
        assert found is not None
        bench = Workbench.of(project)
        paths, rows = load_paths_of(bench, say)
        objective = objective_of(bench)
        record = files.read_json(found.with_name("fit.json"))
        fit = Fit.from_dict({key: value for key, value in record.items() if key not in BESIDE})
        generations = Generations.load(found.with_name("generations.npz"))
        return _Maker(bench, paths, rows, objective, generations, files.read_npz(found), fit)

    def study(self) -> Study:
        """Everything that was found."""
        own, table = self.bench.elasticity.parameters, self.bench.project.config.study
        stated = dict(table.initial) if table else {}
        published = dict(table.published) if table else {}
        initial = self.side(Constants.of(stated or {p.name: p.start for p in own}))
        final = self.side(self.best)
        line = ridge(self.cost, own)
        reduction = table.published_reduction_percent if table else None
        least = dict(zip(NAMES, map(float, self.fit.theta), strict=True))
        now = Knowledge.of(self.information, self.best)
        return Study(
            points=self.names, component=self.objective.component, top_MPa=self.top, measured=self.objective.measured,
            sd_mm=self.sd_mm, initial=initial, initial_is_stated=bool(stated), final=final,
            least=self.side(Constants.of(least)),
            difference=difference(self.best.named, self.fit, self.cost, sd_mm=self.sd_mm)[0],
            starts=self.starts(initial), ridge=line,
            agreeing=line.agreeing(sd_mm=self.sd_mm, count=len(self.names)), known=now,
            readings=readings(self.shown, information=self.information, constants=self.best, sd_mm=self.sd_mm),
            plans=self.plans(), pressure=self.pressure, curves=self.curves(initial, final),
            published=self.side(Constants.of(published)) if published else None, published_reduction=reduction,
            matching=self.matching(initial, final, reduction),
        )  # fmt: skip

    # -- the objective --------------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.bench.project.config.calibrate.objective_points)

    @property
    def best(self) -> Constants:
        """The best of the genetic algorithm."""
        return Constants(*map(float, self.generations.best[-1]))

    @property
    def top(self) -> float:
        return float(self.objective.pressure[0])

    @property
    def pressure(self) -> Array:
        return np.linspace(0.0, self.top, CURVE)

    @cached_property
    def sd_mm(self) -> float:
        """The error of one of the objective's values, 1 sd."""
        return self.objective.sd_mm(self.bench.targets)

    def cost(self, values: Mapping[str, float]) -> float:
        """RMS error in mm of constants."""
        return self.objective.cost(dict(values), self.paths, self.rows)

    def side(self, constants: Constants) -> Side:
        """The model with these constants. ValueError where it has no equilibrium at the top pressure."""
        u = self.predicted(constants, np.array([self.top]))
        return Side(constants=constants, rms_mm=self.cost(constants.named), u_mm=u[0])

    def predicted(self, constants: Constants, pressure: Array) -> Array:
        """The objective's component (k, p) in mm at pressures (k,), relative to the reference, as at its step."""
        o = self.objective
        at = np.append(pressure, o.pressure[1:])
        steps = np.append(np.full(len(pressure), o.steps[0]), o.steps[1:])
        u = self.paths.predict(constants, at, steps=steps)
        if u is None:
            c = constants
            raise ValueError(
                f"no equilibrium at {self.top:g} MPa with C10 = {c.C10:g}, C01 = {c.C01:g} MPa: they are too soft; state "
                "stiffer ones under [study]"
            )
        own = [int(np.flatnonzero(self.rows == r)[0]) for r in o.rows]
        seen = u[: len(pressure), :, o.component] - u[len(pressure) :, :, o.component].mean(axis=0)
        return np.asarray(seen[:, own])

    def curves(self, initial: Side, final: Side) -> tuple[Curve, ...]:
        """Displacement over pressure of each point, with what was read on the way."""
        t, o = self.bench.targets, self.objective
        before, after = (self.predicted(side.constants, self.pressure) for side in (initial, final))
        out = []
        for k, (name, row) in enumerate(zip(self.names, o.rows, strict=True)):
            seen = t.valid[:, row, o.component]
            sd = np.sqrt(t.covariance[seen, row, o.component, o.component])
            out.append(
                Curve(name=name, node=t.points[row].node, initial=before[:, k], final=after[:, k],
                      read_at=t.pressure[seen], read=t.value[seen, row, o.component], read_sd=sd)
            )  # fmt: skip
        return tuple(out)

    # -- other initial models -------------------------------------------------------------------------------

    def starts(self, initial: Side) -> tuple[Side, ...]:
        """Initial models with the share of `initial` and sums around the final one, and the middle of the bounds."""
        own, share = self.bench.elasticity.parameters, initial.constants.share
        every = [Constants.at(f * self.best.total, share) for f in STARTS]
        every.append(Constants(*((p.low + p.high) / 2 for p in own)))
        return tuple(self.side(c) for c in every if np.isfinite(self.cost(c.named)))

    def matching(self, initial: Side, final: Side, reduction: float | None) -> tuple[float, ...]:
        """The sums in MPa, with the share of `initial`, from which the error falls by the published part."""
        if reduction is None or reduction >= 100.0:
            return ()
        wanted, share = final.rms_mm / (1.0 - reduction / 100.0), initial.constants.share

        def beyond(total: float) -> float:
            return min(self.cost(Constants.at(total, share).named), 1e6) - wanted

        grid = np.geomspace(0.5, 4.0, 141) * final.constants.total
        errors = np.array([beyond(float(x)) for x in grid])
        turns = np.flatnonzero(np.sign(errors[1:]) != np.sign(errors[:-1]))
        return tuple(float(brentq(beyond, grid[k], grid[k + 1])) for k in turns)

    # -- what would tell them apart ---------------------------------------------------------------------------

    @cached_property
    def information(self) -> Array:
        """Information (2, 2) in 1/MPa2 that the targets hold on C10 and C01 at the best of the search."""
        model, t = self.bench.model(()), self.bench.targets
        theta = np.array([self.best.named[p.name] for p in model.parameters])
        if t.noise is None:
            w = whitener(t, prediction_modes=np.zeros((0, *t.value.shape)), gauge=np.zeros_like(t.value), points=~t.fixed)
        else:
            w = whitener_of(model, theta, t)
        rows = np.array([w.whiten(column) for column in model.jacobian(theta)])
        return np.asarray(rows @ rows.T)

    @cached_property
    def shown(self) -> Outcomes:
        """What the model shows at the spots where one could read."""
        theta = np.array([self.best.named[name] for name in NAMES])
        return outcomes(self.bench.model(()), theta, spots=self.spots(), top=self.top)

    def spots(self) -> tuple[Spot, ...]:
        """The objective's points, and nodes of the line through them along the finger."""
        case, t = self.bench.case, self.bench.targets
        own = [Spot(name=t.names[r], node=t.points[r].node or 0, place=place)
               for r, place in zip(self.objective.rows, t.places(case.position)[self.objective.rows], strict=True)]  # fmt: skip
        near = 1e-6 * np.ptp(case.nodes, axis=0).max()
        line = np.flatnonzero((np.abs(case.nodes[:, 1:] - own[0].place[1:]) < near).all(axis=1))
        if len(line) < ALONG:
            return tuple(own)
        x = case.nodes[line, 0]
        wanted = np.linspace(x.min(), x.max(), ALONG + 1)[1:]
        new = dict.fromkeys(int(line[np.argmin(np.abs(x - v))]) for v in wanted)
        more = [Spot(name=f"x = {case.nodes[r, 0]:.0f} mm", node=int(case.labels[r]), place=case.nodes[r]) for r in new]
        return (*own, *(s for s in more if s.node not in [o.node for o in own]))

    def plans(self) -> tuple[Plan, ...]:
        """What is known with several readings more, the least work first."""
        shown, c = self.shown, self.objective.component
        upto = shown.pressure <= self.top * (1 + 1e-9)
        at_top, own = np.flatnonzero(upto)[-1:], np.arange(len(self.names))
        low, every, both = np.flatnonzero(upto), np.arange(len(shown.spots)), sorted({0, 2, c})
        n = f"{len(low)} pressures up to {1e3 * self.top:.3g} kPa"
        other, all_ = [i for i in both if i != c], "U1 and U3"
        asked: list[tuple[str, Any, Any, Sequence[int]]] = [
            (f"{' and '.join(f'U{i + 1}' for i in other)} of {' and '.join(self.names)} at the same pressure", at_top, own, other),
            (f"U{c + 1} of {' and '.join(self.names)} at {n}", low[:-1], own, [c]),
            (f"{all_} of {' and '.join(self.names)} at {n}", low, own, both),
            (f"{all_} of {len(every)} points at {n}", low, every, both),
        ]  # fmt: skip
        out = []
        for words, s, p, i in asked:
            seen = np.zeros(shown.u.shape, bool)
            seen[np.ix_(s, p, i)] = True
            known = Knowledge.of(self.information + shown.information(seen, self.sd_mm), self.best)
            out.append(Plan(words=words, count=int(seen.sum()), known=known))
        return tuple(out)


def _draw(run: Run, g: Generations, candidates: Mapping[str, Array], found: Study) -> None:
    """Write the seven figures."""
    for name, text in drawn(g, candidates, found).items():
        run.write_text(file_of(name), text + "\n")


def drawn(g: Generations, candidates: Mapping[str, Array], found: Study) -> dict[str, str]:
    """The seven figures by name, each an SVG text."""
    u, marks = f"U{found.component + 1}", {"genetic algorithm": found.final, "least squares": found.least}
    others = {"published": found.published, "initial": found.initial}
    models = marks | {name: side for name, side in others.items() if side}
    places = {name: np.array([[side.constants.C10], [side.constants.C01]]) for name, side in models.items()}
    labels = [c.name if c.node is None else f"{c.name} (node {c.node})" for c in found.curves]
    over_pressure = [
        studyplots.against_pressure(
            found.pressure, initial_mm=c.initial, final_mm=c.final, read_at=c.read_at, read_mm=c.read,
            read_sd_mm=c.read_sd, title=label, component=u,
        )
        for c, label in zip(found.curves, labels, strict=True)
    ]  # fmt: skip
    errors = [np.abs(side.u_mm - found.measured) for side in (found.initial, found.final)]
    texts = [
        studyplots.best_error(g.generation, rms_mm=g.rms_mm, initial_mm=found.initial.rms_mm),
        studyplots.best_constants(g.generation, best=g.best, names=g.names),
        studyplots.valley(candidates["x"], rms_mm=candidates["rms_mm"], ridge=found.ridge.constants, marks=places,
                          names=g.names),
        *over_pressure,
        studyplots.end_values(labels, measured=found.measured, initial=found.initial.u_mm, final=found.final.u_mm,
                              component=u),
        studyplots.end_errors(labels, initial=errors[0], final=errors[1], sd_mm=found.sd_mm, component=u),
    ]  # fmt: skip
    return dict(zip(FIGURES, texts, strict=True))
