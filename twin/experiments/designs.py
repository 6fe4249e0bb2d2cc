"""Variables and a number of runs -> the values that the runs take, and what each variable does to an answer.

The points are the first of a scrambled Sobol sequence (Sobol 1967, doi:10.1016/0041-5553(67)90144-9), that of
scipy.stats.qmc: more runs only add to fewer.

Effects are least squares of the answer over shares of the variables' ranges, y = b0 + sum b_k t_k: b_k is the
change of the answer from the lowest to the highest value of a variable, the others averaged, with its
standard error. Standardised, b_k sd(t_k) / sd(y), such slopes are comparable between answers (Saltelli et al.
2008, Global Sensitivity Analysis, section 1.2.5, doi:10.1002/9780470725184). A model has no noise: what the
plane leaves is bend and interaction, and the standard errors say how far these may mislead.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.model.rangedresponse import spread
from twin.targets import Array

MOST = 100_000  # runs


@dataclass(frozen=True)
class Variable:
    """A variable of a design: its name, and its lowest and highest value in `unit`. whole: it takes whole
    numbers."""

    name: str
    low: float
    high: float
    unit: str = ""
    whole: bool = False

    @property
    def title(self) -> str:
        """Its name with its unit, unless the name says it."""
        return f"{self.name}, {self.unit}" if self.unit and not self.name.endswith("_mm") else self.name

    def at(self, share: Array) -> Array:
        """Values (n,) at shares (n,) of the range, 0 to 1; of whole numbers each takes an equal share."""
        if self.whole:
            return np.minimum(np.floor(self.low + share * (self.high - self.low + 1)), self.high)
        return self.low + share * (self.high - self.low)


def sobol_design(variables: Sequence[Variable], *, runs: int, seed: int) -> Array:
    """Values (runs, d) of the variables in each run.

    seed: of the scrambling. Raises ValueError for runs that make no design.

    >>> x = sobol_design([Variable("C10", 0.1, 0.3, "MPa")], runs=4, seed=1)[:, 0]
    >>> np.floor((x - 0.1) / 0.05).astype(int).tolist()  # one in each quarter of the range
    [1, 3, 2, 0]
    """
    if not 2 <= runs <= MOST:
        raise ValueError(f"--runs {runs}: wanted 2 to {MOST} runs")
    share = spread(np.zeros(len(variables)), np.ones(len(variables)), runs, seed=seed)
    return np.stack([v.at(share[:, k]) for k, v in enumerate(variables)], axis=1)


BINS = 4  # of a variable with many values
FEW = 6  # values of a variable that are levels, at most
STILL = 1e-9  # of an answer's size: it does not change at all


@dataclass(frozen=True)
class MainEffects:
    """Of one answer: change (d,) from the lowest to the highest value of each variable, in the answer's unit,
    with its standard error sd (d,), standardised (d,) without unit, and the share of the answer's variance
    that the plane explains."""

    change: Array
    sd: Array
    standardised: Array
    explained: float


def main_effects(x: Array, y: Array, low: Array, high: Array) -> MainEffects | None:
    """The main effects of variables x (n, d) on an answer y (n,), between low (d,) and high (d,).

    None where the runs are too few, or do not tell the variables apart.

    >>> x = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0], [1.0, 2.0]])
    >>> effects = main_effects(x, 3 * x[:, 0] - x[:, 1], np.zeros(2), np.array([1.0, 2.0]))
    >>> effects.change.round(6), round(effects.explained, 6)
    (array([ 3., -2.]), 1.0)
    """
    n, d = x.shape
    share = (x - low) / (high - low)
    plane = np.column_stack([np.ones(n), share])
    if n < d + 2 or np.linalg.matrix_rank(plane) < d + 1:
        return None
    spread = float(y.std())
    if spread <= STILL * float(np.abs(y).max()):
        return MainEffects(np.zeros(d), np.zeros(d), np.zeros(d), 1.0)
    inverse = np.linalg.inv(plane.T @ plane)
    slopes = inverse @ (plane.T @ y)
    residual = float(((y - plane @ slopes) ** 2).sum())
    sd = np.sqrt(residual / (n - d - 1) * np.diag(inverse))
    return MainEffects(
        change=slopes[1:],
        sd=sd[1:],
        standardised=slopes[1:] * share.std(axis=0) / spread,
        explained=1.0 - residual / (n * spread**2),
    )


def levels_of(x: Array, y: Array, low: float, high: float) -> Array:
    """Rows (m, 3) of a variable x (n,): a level or the middle of a bin, the mean of the answer y (n,) there,
    and the standard error of that mean, NaN of a single run.

    Up to FEW values of a variable are levels; else its range falls into BINS equal bins.
    """
    values = np.unique(x)
    if len(values) <= FEW:
        groups = [(float(v), y[x == v]) for v in values]
    else:
        edges = np.linspace(low, high, BINS + 1)
        number = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, BINS - 1)
        middle = (edges[:-1] + edges[1:]) / 2
        groups = [(float(middle[k]), y[number == k]) for k in range(BINS) if (number == k).any()]
    error = [float(y.std(ddof=1) / np.sqrt(len(y))) if len(y) > 1 else np.nan for _, y in groups]
    return np.array([(level, answers.mean(), sd) for (level, answers), sd in zip(groups, error, strict=True)])
