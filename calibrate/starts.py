"""Least squares from many starts -> where each of them ended, the best first: whether there is one optimum.

A Latin hypercube (M. D. McKay, R. J. Beckman, W. J. Conover 1979, doi:10.2307/1268522) spreads the starts
over the bounds. Sorted, the ends make a waterfall: a flat step of many ends at the bottom, found again and
again, speaks for the best there is (A. Raue et al. 2013, doi:10.1371/journal.pone.0074335).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibrate.parameters import Array, Fit, Parameter, bounds

SAME = 1.0  # of chi2, by which ends at one optimum differ at most, and of chi2 as it rises around the better
NEAR = 1.0  # typical steps that a parameter lies apart at most where the better end has no sd of it


@dataclass(frozen=True, eq=False)
class Ended:
    """A descent: its start (d,), and the fit where it ended; None where the model has no answer there."""

    start: Array
    fit: Fit | None

    @property
    def chi2(self) -> float:
        """Of the end; inf where there is none."""
        return np.inf if self.fit is None else self.fit.chi2


@dataclass(frozen=True, eq=False)
class Optimum:
    """Ends that are one: the best of them, and their number."""

    fit: Fit
    count: int


def latin(parameters: Sequence[Parameter], count: int, *, seed: int) -> Array:
    """So many starts (count, d) within the bounds, each in its own slice of every one of them."""
    low, high = bounds(tuple(parameters))
    from scipy.stats import qmc

    return np.asarray(low + (high - low) * qmc.LatinHypercube(len(low), rng=seed).random(count))


def waterfall(fit: Callable[[Array], Fit], starts: Array) -> tuple[Ended, ...]:
    """The descents from starts (m, d), the best end first. fit: start (d,) -> where it ends."""
    found = [(start, fit(start)) for start in starts]
    ends = [Ended(start, end if np.isfinite(end.chi2) else None) for start, end in found]
    return tuple(sorted(ends, key=lambda end: end.chi2))


def optima(ends: Sequence[Ended]) -> tuple[Optimum, ...]:
    """The different optima among ends that are sorted, the best first."""
    groups: list[list[Fit]] = []
    for end in ends:
        if end.fit is None:
            continue
        own = next((group for group in groups if _one(group[0], end.fit)), None)
        if own is None:
            groups.append([end.fit])
        else:
            own.append(end.fit)
    return tuple(Optimum(group[0], len(group)) for group in groups)


def _one(a: Fit, b: Fit) -> bool:
    """Whether two fits, the first no worse, are at one optimum: 1 sd of the first holds the second, along
    each direction of its covariance. Where descents end early in a flat valley, it does; in another valley
    it does not, however equal its bottom."""
    apart, inside = b.theta - a.theta, np.array([p.name not in a.at_bound for p in a.parameters])
    known = inside & np.isfinite(np.diag(a.covariance))  # neither at a bound nor left open by the data
    steps = np.abs(apart / [p.step for p in a.parameters])[~known]
    rises = float(apart[known] @ np.linalg.lstsq(a.covariance[np.ix_(known, known)], apart[known])[0])
    return b.chi2 - a.chi2 <= SAME and rises <= SAME and bool((steps <= NEAR).all())
