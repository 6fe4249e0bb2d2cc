"""Ridge of an error over C10 and C01: the best sum for every share, and the range that fits the readings.

Two displacements at one pressure depend on C10 + C01 far more than on the share C01 / (C10 + C01). Where the
error hardly changes along the ridge, two searches end at different places of it, and neither is better.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import chdtri

from calibrate import Parameter
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.targets import Array

Cost = Callable[[Mapping[str, float]], float]  # constants in MPa -> RMS error in mm, inf without equilibrium
SHARES = 41
TOTALS = 60  # sums of the first grid, even in their logarithm


@dataclass(frozen=True)
class Ridge:
    """Best sums total (h,) MPa for shares (h,) and their errors rms_mm (h,), as far as within the bounds.

    >>> import numpy as np
    >>> line = Ridge(np.linspace(0, 1, 5), np.full(5, 0.3), np.array([3.0, 1.5, 0.5, 1.5, 3.0]))
    >>> line.agreeing(sd_mm=1.1, count=2)
    (0.25, 0.75)
    """

    share: Array
    total: Array
    rms_mm: Array

    def agreeing(self, *, sd_mm: float, count: int) -> tuple[float, float]:
        """Lowest and highest share in the 95 % interval of the profile likelihood (doi:10.2307/2347496).

        count: number of residuals, each with an error of sd_mm; their chi2 may exceed the least one by the
        95 % quantile of chi2 with one degree of freedom.
        """
        chi2 = count * self.rms_mm**2 / sd_mm**2
        inside = self.share[chi2 <= chi2.min() + chdtri(1, 0.05)]
        return float(inside.min()), float(inside.max())


def ridge(cost: Cost, parameters: tuple[Parameter, ...]) -> Ridge:
    """Ridge of an error within the bounds of C10 and C01. Raises ValueError where there is none."""
    shares = np.linspace(0.0, 1.0, SHARES)
    rows = [(share, *best) for share in shares if (best := _lowest(cost, parameters, share))]
    if not rows:
        raise ValueError(
            "no C10 + C01 within [calibrate] bounds has the least error for any share; widen the bounds"
        )
    return Ridge(*np.array(rows, float).T)


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
    best = minimize_scalar(error, bounds=bounds, method="bounded", options={"xatol": 1e-7})
    return float(np.exp(best.x)), float(best.fun)
