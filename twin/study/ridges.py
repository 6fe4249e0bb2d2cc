"""An error of two constants that act alike -> its ridge: the best sum for every share, and how flat it is.

Two displacements at one pressure depend on C10 + C01 far more than on the share C01 / (C10 + C01). Where the
error hardly changes along the ridge, two searches end at different places of it, and neither is better.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import chdtri

from calibrate import Fit, Parameter
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, NAMES
from twin.targets import Array

Cost = Callable[[Mapping[str, float]], float]  # constants in MPa -> RMS error in mm, inf without equilibrium
SHARES = 41
TOTALS = 60  # sums that are tried first, evenly in their logarithm
APART = 0.02  # of C10 + C01: constants that differ by more are different answers


@dataclass(frozen=True)
class Ridge:
    """The best sum total (h,) MPa and its error rms_mm (h,) for shares (h,), as far as within the bounds."""

    share: Array
    total: Array
    rms_mm: Array

    @property
    def constants(self) -> Array:
        """C10 and C01 (h, 2) in MPa along it."""
        return np.stack([(1 - self.share) * self.total, self.share * self.total], axis=1)

    def agreeing(self, *, sd_mm: float, count: int) -> tuple[float, float]:
        """The lowest and highest share whose `count` residuals agree with readings of an error sd_mm as well
        as the best: chi2 larger by less than its 95 % quantile of one degree of freedom, as in a profile
        likelihood (doi:10.2307/2347496)."""
        chi2 = count * self.rms_mm**2 / sd_mm**2
        own = self.share[chi2 <= chi2.min() + chdtri(1, 0.05)]
        return float(own.min()), float(own.max())


def ridge(cost: Cost, parameters: tuple[Parameter, ...]) -> Ridge:
    """The ridge of an error within the bounds of C10 and C01. ValueError where there is none."""
    rows = [
        (share, *found)
        for share in np.linspace(0.0, 1.0, SHARES)
        if (found := _lowest(cost, parameters, share))
    ]
    if not rows:
        raise ValueError(
            "no C10 + C01 within [calibrate] bounds has the least error for any share; widen the bounds"
        )
    return Ridge(*np.array(rows, float).T)


def _lowest(cost: Cost, parameters: tuple[Parameter, ...], share: float) -> tuple[float, float] | None:
    """The sum in MPa with the least error at a share, and that error in mm; None where it lies at a bound."""
    ends = _ends(parameters, share)
    if ends is None:
        return None

    def error(log_total: float) -> float:
        return cost(MOONEY_RIVLIN.at(float(np.exp(log_total)), (float(share),)).named)

    grid = np.linspace(np.log(ends[0]), np.log(ends[1]), TOTALS)
    errors = np.array([error(x) for x in grid])
    k = int(np.argmin(errors))
    if k in (0, TOTALS - 1) or not np.isfinite(errors[k - 1 : k + 2]).all():
        return None
    found = minimize_scalar(
        error, bounds=(grid[k - 1], grid[k + 1]), method="bounded", options={"xatol": 1e-7}
    )
    return float(np.exp(found.x)), float(found.fun)


def _ends(parameters: tuple[Parameter, ...], share: float) -> tuple[float, float] | None:
    """The lowest and highest sum in MPa with both constants in their bounds at a share; None without any."""
    low, high = 0.0, np.inf
    for p, part in zip(parameters, (1 - share, share), strict=True):
        if part > 0.0:
            low, high = max(low, p.low / part), min(high, p.high / part)
        elif p.low > 0.0:
            return None
    return (max(low, 1e-3 * high), high) if low < high else None


def difference(genetic: Mapping[str, float], fit: Fit, cost: Cost, *, sd_mm: float) -> tuple[str, bool]:
    """A sentence on why the genetic algorithm and least squares end at different constants, and whether
    that is because neither is better; "" where they do not differ. sd_mm: the error of the readings."""
    least = {name: float(x) for name, x in zip((p.name for p in fit.parameters), fit.theta, strict=True)}
    if max(abs(genetic[n] - least[n]) for n in NAMES) <= APART * MOONEY_RIVLIN.of(least).scale:
        return "", False
    errors = cost(genetic), cost(least)
    ends = [
        f"C10 = {v['C10']:.3f} and C01 = {v['C01']:.3f} MPa ({e:.3f} mm)"
        for v, e in zip((genetic, least), errors)
    ]
    said = f"The genetic algorithm ends at {ends[0]}, least squares at {ends[1]}"
    stuck = [name for name in NAMES if name in fit.at_bound]
    if not abs(errors[1] - errors[0]) < sd_mm:
        return (
            f"{said}: least squares fits all values, the genetic algorithm only those of its objective.",
            False,
        )
    said += f". Both lie on one flat ridge: their errors differ by {abs(errors[1] - errors[0]):.2g} mm"
    said += f", a reading is known to {sd_mm:.2g} mm only."
    if stuck:
        said += f" Least squares slides along it down to the bound of {' and '.join(stuck)}."
    return f"{said} So neither is the better answer.", True
