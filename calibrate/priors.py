"""Normal priors of parameters as further rows of a residual, and their influence on a fit.

A normal prior of a parameter, or of a sum or a share of two, is a measurement of its own: (value - mean) / sd
stands beside the whitened residual, and counts as one value more.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrate.fit import Jacobian, Residual
from calibrate.parameters import Array, Fit
from calibrate.profiles import Held

NOTHING = 1e-6  # of a prior's precision, below which the data say nothing beside it


@dataclass(frozen=True, eq=False)
class Prior:
    """Normal prior of a quantity, with mean and sd in its unit.

    >>> from calibrate import Parameter
    >>> c10 = Held.parameter([Parameter("C10", 0.0, 1.0, "MPa")], "C10")
    >>> Prior(c10, 0.2, 0.05).value(np.array([0.3])).__round__(6)
    2.0
    """

    held: Held
    mean: float
    sd: float

    def value(self, theta: Array) -> float:
        """(value - mean) / sd at theta (d,)."""
        return (self.held.value(theta) - self.mean) / self.sd

    def slope(self, theta: Array) -> Array:
        """Derivative (d,) of `value`."""
        return self.held.slope(theta) / self.sd

    def share_in(self, fit: Fit) -> "Pull":
        """Influence of this prior on a fit that includes it."""
        gradient = self.held.slope(fit.theta)
        rows = np.flatnonzero(gradient)
        g, covariance = gradient[rows], fit.covariance[np.ix_(rows, rows)]
        inside = np.isfinite(fit.sd[rows]).all()  # no parameter at its bound
        variance = float(g @ covariance @ g) if inside else math.nan
        return Pull.of(self.mean, self.sd, self.held.value(fit.theta), variance)


@dataclass(frozen=True)
class Pull:
    """Influence of a prior on a fit.

    value: fitted; without, sd_without: value and sd without the prior; moved: change of the value in that sd;
    apart: distance of prior and data in the sd of their difference. NaN at a bound, and where only the prior
    determines the value.
    """

    value: float
    without: float
    sd_without: float
    moved: float
    apart: float

    @staticmethod
    def of(mean: float, sd: float, value: float, variance: float) -> "Pull":
        """Influence of a prior on a fitted value with its variance.

        Precisions of independent sources add up: 1 / variance = 1 / sd^2 + 1 / sd_without^2, to first order.

        >>> Pull.of(0.0, 1.0, 1.0, 0.5)
        Pull(value=1.0, without=2.0, sd_without=1.0, moved=-1.0, apart=1.414...)
        """
        precision = 1 / variance - 1 / sd**2 if variance > 0 else math.nan
        if not precision > NOTHING / sd**2:
            return Pull(value, math.nan, math.nan, math.nan, math.nan)
        without = (value / variance - mean / sd**2) / precision
        sd_data = 1 / math.sqrt(precision)
        apart = abs(without - mean) / math.hypot(sd_data, sd)
        return Pull(value, without, sd_data, (value - without) / sd_data, apart)


def with_priors(
    residual: Residual, jacobian: Jacobian, priors: Sequence[Prior]
) -> tuple[Residual, Jacobian]:
    """Residual (n + k,) and Jacobian (n + k, d) with a row for each of k priors at the end."""

    def values(theta: Array) -> Array | None:
        r = residual(theta)
        return None if r is None else np.append(r, [prior.value(theta) for prior in priors])

    return values, rows_beside(jacobian, priors)


def rows_beside(rows: Jacobian, priors: Sequence[Prior]) -> Jacobian:
    """Rows (n + k, d), with the slopes of k priors at the end."""
    return lambda theta: np.vstack([rows(theta), *(prior.slope(theta) for prior in priors)])
