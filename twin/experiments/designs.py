"""Variables and how many runs -> a design of experiments: which values the runs take.

`sobol`: the first points of a scrambled Sobol sequence (Sobol 1967, doi:10.1016/0041-5553(67)90144-9);
`latin`: a Latin hypercube (McKay et al. 1979, doi:10.2307/1268522); `factorial`: every combination of evenly
spaced levels. Both sequences are those of scipy.stats.qmc.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product

import numpy as np
from scipy.stats import qmc

from twin.model.rangedresponse import spread
from twin.targets import Array

MOST = 100_000  # runs


class DesignKind(StrEnum):
    """The designs that there are."""

    SOBOL = "sobol"
    LATIN = "latin"
    FACTORIAL = "factorial"


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

    def levels(self, count: int) -> Array:
        """Evenly spaced values from lowest to highest, `count` of them, of whole numbers each once."""
        spaced = np.linspace(self.low, self.high, count)
        return np.unique(spaced.round()) if self.whole else spaced


def design(kind: DesignKind, variables: Sequence[Variable], *, runs: int, seed: int) -> Array:
    """The values (n, d) of the variables in each run: n = runs, of a factorial design the largest n that has
    as many levels of each variable and not more runs, the last variable the fastest.

    seed: of the scrambling; a factorial design has none. Raises ValueError for runs that make no design.
    """
    d = len(variables)
    least = 2**d if kind is DesignKind.FACTORIAL else 2
    if not least <= runs <= MOST:
        why = f", 2 levels of each of {d} variables" if kind is DesignKind.FACTORIAL else ""
        raise ValueError(f"--runs {runs}: wanted {least} to {MOST} runs for the design {kind.value}{why}")
    if kind is DesignKind.FACTORIAL:
        count = max(n for n in range(2, runs + 1) if n**d <= runs) if d > 1 else runs
        return np.array(list(product(*(v.levels(count) for v in variables))), float)
    if kind is DesignKind.SOBOL:
        share = spread(np.zeros(d), np.ones(d), runs, seed=seed)
    else:
        share = qmc.LatinHypercube(d, rng=np.random.default_rng(seed)).random(runs)
    return np.stack([v.at(share[:, k]) for k, v in enumerate(variables)], axis=1)
