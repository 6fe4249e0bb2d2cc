"""What may vary in a calibration (`Parameter`), and what was found and how well it is known (`Fit`)."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """One number to be found between two bounds.

    low, high: bounds in `unit`. null: the value at which what it stands for is absent. typical: a step
    that is felt, a tenth of the range unless given. plausible: where experience expects it. start: a
    nominal value. Raises ValueError for bounds that are not finite and ordered, for a step that is not
    positive, and for a start outside the bounds.
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
        """A change that is felt, in `unit`: `typical`, or a tenth of the range."""
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
    """The parameters that fit best and how well the data know them.

    theta (d,) in the units of `parameters`. covariance (d, d) is inv(J'J) of the whitened Jacobian at
    theta, over the parameters inside their bounds; rows of a parameter at its bound (`at_bound`) are 0:
    the covariance holds on condition that it stays there. A parameter that the data leave undetermined
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
        half = float(ndtri(0.5 + level / 2)) * sd
        return np.stack([np.maximum(self.theta - half, low), np.minimum(self.theta + half, high)], axis=1)

    def to_dict(self) -> dict[str, Any]:
        """What fit.json holds: strict JSON, None for what is infinite or unknown."""
        values = {
            p.name: {"value": float(x), "sd": _finite(s)} | _given(p)
            for p, x, s in zip(self.parameters, self.theta, self.sd)
        }
        plain = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "theta"}
        covariance = [[_finite(x) for x in row] for row in self.covariance]
        return plain | {
            "parameters": values,
            "covariance": covariance,
            "chi2": _finite(self.chi2),
            "at_bound": list(self.at_bound),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Fit":
        """The Fit that `to_dict` wrote. Raises ValueError naming a key that is absent."""
        absent = sorted({f.name for f in fields(cls)} - {"theta"} - set(data))
        if absent:
            raise ValueError(f"a record of a fit without {', '.join(absent)}: not complete; calibrate again")
        rows = data["parameters"]
        covariance = np.array([[np.nan if x is None else x for x in row] for row in data["covariance"]])
        diagonal = np.diag(covariance)
        np.fill_diagonal(covariance, np.where(np.isnan(diagonal), np.inf, diagonal))
        return cls(
            parameters=tuple(_parameter(name, row) for name, row in rows.items()),
            theta=np.array([row["value"] for row in rows.values()], float),
            covariance=covariance,
            chi2=math.inf if data["chi2"] is None else data["chi2"],
            degrees_of_freedom=data["degrees_of_freedom"],
            seed=data["seed"],
            evaluations=data["evaluations"],
            converged=data["converged"],
            reason=data["reason"],
            at_bound=tuple(data["at_bound"]),
        )


def _finite(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


def _given(parameter: Parameter) -> dict[str, Any]:
    """The parameter's own fields, without its name and without what was never given."""
    return {k: v for k, v in asdict(parameter).items() if k != "name" and v is not None}


def _parameter(name: str, row: Mapping[str, Any]) -> Parameter:
    own = {k: v for k, v in row.items() if k not in ("value", "sd")}
    if "plausible" in own:
        own["plausible"] = tuple(own["plausible"])  # JSON has no tuples
    return Parameter(name, **own)
