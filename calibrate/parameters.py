"""Parameters of a calibration (`Parameter`), and the result of a fit with its accuracy (`Fit`)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """Parameter of a fit, between two bounds.

    low, high: bounds in `unit`. null: value without the effect of the parameter. typical: a noticeable step,
    a tenth of the range by default. plausible: range expected by experience. start: nominal value. Raises
    ValueError for bounds that are not finite and ordered, for a step that is not positive, and for a start
    outside the bounds.

    >>> Parameter("C10", 0.01, 0.51, "MPa").step
    0.05
    """

    name: str
    low: float
    high: float
    unit: str = ""
    null: float | None = None
    typical: float | None = None
    plausible: tuple[float, float] | None = None
    start: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(
                f"{self.name}: bounds {self.low} .. {self.high} {self.unit}: wanted finite, the lower first"
            )
        if not (math.isfinite(self.step) and self.step > 0):
            raise ValueError(f"{self.name}: typical {self.typical} {self.unit}: wanted a positive step")
        if self.start is not None and not self.low <= self.start <= self.high:
            raise ValueError(
                f"{self.name}: start {self.start} {self.unit} is outside its bounds "
                f"{self.low} .. {self.high}; move the start or widen the bounds"
            )

    @property
    def step(self) -> float:
        """Noticeable change in `unit`: `typical`, or a tenth of the range."""
        return (self.high - self.low) / 10 if self.typical is None else self.typical


def bounds(parameters: tuple[Parameter, ...]) -> tuple[Array, Array]:
    """Lower and upper bounds, (d,) each. Raises ValueError for no parameter or for a name used twice."""
    names = [p.name for p in parameters]
    twice = sorted({name for name in names if names.count(name) > 1})
    if not names or twice:
        raise ValueError(f"parameters {names}: wanted at least one, each with a name of its own")
    return np.array([p.low for p in parameters], float), np.array([p.high for p in parameters], float)


@dataclass(frozen=True, eq=False)
class Fit:
    """Best parameters of a fit, their covariance and chi2.

    theta (d,) in the units of `parameters`. covariance (d, d) is inv(J'J) of the whitened Jacobian at
    theta, over the parameters inside their bounds; rows of a parameter at its bound (`at_bound`) are 0:
    the covariance is conditional on it. A parameter that the data leave undetermined
    has an infinite variance and NaN covariances. chi2 = r'r of the whitened residual, with
    degrees_of_freedom = values - rank. evaluations: residuals computed, over all starts.
    """

    parameters: tuple[Parameter, ...]
    theta: Array
    covariance: Array
    chi2: float
    degrees_of_freedom: int
    seed: int
    evaluations: int
    converged: bool
    reason: str
    at_bound: tuple[str, ...]

    @property
    def sd(self) -> Array:
        """Standard deviations (d,): inf where undetermined, NaN at a bound (no Gaussian error there)."""
        inside = np.array([p.name not in self.at_bound for p in self.parameters])
        return np.where(inside, np.sqrt(np.diag(self.covariance)), np.nan)

    @property
    def correlation(self) -> Array:
        """Correlations (d, d); NaN beside a parameter at its bound or undetermined."""
        sd = np.where(np.isfinite(self.sd), self.sd, np.nan)
        matrix = np.clip(self.covariance / np.outer(sd, sd), -1.0, 1.0)
        np.fill_diagonal(matrix, 1.0)
        return matrix

    def interval(self, level: float = 0.95) -> Array:
        """Two-sided intervals (d, 2) of the given level, cut at the bounds; NaN for a parameter at one."""
        low, high = bounds(self.parameters)
        sd = self.sd
        from scipy.special import ndtri

        half = float(ndtri(0.5 + level / 2)) * sd
        return np.stack([np.maximum(self.theta - half, low), np.minimum(self.theta + half, high)], axis=1)
