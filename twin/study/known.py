"""A fit of a law's constants -> what the data say of them, in words."""

import numpy as np

from calibrate import Fit, identifiability
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, NAMES
from twin.project.folder import Project
from twin.study.loadpathfit import OnPaths
from twin.study.ridges import difference
from twin.targets import Array

TOGETHER = 0.9  # correlation above which two constants are not told one by one


def known_of(on: OnPaths, best: Array, fit: Fit, doubt: str) -> str:
    """What the data say of the constants. best (d,): of the genetic algorithm; doubt: why the fit can have no
    interval, "" where the model fits."""
    free = {p.name for p in fit.parameters}
    if on.bench.law != MOONEY_RIVLIN:
        words = each_told(fit, fits=not doubt)
    elif set(NAMES) <= free:
        words = identifiability(fit, NAMES, fits=not doubt)
    else:
        words = "One constant was held fixed."
    none = f" No interval: {doubt}." if doubt else ""
    return f"{words}{at_all_bounds(fit)}{none}{_apart(on, best, fit)}{_other_pressure(on.bench.project)}"


def each_told(fit: Fit, *, fits: bool) -> str:
    """Every constant with its 95 % interval, none where the model does not fit or the constant is at a bound,
    and the two whose errors trade off most."""
    said = []
    for p, x, sd in zip(fit.parameters, fit.theta, fit.sd, strict=True):
        span = ""
        if p.name in fit.at_bound:
            span = " (at its bound)"
        elif fits and np.isfinite(sd):
            span = f" ({x - 1.96 * sd:.3g} to {x + 1.96 * sd:.3g})"
        said.append(f"{p.name} = {x:.4g} {p.unit}".rstrip() + span)
    words = f"{', '.join(said)}."
    together = np.triu(np.abs(np.nan_to_num(fit.correlation)), 1)
    i, j = np.unravel_index(int(together.argmax()), together.shape)
    if together[i, j] <= TOGETHER:
        return words
    a, b = fit.parameters[i].name, fit.parameters[j].name
    told = f"correlation {fit.correlation[i, j]:.3f}"
    return f"{words} {a} and {b} cannot be separated by these targets: {told}."


def at_all_bounds(fit: Fit) -> str:
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


def _apart(on: OnPaths, best: Array, fit: Fit) -> str:
    """Why the genetic algorithm and least squares end apart, where neither is better."""
    if on.bench.elasticity.fixed or on.bench.law != MOONEY_RIVLIN:
        return ""
    sd_mm = on.objective.sd_mm(on.bench.targets)
    said, flat = difference(on.constants(best).named, fit, on.cost, sd_mm=sd_mm)
    return f" {said}" if flat else ""


def _other_pressure(project: Project) -> str:
    """What the other pressure that a study states would mean."""
    study = project.config.study
    if study is None or study.other_pressure_MPa is None:
        return ""
    top = float(project.targets().pressure.max())
    return (
        f" The two pressures of this study contradict each other ({top:g} MPa in its table, "
        f"{study.other_pressure_MPa:g} MPa in its text): displacements depend on pressure / C, so the "
        f"other pressure would divide the moduli by {top / study.other_pressure_MPa:.3g}."
    )
