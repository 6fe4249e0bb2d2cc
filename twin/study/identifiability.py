"""Ridge of an error over C10 and C01, and sentences on a fit of a law's constants: intervals, correlations,
bounds, and the two searches compared.

Two displacements at one pressure depend on C10 + C01 far more than on the share C01 / (C10 + C01). Where the
error hardly changes along the ridge, two searches end at different places of it, and neither is better.
"""

from collections.abc import Callable, Mapping

import numpy as np
import scipy

from calibrate import Fit, Parameter, identifiability
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, NAMES
from twin.project.folder import Project
from twin.study.loadpathfit import OnPaths
from twin.study.record import Ridge
from twin.targets import Array

Cost = Callable[[Mapping[str, float]], float]  # constants in MPa -> RMS error in mm, inf without equilibrium
SHARES = 41
TOTALS = 60  # sums of the first grid, even in their logarithm


def agreeing(share: Array, rms_mm: Array, *, sd_mm: float, count: int) -> tuple[float, float]:
    """Lowest and highest of the shares (h,) in the 95 % interval of the profile likelihood
    (doi:10.2307/2347496).

    count: number of residuals, each with an error of sd_mm; their chi2 may exceed the least one by the
    95 % quantile of chi2 with one degree of freedom.

    >>> agreeing(np.linspace(0, 1, 5), np.array([3.0, 1.5, 0.5, 1.5, 3.0]), sd_mm=1.1, count=2)
    (0.25, 0.75)
    """
    chi2 = count * rms_mm**2 / sd_mm**2
    inside = share[chi2 <= chi2.min() + scipy.special.chdtri(1, 0.05)]
    return float(inside.min()), float(inside.max())


def ridge(cost: Cost, parameters: tuple[Parameter, ...], *, sd_mm: float, count: int) -> Ridge:
    """Ridge of an error within the bounds of C10 and C01: the best sum for every share, and the shares that
    agree with `count` readings of an error sd_mm. Raises ValueError where there is none."""
    shares = np.linspace(0.0, 1.0, SHARES)
    rows = [(share, *best) for share in shares if (best := _lowest(cost, parameters, share))]
    if not rows:
        raise ValueError(
            "no C10 + C01 within [calibrate] bounds has the least error for any share; widen the bounds"
        )
    share, total, rms_mm = np.array(rows, float).T
    return Ridge(
        share=share.tolist(), total_MPa=total.tolist(), rms_mm=rms_mm.tolist(),
        agreeing_share=agreeing(share, rms_mm, sd_mm=sd_mm, count=count),
    )  # fmt: skip


def _lowest(cost: Cost, parameters: tuple[Parameter, ...], share: float) -> tuple[float, float] | None:
    """Sum in MPa with the least error at a share, and that error in mm; None where it lies at a bound."""
    low, high = 0.0, np.inf
    for p, part in zip(parameters, (1 - share, share), strict=True):
        if part > 0.0:
            low, high = max(low, p.low / part), min(high, p.high / part)
        elif p.low > 0.0:
            return None
    if low >= high:
        return None

    def error(log_total: float) -> float:
        return cost(MOONEY_RIVLIN.at(float(np.exp(log_total)), (float(share),)).named)

    grid = np.linspace(np.log(max(low, 1e-3 * high)), np.log(high), TOTALS)
    errors = np.array([error(x) for x in grid])
    k = int(np.argmin(errors))
    if k in (0, TOTALS - 1) or not np.isfinite(errors[k - 1 : k + 2]).all():
        return None
    bounds = (grid[k - 1], grid[k + 1])
    best = scipy.optimize.minimize_scalar(error, bounds=bounds, method="bounded", options={"xatol": 1e-7})
    return float(np.exp(best.x)), float(best.fun)


TOGETHER = 0.9  # correlation above which two constants are not separated
APART = 0.02  # of C10 + C01: constants that differ by more are different answers


def identifiability_of(on: OnPaths, best: Array, fit: Fit, doubt: str) -> str:
    """Sentences on the constants of a fit.

    best (d,): constants of the genetic algorithm; doubt: the reason against intervals, "" where the model
    fits.
    """
    free = {p.name for p in fit.parameters}
    if on.bench.law != MOONEY_RIVLIN:
        words = each_constant(fit, fits=not doubt)
    elif set(NAMES) <= free:
        words = identifiability(fit, NAMES, fits=not doubt)
    else:
        words = "One constant was held fixed."
    none = f" No interval: {doubt}." if doubt else ""
    return f"{words}{at_all_bounds(fit)}{none}{_apart(on, best, fit)}{_other_pressure(on.bench.project)}"


def each_constant(fit: Fit, *, fits: bool) -> str:
    """Every constant with its 95 % interval, and the pair with the largest correlation.

    A constant has no interval where the model does not fit or the constant ends at a bound.
    """
    rows = []
    for p, x, sd in zip(fit.parameters, fit.theta, fit.sd, strict=True):
        span = ""
        if p.name in fit.at_bound:
            span = " (at its bound)"
        elif fits and np.isfinite(sd):
            span = f" ({x - 1.96 * sd:.3g} to {x + 1.96 * sd:.3g})"
        rows.append(f"{p.name} = {x:.4g} {p.unit}".rstrip() + span)
    words = f"{', '.join(rows)}."
    together = np.triu(np.abs(np.nan_to_num(fit.correlation)), 1)
    i, j = np.unravel_index(int(together.argmax()), together.shape)
    if together[i, j] <= TOGETHER:
        return words
    a, b = fit.parameters[i].name, fit.parameters[j].name
    correlation = f"correlation {fit.correlation[i, j]:.3f}"
    return f"{words} {a} and {b} cannot be separated by these targets: {correlation}."


def at_all_bounds(fit: Fit) -> str:
    """Question about units where all constants end at their upper, or all at their lower bounds; else ""."""
    high = {2 * x > p.low + p.high for p, x in zip(fit.parameters, fit.theta, strict=True)}
    if len(high) > 1 or {p.name for p in fit.parameters} != set(fit.at_bound):
        return ""
    return (
        f" All constants end at the {'stiffest' if high.pop() else 'softest'} that [calibrate] bounds allow: "
        "are pressures in MPa and displacements in mm, and are the finger's dimensions right? If they are, "
        "widen the bounds."
    )


def difference(genetic: Mapping[str, float], fit: Fit, cost: Cost, *, sd_mm: float) -> tuple[str, bool]:
    """Comparison of the ends of genetic algorithm and least squares in C10 and C01 (MPa).

    A sentence, "" where they agree, and whether neither is better: their errors differ by less than the error
    sd_mm of a reading.
    """
    least = {p.name: float(x) for p, x in zip(fit.parameters, fit.theta, strict=True)}
    if max(abs(genetic[n] - least[n]) for n in NAMES) <= APART * MOONEY_RIVLIN.of(least).scale:
        return "", False
    errors = cost(genetic), cost(least)
    ends = [
        f"C10 = {v['C10']:.3f} and C01 = {v['C01']:.3f} MPa ({e:.3f} mm)"
        for v, e in zip((genetic, least), errors)
    ]
    words = f"The genetic algorithm ends at {ends[0]}, least squares at {ends[1]}"
    apart = abs(errors[1] - errors[0])
    if not apart < sd_mm:
        reason = "least squares fits all values, the genetic algorithm only those of its objective"
        return f"{words}: {reason}.", False
    words += f". Both lie on one flat ridge: their errors differ by {apart:.2g} mm"
    words += f", a reading is known to {sd_mm:.2g} mm only."
    if bounds := " and ".join(name for name in NAMES if name in fit.at_bound):
        words += f" Least squares slides along it down to the bound of {bounds}."
    return f"{words} So neither is the better answer.", True


def _apart(on: OnPaths, best: Array, fit: Fit) -> str:
    """`difference` on load paths, where neither end is better."""
    if on.bench.elasticity.fixed or on.bench.law != MOONEY_RIVLIN:
        return ""
    sd_mm = on.objective.sd_mm(on.bench.targets)
    words, flat = difference(on.constants(best).named, fit, on.cost, sd_mm=sd_mm)
    return f" {words}" if flat else ""


def _other_pressure(project: Project) -> str:
    """Effect on the moduli of the second pressure that a study states."""
    study = project.config.study
    if study is None or study.other_pressure_MPa is None:
        return ""
    top = float(project.targets().pressure.max())
    return (
        f" The two pressures of this study contradict each other ({top:g} MPa in its table, "
        f"{study.other_pressure_MPa:g} MPa in its text): displacements depend on pressure / C, so the "
        f"other pressure would divide the moduli by {top / study.other_pressure_MPa:.3g}."
    )
