"""What is known of parameters beforehand -> one more value of a residual each, and what it did to a fit.

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
    """A normal distribution of what is held, with its mean and sd in the unit of it."""

    held: Held
    mean: float
    sd: float

    def value(self, theta: Array) -> float:
        """(value - mean) / sd at theta (d,)."""
        return (self.held.value(theta) - self.mean) / self.sd

    def slope(self, theta: Array) -> Array:
        """The derivative (d,) of it."""
        return self.held.slope(theta) / self.sd

    def share_in(self, fit: Fit) -> "Pull":
        """What this prior did to a fit that knows it."""
        way = self.held.slope(fit.theta)
        own = way != 0
        known = np.isfinite(fit.sd[own]).all()  # not where a parameter ends at a bound
        after = float(way[own] @ fit.covariance[np.ix_(own, own)] @ way[own]) if known else math.nan
        return Pull.of(self.mean, self.sd, self.held.value(fit.theta), after)


@dataclass(frozen=True)
class Pull:
    """What a prior did: the fitted value, value and sd as they are without it, by which part of that sd it
    moved the value, and how far the two lie apart in sd of their difference. NaN where it is not known: at a
    bound, or where nothing else tells of the value."""

    value: float
    without: float
    sd_without: float
    moved: float
    apart: float

    @staticmethod
    def of(mean: float, sd: float, value: float, variance: float) -> "Pull":
        """That of a prior, and of a fitted value with its variance, which knows the prior. Precisions of what
        is independent add up, so that those of the prior can be taken off, to first order."""
        precision = 1 / variance - 1 / sd**2 if variance > 0 else math.nan
        if not precision > NOTHING / sd**2:
            return Pull(value, math.nan, math.nan, math.nan, math.nan)
        without = (value / variance - mean / sd**2) / precision
        own = 1 / math.sqrt(precision)
        return Pull(value, without, own, (value - without) / own, abs(without - mean) / math.hypot(own, sd))


def with_priors(
    residual: Residual, jacobian: Jacobian, priors: Sequence[Prior]
) -> tuple[Residual, Jacobian]:
    """A residual (n + k,) and its derivatives (n + k, d) with a value for each of k priors at the end."""

    def values(theta: Array) -> Array | None:
        r = residual(theta)
        return None if r is None else np.append(r, [prior.value(theta) for prior in priors])

    return values, rows_beside(jacobian, priors)


def rows_beside(rows: Jacobian, priors: Sequence[Prior]) -> Jacobian:
    """Rows (n + k, d) with those of k priors at the end."""
    return lambda theta: np.vstack([rows(theta), *(prior.slope(theta) for prior in priors)])
