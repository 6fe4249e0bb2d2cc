"""The reference study's results: the record and the seven figures of a calibration by two points."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from calibrate import Fit
from twin import files
from twin.bench.fits import fresh
from twin.bench.workbench import Workbench
from twin.drawing import studyplots
from twin.drawing.studyplots import FINAL, INITIAL
from twin.judging.fitrecord import FitRecord
from twin.judging.fitting import whitener_of
from twin.laws.law import Constants
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, NAMES, NOMINAL, mooney_rivlin
from twin.messages import Say
from twin.project.config import StudyTable
from twin.project.folder import Project
from twin.review.states import Generations
from twin.study.identifiability import difference, ridge
from twin.study.loadpathfit import OnPaths
from twin.study.record import PointCurve, PointCurves, Side, Study
from twin.study.separability import Sensitivities, Separation, spots
from twin.targets import Array

CURVE = 61  # pressures of a curve
STARTS = (0.7, 0.8, 0.9, 0.95, 1.05, 1.1, 1.25, 1.5, 2.0)  # initial C10 + C01 over the final one
AROUND = np.geomspace(0.5, 4.0, 141)  # grid of initial sums over the final one
FIGURES = {  # by name, with their captions
    "5a": "Best RMS error of every generation of the genetic algorithm.",
    "5b": "Constants of the best candidate. Their sum settles before they do.",
    "5c": "Error of all candidates. Along the ridge the error hardly changes.",
    "6a": "Displacement against pressure, first point.",
    "6b": "Displacement against pressure, second point.",
    "6c": "Displacements at the top pressure.",
    "6d": "Absolute errors at the top pressure, before and after.",
}


def file_of(figure: str) -> str:
    """File name of a figure in its run."""
    return f"figure-{figure}.svg"


def fall_percent(initial: Side, final: Side) -> float:
    """Fall of the RMS error from an initial model, in per cent."""
    return 100.0 * (1.0 - final.rms_mm / initial.rms_mm)


@dataclass(frozen=True)
class Reference:
    """Calibration: load paths, generations of the search, candidates x (m, 2) MPa with their rms_mm (m,), and
    the least-squares fit."""

    on: OnPaths
    generations: Generations
    candidates: Mapping[str, Array]
    fit: Fit

    @staticmethod
    def of(project: Project, say: Say) -> "Reference":
        """The newest calibration that holds."""
        path = fresh(project, ("calibrate",), "candidates.npz")
        assert path is not None
        fit = files.read(FitRecord, path.with_name(FitRecord.file)).fit
        generations = Generations.load(path.with_name("generations.npz"))
        on = OnPaths.of(Workbench.of(project), say).holding(fit, say)
        return Reference(on, generations, files.read_npz(path, "x", "rms_mm"), fit)

    def study(self) -> Study:
        """The record of all results, in numbers and words."""
        on, o, best = self.on, self.on.objective, self.best
        project = on.bench.project
        table, names = project.config.study or StudyTable(), project.config.objective_points
        sd_mm, reduction = o.sd_mm(on.bench.targets), table.published_reduction_percent
        initial, final = self.side(MOONEY_RIVLIN.of(table.initial or NOMINAL.named)), self.side(best)
        initial = initial.model_copy(update={"stated": bool(table.initial)})
        sensitivities = self.sensitivities
        accuracy: tuple[Array, Constants, float] = (self.information, best, sd_mm)
        return Study(
            points=list(names), component=o.component + 1, pressure_MPa=self.top,
            measured_mm=o.measured.tolist(), measured_sd_mm=sd_mm,
            initial=initial, final=final, reduction_percent=fall_percent(initial, final),
            least_squares=self.side(mooney_rivlin(*map(float, self.fit.theta))),
            difference=difference(best.named, self.fit, on.cost, sd_mm=sd_mm)[0],
            published=self.side(MOONEY_RIVLIN.of(table.published)) if table.published else None,
            published_reduction_percent=reduction,
            published_reduction_from_total_MPa=self.matching(initial.share, final, reduction),
            starts=[s.model_copy(update={"reduction_percent": fall_percent(s, final)})
                    for s in self.starts(initial)],
            ridge=ridge(on.cost, on.bench.elasticity.parameters, sd_mm=sd_mm, count=len(names)),
            known=Separation.of(*accuracy),
            readings=sensitivities.readings(*accuracy),
            plans=sensitivities.plans(*accuracy, names=names, component=o.component, top=self.top),
            curves=self.curves(initial, final),
            figures=tuple(map(file_of, FIGURES)),
        ).worded()  # fmt: skip

    @property
    def best(self) -> Constants:
        """Best constants of the genetic algorithm."""
        return mooney_rivlin(*map(float, self.generations.best[-1]))

    @property
    def top(self) -> float:
        """Pressure in MPa of the objective."""
        return float(self.on.objective.pressure[0])

    def side(self, constants: Constants) -> Side:
        """Record of the model with these constants. ValueError without an equilibrium at the top pressure."""
        c, u_mm = constants, self.predicted(constants, np.array([self.top]))[0].tolist()
        return Side(
            C10=c["C10"], C01=c["C01"], total=c.scale, share=c.shape[0], rms_mm=self.on.cost(c.named),
            u_mm=u_mm,
        )  # fmt: skip

    def predicted(self, constants: Constants, pressure: Array) -> Array:
        """The objective's component (k, p) in mm at pressures (k,) MPa, relative to the reference."""
        u = self.on.objective.predicted(constants, self.on.paths, self.on.rows, pressure)
        if u is None:
            raise ValueError(
                f"no equilibrium at {self.top:g} MPa with {constants.told}: they are too "
                "soft; state stiffer ones under [study], or none"
            )
        return u

    def curves(self, initial: Side, final: Side) -> PointCurves:
        """Displacement over pressure of each point: both models, and the readings."""
        t, o, pressure = self.on.bench.targets, self.on.objective, np.linspace(0.0, self.top, CURVE)
        models = (mooney_rivlin(side.C10, side.C01) for side in (initial, final))
        before, after = (self.predicted(c, pressure).T.tolist() for c in models)
        curves = []
        for row, initial_mm, final_mm in zip(o.rows, before, after, strict=True):
            seen = t.valid[:, row, o.component]
            sd = np.sqrt(t.covariance[seen, row, o.component, o.component])
            curves.append(
                PointCurve(point=t.names[row], node=t.points[row].node, initial_mm=initial_mm,
                           final_mm=final_mm, measured_at_MPa=t.pressure[seen].tolist(),
                           measured_mm=t.value[seen, row, o.component].tolist(), measured_sd_mm=sd.tolist())
            )  # fmt: skip
        return PointCurves(pressure_MPa=pressure.tolist(), points=curves)

    def starts(self, initial: Side) -> list[Side]:
        """Initial models with the share of `initial` and other sums, and the middle of the bounds."""
        models = [MOONEY_RIVLIN.at(f * self.best.scale, (initial.share,)) for f in STARTS]
        models.append(mooney_rivlin(*((p.low + p.high) / 2 for p in self.on.bench.elasticity.parameters)))
        solved = [c for c in models if np.isfinite(self.on.cost(c.named))]
        return [self.side(c) for c in sorted(solved, key=lambda c: c.scale)]

    def matching(self, share: float, final: Side, reduction: float | None) -> list[float]:
        """Initial sums in MPa at a share from which the error falls by the published reduction in %."""
        if reduction is None or reduction >= 100.0:
            return []

        def excess(total: float) -> float:
            error = self.on.cost(MOONEY_RIVLIN.at(total, (share,)).named)
            return min(error, 1e6) - final.rms_mm / (1.0 - reduction / 100.0)

        grid = AROUND * final.total
        sign = np.sign([excess(float(x)) for x in grid])
        crossed = np.flatnonzero(sign[1:] != sign[:-1])
        return [float(scipy.optimize.brentq(excess, grid[k], grid[k + 1])) for k in crossed]

    @cached_property
    def information(self) -> Array:
        """Fisher information (2, 2) in 1/MPa2 of the targets on C10 and C01, at the best of the search."""
        model, t = self.on.bench.model(()), self.on.bench.targets
        theta = np.array([self.best.named[p.name] for p in model.parameters])
        w = self.on.whitener(theta) if t.noise is None else whitener_of(model, theta, t)
        rows = np.array([w.whiten(column) for column in model.jacobian(theta)])
        return np.asarray(rows @ rows.T)

    @cached_property
    def sensitivities(self) -> Sensitivities:
        """Displacements and their derivatives at the points that could be read."""
        bench, theta = self.on.bench, np.array([self.best.named[name] for name in NAMES])
        candidates = spots(bench.case, bench.targets, [int(row) for row in self.on.objective.rows])
        return Sensitivities.of(bench.model(()), theta, spots=candidates, top=self.top)

    def figures(self, study: Study) -> dict[str, str]:
        """The seven figures by name, each an SVG text."""
        u, g, points = f"U{study.component}", self.generations, study.curves.points
        pressure, total = np.array(study.curves.pressure_MPa), np.array(study.ridge.total_MPa)
        share, labels = np.array(study.ridge.share), [c.label for c in points]
        sides = {"genetic algorithm": study.final, "least squares": study.least_squares,
                 "published": study.published, "initial": study.initial}  # fmt: skip
        measured, initial, final = map(np.array, (study.measured_mm, study.initial.u_mm, study.final.u_mm))
        rows: dict[str, Any] = {INITIAL: initial, FINAL: final}
        texts = [
            studyplots.best_error(g.generation, rms_mm=g.rms_mm, initial_mm=study.initial.rms_mm),
            studyplots.best_constants(g.generation, best=g.best, names=g.names),
            studyplots.valley(
                self.candidates["x"], rms_mm=self.candidates["rms_mm"], names=g.names,
                marks={name: np.array([side.C10, side.C01]) for name, side in sides.items() if side},
                ridge=np.stack([(1 - share) * total, share * total], axis=1),
            ),
            *(
                studyplots.against_pressure(
                    pressure, models={INITIAL: np.array(c.initial_mm), FINAL: np.array(c.final_mm)},
                    read_at=np.array(c.measured_at_MPa), read_mm=np.array(c.measured_mm),
                    read_sd_mm=np.array(c.measured_sd_mm), title=c.label, component=u,
                )
                for c in points
            ),
            studyplots.end_values(labels, {studyplots.EXPERIMENT: measured} | rows, component=u),
            studyplots.end_values(labels, {name: np.abs(v - measured) for name, v in rows.items()},
                                  component=u, sd_mm=study.measured_sd_mm),
        ]  # fmt: skip
        return dict(zip(FIGURES, texts, strict=True))
