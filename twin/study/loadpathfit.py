"""C10 and C01 by the load paths: the objective, the paths, and the least squares that begin on them."""

from typing import Any

import numpy as np

from calibrate import Fit, least_squares
from twin.bench.workbench import Workbench
from twin.effects.baselaw import Constants
from twin.effects.material import Elasticity
from twin.judging.fitting import whitener_of
from twin.judging.judged import Judged
from twin.judging.whitening import Whitener, whitener
from twin.model.arraycache import rounded_up
from twin.model.loadpaths import REDUCED, Turned, load_paths, reach, sheets
from twin.project.folder import Say
from twin.study.generations import Objective
from twin.targets import Array, Targets, relative


def objective_of(bench: Workbench) -> Objective:
    """The objective of the genetic algorithm that twin.toml states."""
    own = bench.project.config.calibrate
    component = own.objective_component - 1
    return Objective.of(bench.targets, own.objective_points, component, bench.elasticity.fixed)


def load_paths_of(bench: Workbench, say: Say) -> tuple[Turned, Any]:
    """The load paths at the finger's markers under the weight in every direction of gravity, and the rows of
    the targets they belong to."""
    rows = np.flatnonzero(~bench.targets.fixed)
    where = bench.targets.places(bench.case.position)[rows]
    cache, key, top = bench.cache(say), bench.structure.key, REDUCED
    highest = rounded_up(float(bench.targets.pressure.max()))
    if bench.project.config.model.deck is not None:
        softest = bench.elasticity.lowest.total
        top = reach(bench.case, highest / softest, cache=cache, key=key)
    gravities, of_step = bench.gravities
    if bench.scales:
        return Turned((load_paths(bench.case, where, cache=cache, key=key, top=top),), of_step), rows
    high = bench.elasticity.highest.total
    # softer ones do not reach the top pressure: the table need not hold them
    low = max(bench.elasticity.lowest.total, highest / top)
    totals = min(low, 0.9 * high), high
    made = tuple(
        sheets(bench.case, where, cache=cache, key=key, top=top, totals=totals, outside=bench.path.under(g))
        for g in gravities
    )  # fmt: skip
    return Turned(made, of_step), rows


def least(bench: Workbench, paths: Turned, points: Array, best: Array, say: Say) -> Judged:
    """The least-squares fit of C10 and C01 to all targets: on the load paths from several starts, then on the
    finite-element model from there, with errors of its own."""
    t, model, elasticity = bench.targets, bench.model(()), bench.elasticity
    slope = _rough_slope(paths, points, t, constants_of(elasticity, best))
    w = whitener(t, prediction_modes=np.zeros((0, *t.value.shape)), gauge=slope, points=~t.fixed)
    starts = np.array([best, [p.start for p in model.parameters]])
    first = fit_on_paths(paths, points, t, elasticity, w, starts)
    say.progress("least squares", 1, 3)
    w = whitener_of(bench.on_mesh(model, first.theta, say), first.theta, t)
    second = fit_on_paths(paths, points, t, elasticity, w, first.theta[None])
    say.progress("least squares", 2, 3)
    found = bench.judged(model, second.theta, say, seed=bench.project.config.calibrate.seed)
    say.progress("least squares", 3, 3)
    return found


def constants_of(elasticity: Elasticity, theta: Array) -> Constants:
    return elasticity.constants({p.name: x for p, x in zip(elasticity.parameters, theta, strict=True)})


def fit_on_paths(
    paths: Turned, points: Array, t: Targets, elasticity: Elasticity, w: Whitener, starts: Array
) -> Fit:
    def residual(theta: Array) -> Array | None:
        u = predicted(paths, points, t, constants_of(elasticity, theta))
        return None if u is None else w.whiten(t.value - u)

    def jacobian(theta: Array) -> Array:
        columns = []
        for k, p in enumerate(elasticity.parameters):
            h = 1e-3 * p.step * (1 if theta[k] + 1e-3 * p.step <= p.high else -1)
            moved = theta.copy()
            moved[k] += h
            a, b = residual(moved), residual(theta)
            columns.append(
                np.full(t.valid.shape[0] * len(w.components), np.nan)
                if a is None or b is None
                else (a - b) / h
            )
        return np.array(columns).T

    return least_squares(residual, jacobian, elasticity.parameters, start=starts)


def predicted(
    paths: Turned, points: Array, t: Targets, constants: Constants
) -> Array | None:
    u = paths.predict(constants, t.pressure)
    if u is None:
        return None
    out = np.zeros_like(t.value)
    out[:, points] = relative(u, t.reference, t.rests)
    return out


def _rough_slope(paths: Turned, points: Array, t: Targets, constants: Constants) -> Array:
    """The effect of 1 sd of gauge noise on each step, from two nearby pressures."""
    out = np.zeros_like(t.value)
    h = 1e-3 * float(t.pressure.max())
    a, b = (paths.predict(constants, np.maximum(t.pressure, h) + d) for d in (-h, h / 2))
    if a is not None and b is not None:
        out[:, points] = (b - a) / (1.5 * h) * t.pressure_sd[:, None, None]
    return out
