"""Multi-start least squares: starts of a Latin hypercube, and their distinct optima.

A Latin hypercube (M. D. McKay, R. J. Beckman, W. J. Conover 1979, doi:10.2307/1268522) spreads the starts
over the bounds. The sorted ends make a waterfall plot: a flat step of many ends at the bottom is evidence for
the global optimum (A. Raue et al. 2013, doi:10.1371/journal.pone.0074335).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibrate.parameters import Array, Fit, Parameter, bounds

SAME = 1.0  # largest difference in chi2 of ends at one optimum, and of chi2 as it rises around the better
NEAR = 1.0  # largest difference of a parameter in typical steps, where the better end has no sd


@dataclass(frozen=True, eq=False)
class Ended:
    """Descent from a start (d,) to a fit; None where the model cannot be solved."""

    start: Array
    fit: Fit | None

    @property
    def chi2(self) -> float:
        """chi2 at the end; inf without a fit."""
        return np.inf if self.fit is None else self.fit.chi2


@dataclass(frozen=True, eq=False)
class Optimum:
    """Distinct optimum: its best fit, and the number of ends at it."""

    fit: Fit
    count: int


def latin(parameters: Sequence[Parameter], count: int, *, seed: int) -> Array:
    """Latin hypercube (count, d) within the bounds: one start in each of `count` slices of every parameter.

    >>> x = latin([Parameter("C10", 0.0, 4.0), Parameter("C01", 0.0, 4.0)], 4, seed=1)
    >>> sorted(int(v) for v in x[:, 0]), sorted(int(v) for v in x[:, 1])
    ([0, 1, 2, 3], [0, 1, 2, 3])
    """
    low, high = bounds(tuple(parameters))
    from scipy.stats import qmc

    return np.asarray(low + (high - low) * qmc.LatinHypercube(len(low), rng=seed).random(count))


def waterfall(fit: Callable[[Array], Fit], starts: Array) -> tuple[Ended, ...]:
    """Descents from starts (m, d), the best end first. fit: start (d,) -> Fit."""
    pairs = [(start, fit(start)) for start in starts]
    ends = [Ended(start, end if np.isfinite(end.chi2) else None) for start, end in pairs]
    return tuple(sorted(ends, key=lambda end: end.chi2))


def optima(ends: Sequence[Ended]) -> tuple[Optimum, ...]:
    """Distinct optima among sorted ends, the best first."""
    groups: list[list[Fit]] = []
    for end in ends:
        if end.fit is None:
            continue
        for group in groups:
            if _one(group[0], end.fit):
                group.append(end.fit)
                break
        else:
            groups.append([end.fit])
    return tuple(Optimum(group[0], len(group)) for group in groups)


def _one(a: Fit, b: Fit) -> bool:
    """True where two fits, the first no worse, lie at one optimum: the second within 1 sd of the first.

    Ends of early descents in one flat valley are one optimum; equal bottoms of two valleys are not.
    """
    apart, inside = b.theta - a.theta, np.array([p.name not in a.at_bound for p in a.parameters])
    free = inside & np.isfinite(np.diag(a.covariance))  # neither at a bound nor left open by the data
    steps = np.abs(apart / [p.step for p in a.parameters])[~free]
    rises = float(apart[free] @ np.linalg.lstsq(a.covariance[np.ix_(free, free)], apart[free])[0])
    return b.chi2 - a.chi2 <= SAME and rises <= SAME and bool((steps <= NEAR).all())
