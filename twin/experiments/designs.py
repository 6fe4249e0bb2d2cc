"""Variables and a number of runs -> the design of an experiment: the values that the runs take.

The points are the first of a scrambled Sobol sequence (Sobol 1967, doi:10.1016/0041-5553(67)90144-9), that of
scipy.stats.qmc: more runs only add to fewer.
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
