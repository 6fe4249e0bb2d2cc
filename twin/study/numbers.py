"""A calibrated project -> the record of what its calibration has found: every number of the study."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq

from calibrate import Fit
from twin import files
from twin.bench.fits import fresh
from twin.bench.workbench import Workbench
from twin.judging.fitting import whitener_of
from twin.judging.record import FitRecord
from twin.judging.whitening import whitener
from twin.laws.law import Constants
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, NAMES, NOMINAL, mooney_rivlin
from twin.messages import Say
from twin.project.folder import Project
from twin.review.states import Generations
from twin.study.generations import Objective
from twin.study.loadpathfit import OnPaths
from twin.study.readings import plans, spots
from twin.study.record import Initial, PointCurve, PointCurves, RidgeLine, Side, Start, Study
from twin.study.ridges import difference, ridge
from twin.study.separability import Known, Outcomes, knowledge, outcomes, readings
from twin.targets import Array

CURVE = 61  # pressures of a curve
STARTS = (0.7, 0.8, 0.9, 0.95, 1.05, 1.1, 1.25, 1.5, 2.0)  # initial C10 + C01 over the final one
AROUND = np.geomspace(0.5, 4.0, 141)  # of the final C10 + C01: where an initial one is looked for


@dataclass(frozen=True)
class Inquiry:
    """What the findings are made from: the base model, its load paths, and the search that was run."""

    on: OnPaths
    generations: Generations
    candidates: Mapping[str, Array]
    fit: Fit

    @staticmethod
    def of(project: Project, say: Say) -> "Inquiry":
        """From the newest calibration that holds."""
        found = fresh(project, ("calibrate",), "candidates.npz")
        assert found is not None
        fit = files.read(FitRecord, found.with_name(FitRecord.file)).fit
        generations = Generations.load(found.with_name("generations.npz"))
        on = OnPaths.of(Workbench.of(project), say).holding(fit, say)
        return Inquiry(on, generations, files.read_npz(found, "x", "rms_mm"), fit)

    @property
    def bench(self) -> Workbench:
        """The model and its targets."""
        return self.on.bench

    @property
    def objective(self) -> Objective:
        """What the search made small."""
        return self.on.objective

    def study(self) -> Study:
        """Everything that was found."""
        table = self.bench.project.config.study
        stated = dict(table.initial) if table else {}
        published = dict(table.published) if table else {}
        reduction = table.published_reduction_percent if table else None
        initial = self.side(MOONEY_RIVLIN.of(stated or NOMINAL.named))
        final = self.side(self.best)
        line = ridge(self.on.cost, self.bench.elasticity.parameters)
        agreeing = line.agreeing(sd_mm=self.sd_mm, count=len(self.names))
        asked: dict[str, Any] = {
            "information": self.information, "constants": self.best, "sd_mm": self.sd_mm,
        }
        return Study(
            points=list(self.names), component=self.objective.component + 1, pressure_MPa=self.top,
            measured_mm=self.objective.measured.tolist(), measured_sd_mm=self.sd_mm,
            initial=Initial(**initial.model_dump(), stated=bool(stated)), final=final,
            reduction_percent=_reduction(initial, final),
            least_squares=self.side(mooney_rivlin(*map(float, self.fit.theta))),
            difference=difference(self.best.named, self.fit, self.on.cost, sd_mm=self.sd_mm)[0],
            published=self.side(MOONEY_RIVLIN.of(published)) if published else None,
            published_reduction_percent=reduction,
            published_reduction_from_total_MPa=self.matching(initial, final, reduction),
            starts=[
                Start(**s.model_dump(), reduction_percent=_reduction(s, final)) for s in self.starts(initial)
            ],
            ridge=RidgeLine(share=line.share.tolist(), total_MPa=line.total.tolist(),
                            rms_mm=line.rms_mm.tolist(), agreeing_share=agreeing),
            known=Known(**knowledge(self.information, self.best, self.sd_mm)),
            readings=readings(self.shown, **asked),
            plans=plans(self.shown, **asked, names=self.names, component=self.objective.component,
                        top=self.top),
            curves=self.curves(initial, final),
        )  # fmt: skip

    # -- the objective --------------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """The points of the objective."""
        return tuple(self.bench.project.config.calibrate.objective_points)

    @property
    def best(self) -> Constants:
        """The best of the genetic algorithm."""
        return mooney_rivlin(*map(float, self.generations.best[-1]))

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

    def side(self, constants: Constants) -> Side:
        """The model with these constants. ValueError where it has no equilibrium at the top pressure."""
        u, c = self.predicted(constants, np.array([self.top])), constants
        own = {"total": c.scale, "share": c.shape[0], "rms_mm": self.on.cost(c.named)}
        return Side(**c.named, **own, u_mm=u[0].tolist())

    def predicted(self, constants: Constants, pressure: Array) -> Array:
        """The objective's component (k, p) in mm at pressures (k,) MPa, relative to the reference."""
        c, on = constants, self.on
        u = self.objective.predicted(c, on.paths, on.rows, pressure)
        if u is None:
            raise ValueError(
                f"no equilibrium at {self.top:g} MPa with {c.told}: they are too "
                "soft; state stiffer ones under [study], or none"
            )
        return u

    def curves(self, initial: Side, final: Side) -> PointCurves:
        """Displacement over pressure of each point, with what was read on the way."""
        t, o = self.bench.targets, self.objective
        both = (mooney_rivlin(side.C10, side.C01) for side in (initial, final))
        before, after = (self.predicted(c, self.pressure) for c in both)
        out = []
        for k, (name, row) in enumerate(zip(self.names, o.rows, strict=True)):
            seen = t.valid[:, row, o.component]
            sd = np.sqrt(t.covariance[seen, row, o.component, o.component])
            out.append(
                PointCurve(point=name, node=t.points[row].node, initial_mm=before[:, k].tolist(),
                      final_mm=after[:, k].tolist(), measured_at_MPa=t.pressure[seen].tolist(),
                      measured_mm=t.value[seen, row, o.component].tolist(), measured_sd_mm=sd.tolist())
            )  # fmt: skip
        return PointCurves(pressure_MPa=self.pressure.tolist(), points=out)

    # -- other initial models -------------------------------------------------------------------------------

    def starts(self, initial: Side) -> list[Side]:
        """Initial models with the share of `initial` and other sums, and the middle of the bounds."""
        own, share = self.bench.elasticity.parameters, initial.share
        every = [MOONEY_RIVLIN.at(f * self.best.scale, (share,)) for f in STARTS]
        every.append(mooney_rivlin(*((p.low + p.high) / 2 for p in own)))
        solved = [c for c in every if np.isfinite(self.on.cost(c.named))]
        return [self.side(c) for c in sorted(solved, key=lambda c: c.scale)]

    def matching(self, initial: Side, final: Side, reduction: float | None) -> list[float]:
        """The sums in MPa, with the share of `initial`, from which the error falls by the published part."""
        if reduction is None or reduction >= 100.0:
            return []
        wanted, share = final.rms_mm / (1.0 - reduction / 100.0), initial.share

        def beyond(total: float) -> float:
            return min(self.on.cost(MOONEY_RIVLIN.at(total, (share,)).named), 1e6) - wanted

        grid = AROUND * final.total
        errors = np.array([beyond(float(x)) for x in grid])
        turns = np.flatnonzero(np.sign(errors[1:]) != np.sign(errors[:-1]))
        return [float(brentq(beyond, grid[k], grid[k + 1])) for k in turns]

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


def _reduction(start: Side, final: Side) -> float:
    """The fall of the RMS error from a model to the final one, %; negative where that one was better."""
    return 100.0 * (1.0 - final.rms_mm / start.rms_mm)
