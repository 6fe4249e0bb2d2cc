"""The 95 % intervals of a fit's parameters: fit.json, diagnosis.json, the terminal and the report show these.

An interval says how far the truth may be if the model is right. So a model that does not fit has none.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from calibrate import Fit, Parameter
from twin.judging.comparison import Comparison
from twin.judging.fitrecord import Estimate, FitRecord, Interval, MaterialTestsRow
from twin.judging.jointfit import doubt_of_tests


def estimates(
    fit: Fit, comparison: Comparison, tests: MaterialTestsRow | None = None
) -> dict[str, Estimate]:
    """The estimate of each parameter of a fit by its name, its interval cut at the parameter's bounds.

    comparison: of the same fit, and tests, how it agrees with tests of the silicone; where the model does not
    fit, nothing has an interval.
    """
    rows = zip(fit.parameters, fit.theta, fit.interval(0.95), strict=True)
    doubt = doubt_of_tests(tests) or comparison.doubt
    return {row[0].name: _estimate(fit, doubt, *row) for row in rows}


def united(every: Sequence[Mapping[str, Estimate]]) -> dict[str, Estimate]:
    """The estimates by name of what several models have that cannot be told apart: values of the first, each
    interval the union of theirs; none where one has none.

    >>> rows = [{"C10": Estimate(value=v, unit="MPa", low=v - 1, high=v + 1)} for v in (2.0, 3.5)]
    >>> found = united([*rows, {**rows[0], "C01": rows[0]["C10"]}])["C10"]
    >>> found.value, found.low, found.high
    (2.0, 1.0, 4.5)
    """
    out = {}
    for name, first in every[0].items():
        rows = [row[name] for row in every if name in row]
        spans = [(r.low, r.high) for r in rows if r.low is not None and r.high is not None]
        if len(spans) == len(every):
            low, high = min(low for low, _ in spans), max(high for _, high in spans)
            out[name] = first.model_copy(update={"low": low, "high": high})
        elif len(rows) == len(every):
            out[name] = next(r for r in rows if r.low is None)
    return out


def _estimate(fit: Fit, doubt: str, parameter: Parameter, value: float, span: Any) -> Estimate:
    notes = _known(fit, parameter, float(value))
    notes += [f"no interval: {doubt}"] if doubt else []
    low, high = (None, None) if notes else (float(x) for x in span)
    return Estimate(value=value, unit=parameter.unit, low=low, high=high, note="; ".join(notes))


def _known(fit: Fit, parameter: Parameter, value: float) -> list[str]:
    """Reasons for which a parameter has no interval whatever the model: it ends at a bound, or the data do
    not determine it."""
    if parameter.name in fit.at_bound:
        return [f"ends at its bound of {value:g} {parameter.unit}".rstrip()]
    sd = fit.sd[[p.name for p in fit.parameters].index(parameter.name)]
    return [] if np.isfinite(sd) else ["the data leave it undetermined"]


def fit_record(
    fit: Fit, comparison: Comparison, *, material_tests: MaterialTestsRow | None = None, **beside: Any
) -> FitRecord:
    """The record of fit.json: the fit, the adequacy of the model, the intervals, and what stands beside
    them."""
    rows = estimates(fit, comparison, material_tests)
    intervals = {name: Interval(low=e.low, high=e.high, note=e.note) for name, e in rows.items()}
    adequate = comparison.adequate and not doubt_of_tests(material_tests)
    return FitRecord.of(
        fit, adequate=adequate, intervals=intervals, material_tests=material_tests, **beside
    )
