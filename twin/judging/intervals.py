"""The 95 % intervals of a fit's parameters: fit.json, diagnosis.json, the terminal and the report show these.

An interval says how far the truth may be if the model is right. So a model that does not fit has none.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from calibrate import Fit, Parameter
from twin.judging.comparison import Comparison


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A fitted value with its 95 % interval from low to high, or with a note that says why it has none."""

    name: str
    value: float
    unit: str
    low: float | None
    high: float | None
    note: str

    def to_dict(self) -> dict[str, Any]:
        """Its row in fit.json and diagnosis.json."""
        return {k: v for k, v in asdict(self).items() if k != "name"}


def estimates(fit: Fit, comparison: Comparison) -> tuple[Estimate, ...]:
    """One estimate for each parameter of a fit, its interval cut at the parameter's bounds.

    comparison: of the same fit; where the model does not fit, nothing has an interval.
    """
    rows = zip(fit.parameters, fit.theta, fit.interval(0.95), strict=True)
    return tuple(_estimate(fit, comparison.doubt, *row) for row in rows)


def _estimate(fit: Fit, doubt: str, parameter: Parameter, value: float, span: Any) -> Estimate:
    notes = _known(fit, parameter, float(value))
    notes += [f"no interval: {doubt}"] if doubt else []
    low, high = (None, None) if notes else (float(x) for x in span)
    note = "; ".join(notes)
    return Estimate(
        name=parameter.name, value=float(value), unit=parameter.unit, low=low, high=high, note=note
    )


def _known(fit: Fit, parameter: Parameter, value: float) -> list[str]:
    """Why a parameter has no interval whatever the model: it ends at a bound, or the data do not hold it."""
    if parameter.name in fit.at_bound:
        return [f"ends at its bound of {value:g} {parameter.unit}".rstrip()]
    sd = fit.sd[[p.name for p in fit.parameters].index(parameter.name)]
    return [] if np.isfinite(sd) else ["the data leave it undetermined"]


def fit_record(fit: Fit, comparison: Comparison) -> dict[str, Any]:
    """What fit.json holds of a fit: its own record, whether the model fits, and the intervals."""
    rows = {e.name: {"low": e.low, "high": e.high, "note": e.note} for e in estimates(fit, comparison)}
    return fit.to_dict() | {"adequate": comparison.adequate, "intervals": rows}


def estimates_of_record(record: Mapping[str, Any]) -> tuple[Estimate, ...]:
    """The estimates that a fit.json holds. A record without intervals, of an older version, has none."""
    old = {"low": None, "high": None, "note": "no interval: this fit was made by an older version"}
    found = record.get("intervals", {})
    return tuple(
        Estimate(name=name, value=p["value"], unit=p.get("unit", ""), **found.get(name, old))
        for name, p in record.get("parameters", {}).items()
    )
