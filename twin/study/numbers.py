"""A calibrated project -> what its calibration has found (`findings.Study`): every number of the study."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from calibrate import Fit
from twin.bench.fits import fresh
from twin.bench.workbench import Workbench
from twin.effects.baselaw import NAMES, NOMINAL, Constants
from twin.judging.fitting import whitener_of
from twin.judging.record import FitRecord
from twin.judging.whitening import whitener
from twin.model.loadpaths import Turned
from twin.project import files
from twin.project.folder import Project, Say
from twin.review.states import Generations
from twin.study.generations import Objective
from twin.study.loadpathfit import load_paths_of, objective_of
from twin.study.readings import plans, spots
from twin.study.record import PointCurve, Side, Study
from twin.study.ridges import difference, ridge
from twin.study.separability import Knowledge, Outcomes, outcomes, readings
from twin.targets import Array

CURVE = 61  # pressures of a curve
STARTS = (0.7, 0.8, 0.9, 0.95, 1.05, 1.1, 1.25, 1.5, 2.0)  # initial C10 + C01 over the final one
AROUND = np.geomspace(0.5, 4.0, 141)  # of the final C10 + C01: where an initial one is looked for


@dataclass(frozen=True)
class Inquiry:
    """What the findings are made from: the base model, its load paths, and the search that was run."""

    bench: Workbench
    paths: Turned
    rows: Array  # rows of the targets that the load paths belong to
    objective: Objective
    generations: Generations
    candidates: Mapping[str, Array]
    fit: Fit

    @staticmethod
    def of(project: Project, say: Say) -> "Inquiry":
        """From the newest calibration that holds."""
        found = fresh(project, ("calibrate",), "candidates.npz")
        assert found is not None
        bench = Workbench.of(project)
        paths, rows = load_paths_of(bench, say)
        objective = objective_of(bench)
        fit = files.read(FitRecord, found.with_name(FitRecord.file)).fit
        generations = Generations.load(found.with_name("generations.npz"))
        return Inquiry(bench, paths, rows, objective, generations, files.read_npz(found), fit)

    def study(self) -> Study:
        """Everything that was found."""
        own, table = self.bench.elasticity.parameters, self.bench.project.config.study
        stated = dict(table.initial) if table else {}
        published = dict(table.published) if table else {}
        initial = self.side(Constants.of(stated or NOMINAL.named))
        final = self.side(self.best)
        line = ridge(self.cost, own)
        reduction = table.published_reduction_percent if table else None
        least = dict(zip(NAMES, map(float, self.fit.theta), strict=True))
        now = Knowledge.of(self.information, self.best)
        return Study(
            points=self.names, component=self.objective.component, top_MPa=self.top,
            measured=self.objective.measured, sd_mm=self.sd_mm,
            initial=initial, initial_is_stated=bool(stated), final=final,
            least=self.side(Constants.of(least)),
            difference=difference(self.best.named, self.fit, self.cost, sd_mm=self.sd_mm)[0],
            starts=self.starts(initial), ridge=line,
            agreeing=line.agreeing(sd_mm=self.sd_mm, count=len(self.names)), known=now,
            readings=readings(self.shown, information=self.information, constants=self.best,
                              sd_mm=self.sd_mm),
            plans=plans(self.shown, information=self.information, constants=self.best, sd_mm=self.sd_mm,
                        names=self.names, component=self.objective.component, top=self.top),
            pressure=self.pressure, curves=self.curves(initial, final),
            published=self.side(Constants.of(published)) if published else None,
            published_reduction=reduction,
            matching=self.matching(initial, final, reduction),
        )  # fmt: skip

    # -- the objective --------------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """The points of the objective."""
        return tuple(self.bench.project.config.calibrate.objective_points)

    @property
    def best(self) -> Constants:
        """The best of the genetic algorithm."""
        return Constants(*map(float, self.generations.best[-1]))

    @property
    def top(self) -> float:
        """The pressure in MPa of the objective."""
        return float(self.objective.pressure[0])

    @property
    def pressure(self) -> Array:
        """Pressures (k,) MPa of the curves."""
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
        """The objective's component (k, p) in mm at pressures (k,) MPa, relative to the reference."""
        o = self.objective
        at = np.append(pressure, o.pressure[1:])
        steps = np.append(np.full(len(pressure), o.steps[0]), o.steps[1:])
        u = self.paths.predict(constants, at, steps=steps)
        if u is None:
            c = constants
            raise ValueError(
                f"no equilibrium at {self.top:g} MPa with C10 = {c.C10:g}, C01 = {c.C01:g} MPa: they are too "
                "soft; state stiffer ones under [study], or none"
            )
        own = [int(np.flatnonzero(self.rows == r)[0]) for r in o.rows]
        seen = u[: len(pressure), :, o.component] - u[len(pressure) :, :, o.component].mean(axis=0)
        return np.asarray(seen[:, own])

    def curves(self, initial: Side, final: Side) -> tuple[PointCurve, ...]:
        """Displacement over pressure of each point, with what was read on the way."""
        t, o = self.bench.targets, self.objective
        before, after = (self.predicted(side.constants, self.pressure) for side in (initial, final))
        out = []
        for k, (name, row) in enumerate(zip(self.names, o.rows, strict=True)):
            seen = t.valid[:, row, o.component]
            sd = np.sqrt(t.covariance[seen, row, o.component, o.component])
            out.append(
                PointCurve(name=name, node=t.points[row].node, initial=before[:, k], final=after[:, k],
                      read_at=t.pressure[seen], read=t.value[seen, row, o.component], read_sd=sd)
            )  # fmt: skip
        return tuple(out)

    # -- other initial models -------------------------------------------------------------------------------

    def starts(self, initial: Side) -> tuple[Side, ...]:
        """Initial models with the share of `initial` and other sums, and the middle of the bounds."""
        own, share = self.bench.elasticity.parameters, initial.constants.share
        every = [Constants.at(f * self.best.total, share) for f in STARTS]
        every.append(Constants(*((p.low + p.high) / 2 for p in own)))
        solved = [c for c in every if np.isfinite(self.cost(c.named))]
        return tuple(self.side(c) for c in sorted(solved, key=lambda c: c.total))

    def matching(self, initial: Side, final: Side, reduction: float | None) -> tuple[float, ...]:
        """The sums in MPa, with the share of `initial`, from which the error falls by the published part."""
        if reduction is None or reduction >= 100.0:
            return ()
        wanted, share = final.rms_mm / (1.0 - reduction / 100.0), initial.constants.share

        def beyond(total: float) -> float:
            return min(self.cost(Constants.at(total, share).named), 1e6) - wanted

        grid = AROUND * final.constants.total
        errors = np.array([beyond(float(x)) for x in grid])
        turns = np.flatnonzero(np.sign(errors[1:]) != np.sign(errors[:-1]))
        return tuple(float(brentq(beyond, grid[k], grid[k + 1])) for k in turns)

    # -- what would tell them apart -------------------------------------------------------------------------

    @cached_property
    def information(self) -> Array:
        """Information (2, 2) in 1/MPa2 that the targets hold on C10 and C01 at the best of the search."""
        model, t = self.bench.model(()), self.bench.targets
        theta = np.array([self.best.named[p.name] for p in model.parameters])
        if t.noise is None:
            w = whitener(
                t,
                prediction_modes=np.zeros((0, *t.value.shape)),
                gauge=np.zeros_like(t.value),
                points=~t.fixed,
            )
        else:
            w = whitener_of(model, theta, t)
        rows = np.array([w.whiten(column) for column in model.jacobian(theta)])
        return np.asarray(rows @ rows.T)

    @cached_property
    def shown(self) -> Outcomes:
        """What the model shows at the spots where one could read."""
        theta = np.array([self.best.named[name] for name in NAMES])
        where = spots(self.bench.case, self.bench.targets, [int(row) for row in self.objective.rows])
        return outcomes(self.bench.model(()), theta, spots=where, top=self.top)
