"""A fit of C10 and C01 -> what the data say of them, in words."""

from calibrate import Fit, identifiability
from twin.effects.baselaw import NAMES
from twin.project.folder import Project
from twin.study.loadpathfit import OnPaths
from twin.study.ridges import difference
from twin.targets import Array


def known_of(on: OnPaths, best: Array, fit: Fit, doubt: str) -> str:
    """What the data say of the constants. best (d,): of the genetic algorithm; doubt: why the fit can have no
    interval, "" where the model fits."""
    both = set(NAMES) <= {p.name for p in fit.parameters}
    words = identifiability(fit, NAMES, fits=not doubt) if both else "One constant was held fixed."
    none = f" No interval: {doubt}." if doubt else ""
    return f"{words}{at_all_bounds(fit)}{none}{_apart(on, best, fit)}{_other_pressure(on.bench.project)}"


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
    if on.bench.elasticity.fixed:
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
        f"other pressure would divide C10 and C01 by {top / study.other_pressure_MPa:.3g}."
    )
