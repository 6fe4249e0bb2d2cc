"""A law's constants by the load paths: the objective, the paths, and the least squares that begin on them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibrate import Fit, least_squares
from twin.bench.workbench import Workbench
from twin.bodies.finger import BuiltIn
from twin.gravity import under
from twin.judging.comparison import PLAUSIBLE
from twin.judging.fitrecord import InitialRow
from twin.judging.fitting import whitener_of
from twin.judging.judged import Judged
from twin.judging.likelihood import posed, whitening
from twin.judging.whitening import Whitener, whitener
from twin.laws.law import Constants
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.messages import Say
from twin.model.arraycache import rounded_up
from twin.model.enginemodel import EnginePaths
from twin.model.fingertable import table_of
from twin.model.firstorder import MarkerPoints
from twin.model.loadpaths import MOST, REDUCED, Turned, load_paths, reach, sheets
from twin.model.prediction import Model
from twin.sanity import LEAST_MPA
from twin.study.generations import Objective
from twin.targets import Array, relative

SCALES = 60  # that are tried at one shape, evenly in their logarithm


@dataclass(frozen=True)
class OnPaths:
    """The base model of a project on its load paths. rows (r,): the rows of the targets they belong to.

    Where the shape of its law has more numbers than load paths serve, they are those of the nominal shape
    alone: they tell the scale with which least squares by whole solves begin.
    """

    bench: Workbench
    paths: Turned | EnginePaths
    rows: Any
    objective: Objective

    @staticmethod
    def of(
        bench: Workbench, say: Say, *, wide: bool = False, held: tuple[float, ...] | None = None
    ) -> "OnPaths":
        """The load paths at the finger's markers, and the objective that twin.toml states.

        wide: over all shapes that a fit may end at; held: of one shape alone, as by default of a law that
        load paths do not serve: the nominal one.
        """
        rows = np.flatnonzero(~bench.targets.fixed)
        return OnPaths.on(bench, _load_paths(bench, rows, wide, held, say))

    @staticmethod
    def on(bench: Workbench, paths: Turned | EnginePaths) -> "OnPaths":
        """The base model of a workbench on load paths that are there."""
        config, table = bench.project.config, bench.project.config.calibrate
        rows = np.flatnonzero(~bench.targets.fixed)
        objective = Objective.of(bench.targets, config.objective_points, table.objective_component - 1)
        return OnPaths(bench, paths, rows, objective)

    def holding(self, fit: Fit, say: Say) -> "OnPaths":
        """The same, or with load paths for negative shares of C01, too, where a fit ended there."""
        constants = self.constants(fit.theta)
        if constants.law != MOONEY_RIVLIN or constants.shape[0] >= 0.0 or self.bench.jobs is not None:
            return self  # jobs serve every share
        return OnPaths.of(self.bench, say, wide=True)

    @property
    def of_one_shape(self) -> bool:
        """True where the load paths belong to the nominal shape alone."""
        return self.bench.jobs is None and len(self.bench.law.shapes) > MOST

    def over_scales(self, shape: tuple[float, ...]) -> tuple[Array, Array]:
        """Constants (k, d) of a shape, from the softest to the stiffest, and the RMS (k,) in mm of
        the objective: inf where the model has no equilibrium."""
        elasticity = self.bench.elasticity
        every = [elasticity.law.at(float(s), shape) for s in np.geomspace(*elasticity.scales, SCALES)]
        low, high = np.array([(p.low, p.high) for p in elasticity.parameters]).T
        theta = np.clip([[c[p.name] for p in elasticity.parameters] for c in every], low, high)
        self.ahead([c.named for c in every])
        return theta, np.array([self.cost(c.named) for c in every])

    def ahead(self, every: Sequence[Mapping[str, float]]) -> None:
        """Do the jobs of several candidates at a time, where jobs solve the model."""
        if isinstance(self.paths, EnginePaths):
            self.paths.ahead([self.bench.elasticity.constants(values) for values in every])

    def cost(self, values: Mapping[str, float]) -> float:
        """The RMS in mm of the objective; inf where the model has no equilibrium."""
        return self.objective.cost(self.bench.elasticity.constants(values), self.paths, self.rows)

    def predicted(self, theta: Array) -> Array | None:
        """Displacements (s, p, 3) mm of all points as they are measured, 0 where there are no paths, at the
        free constants theta (d,); None where there is no equilibrium."""
        t = self.bench.targets
        u = self.paths.predict(self.constants(theta), t.pressure)
        if u is None:
            return None
        out = np.zeros_like(t.value)
        out[:, self.rows] = relative(u, t.reference, t.rests)
        return out

    def limit(self, theta: Array) -> float:
        """The pressure in MPa that the model carries at the free constants theta (d,); inf of jobs, which
        must carry all."""
        at = self.constants(theta)
        return np.inf if isinstance(self.paths, EnginePaths) else self.paths.limit(at)

    def least(self, best: Array, say: Say, *more: Array) -> tuple[Workbench, Judged]:
        """The least-squares fit of the constants to all targets: on the load paths from several starts,
        `best` and `more` (d,) among them, then on the finite-element model from there, with errors of its
        own; and the workbench with the curves of the silicone's tests as far as the finger is stretched
        there, which the last fit takes, too."""
        t, model = self.bench.targets, self.bench.model(())
        if self.bench.jobs is not None or self.of_one_shape:
            return self._by_whole_solves(model, best, say)
        starts = self.starts(best, *more)
        if t.bare:
            fit = self.unweighted(starts)
        else:
            fit = self.fit(self.whitener(best), starts)
            say.progress("least squares", 1, 3)
            on_mesh = self.bench.on_mesh(model, fit.theta, say)
            fit = self.fit(whitener_of(on_mesh, fit.theta, t), fit.theta[None])
        say.progress("least squares", 2, 3)
        bench = self.bench.reaching(model, fit.theta)
        judged = bench.judged(model, fit.theta, say, seed=bench.project.config.calibrate.seed)
        say.progress("least squares", 3, 3)
        return bench, judged

    def starts(self, best: Array, *more: Array) -> Array:
        """Starts (m, d) of least squares: those given, the theoretical constants, and of the usual shape the
        scale that fits best where that fits better than `best`. A search misses it where only softer
        constants, near those that carry the load no more, move as the test does."""
        theta, rms = self.over_scales(self.bench.elasticity.initial.shape)
        usual = [p.start for p in self.bench.model(()).parameters]
        k, parameters = int(rms.argmin()), self.bench.elasticity.parameters
        found = self.cost({p.name: float(x) for p, x in zip(parameters, best, strict=True)})
        return np.array([best, *more, usual, *([theta[k]] if rms[k] < found else [])])

    def _by_whole_solves(self, model: Model, best: Array, say: Say) -> tuple[Workbench, Judged]:
        """The fit by whole solves or jobs alone, from where the search ended: several starts would cost as
        much again each."""
        say.progress("least squares", 0, 1)
        bench = self.bench.reaching(model, best)
        judged = bench.judged(model, best, say, seed=bench.project.config.calibrate.seed)
        say.progress("least squares", 1, 1)
        return bench, judged

    def unweighted(self, starts: Array) -> Fit:
        """The bounded least-squares fit on the load paths in which all values count alike, from starts
        (m, d)."""
        t = self.bench.targets

        def residual(theta: Array) -> Array | None:
            u = self.predicted(theta)
            return None if u is None else (t.value - u)[t.used]

        return least_squares(residual, self._slope(residual), self.bench.elasticity.parameters, start=starts)

    def whitener(self, theta: Array) -> Whitener:
        """The whitener of the targets with the gauge's errors at theta (d,), without an error of the mesh."""
        t = self.bench.targets
        none = np.zeros((0, *t.value.shape))
        return whitener(t, prediction_modes=none, gauge=self._gauge(theta), points=~t.fixed)

    def fit(self, w: Whitener, starts: Array) -> Fit:
        """The bounded least-squares fit to all targets on the load paths, from starts (m, d)."""
        parameters, t = self.bench.elasticity.parameters, self.bench.targets
        white = whitening(t, w)

        def residual(theta: Array) -> Array | None:
            u = self.predicted(theta)
            return None if u is None else white(t.value - u)

        jacobian = self._slope(residual)
        if t.tails:  # from where gross errors lead, too, as its deviance has several valleys
            plain = least_squares(residual, jacobian, parameters, start=starts)
            starts = np.vstack([starts, plain.theta])
        r, slope, information = posed(residual, jacobian, parameters, t, w)
        return least_squares(r, slope, parameters, start=starts, information=information)

    def _slope(self, residual: Callable[[Array], Array | None]) -> Callable[[Array], Array]:
        """The derivatives (n, d) of a residual by forward differences; NaN where there is no equilibrium."""
        parameters = self.bench.elasticity.parameters

        def jacobian(theta: Array) -> Array:
            columns, b = [], residual(theta)
            for k, p in enumerate(parameters):
                h = 1e-3 * p.step * (1 if theta[k] + 1e-3 * p.step <= p.high else -1)
                a = residual(theta + h * np.eye(len(theta))[k])
                columns.append(np.full(1, np.nan) if a is None or b is None else (a - b) / h)
            return np.array(np.broadcast_arrays(*columns)).T

        return jacobian

    def initial(self, judged: Judged) -> InitialRow:
        """Nominal constants and what they leave, mm, under the errors of a fit."""
        values = {p.name: p.start or 0.0 for p in self.bench.elasticity.parameters}
        u = self.predicted(np.array(list(values.values())))
        if u is None:
            return InitialRow(values=values, rms_mm=None, raw_rms_mm=None)
        w, residual = judged.whitener, self.bench.targets.value - u
        rms_mm = w.rms(residual, bound=PLAUSIBLE)
        return InitialRow(values=values, rms_mm=rms_mm, raw_rms_mm=w.error_beside_walls(residual))

    def constants(self, theta: Array) -> Constants:
        """The constants from the free ones (d,) and those held at a value."""
        elasticity = self.bench.elasticity
        pairs = zip(elasticity.parameters, theta, strict=True)
        return elasticity.constants({p.name: float(x) for p, x in pairs})

    def _gauge(self, theta: Array) -> Array:
        """Change (s, p, 3) mm of each step by 1 sd of the gauge's noise, from two nearby pressures.

        The one above is half as far as the one below: the paths end little beyond the highest pressure.
        """
        t, constants = self.bench.targets, self.constants(theta)
        out, h = np.zeros_like(t.value), 1e-3 * max(float(t.pressure.max()), LEAST_MPA)
        a, b = (self.paths.predict(constants, np.maximum(t.pressure, h) + d) for d in (-h, h / 2))
        if a is not None and b is not None:
            out[:, self.rows] = (b - a) / (1.5 * h) * t.pressure_error[:, None, None]
        return out


def _load_paths(
    bench: Workbench, rows: Any, wide: bool, held: tuple[float, ...] | None, say: Say
) -> Turned | EnginePaths:
    """The load paths at the points of these rows, under the weight in every direction of gravity; by jobs
    where another program solves the model."""
    followed, table = MarkerPoints.of(bench.targets, bench.case, rows), table_of(bench.structure)
    where = followed.points
    gravities, of_step = bench.gravities
    if bench.jobs is not None:
        top, case = float(bench.targets.pressure.max()), under(bench.case, bench.path)
        return EnginePaths(case, followed, top, bench.jobs, gravities[:, :3], of_step)
    elasticity = bench.elasticity
    if bench.scales and table and bench.law == MOONEY_RIVLIN and not wide and held is None:
        return Turned((table.load_paths(bench.case, where),), of_step, followed)
    cache, key, top = bench.store.cache(say), bench.structure.key, REDUCED
    highest = rounded_up(max(float(bench.targets.pressure.max()), LEAST_MPA))
    if not isinstance(bench.structure.body, BuiltIn):  # REDUCED is of fingers alone
        top = reach(bench.case, bench.law, highest / elasticity.scales[0], cache=cache, key=key)
    how: dict[str, Any] = {"cache": cache, "key": key, "top": top, "wide": wide}
    how["held"] = elasticity.initial.shape if held is None and len(bench.law.shapes) > MOST else held
    outside = [bench.path.under(g) for g in gravities]
    if bench.scales:
        alone = (load_paths(bench.case, where, bench.law, **how, outside=row) for row in outside)
        return Turned(tuple(alone), of_step, followed)
    low, high = elasticity.scales
    # softer ones do not reach the top pressure: the table need not hold them
    scales = min(max(low, highest / top), 0.9 * high), high
    paths = tuple(
        sheets(bench.case, where, bench.law, **how, scales=scales, outside=row) for row in outside
    )
    return Turned(paths, of_step, followed)
