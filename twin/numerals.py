"""How numbers are written for people: in the report, and in what the stages say."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from twin.judging.intervals import Estimate


def short(value: Any) -> str:
    """A number with three significant digits, whole from 100 on; text as it is; a dash for nothing."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return f"{value:,}"
    if not math.isfinite(value):
        return "–"
    if 1e-4 <= abs(value) < 100 or value == 0:
        return f"{value + 0.0:.3g}"  # no "-0"
    return f"{value:,.0f}" if 100 <= abs(value) < 1e7 else f"{value:.2e}"


def interval(row: Mapping[str, Any]) -> str:
    """The 95 % interval of a parameter, both ends with the digits that its width gives."""
    if not _known(row.get("low")) or not _known(row.get("high")):
        return "–"
    digits = _digits(row)
    return f"{row['low']:.{digits}f} to {row['high']:.{digits}f}"


def value(row: Mapping[str, Any]) -> str:
    """The value of a parameter with as many digits as its interval."""
    if not _known(row.get("value")) or not _known(row.get("low")) or not _known(row.get("high")):
        return short(row.get("value"))
    return f"{row['value']:.{_digits(row)}f}"


def probability(p: Any) -> str:
    """A probability with two digits; those too small to print as a bound."""
    if not _known(p):
        return "–"
    return "< 1e-99" if p < 1e-99 else f"{p:.2g}"


def correlation(r: Any) -> str:
    """A correlation with two digits of what it lacks of 1: near 1 these are what differs."""
    if not _known(r):
        return "–"
    lack = max(1.0 - abs(r), 1e-9)
    return f"{r:.{min(max(2, 1 - math.floor(math.log10(lack))), 9)}f}"


def in_words(estimates: Sequence[Estimate]) -> str:
    """All estimates in a line: values with intervals; what several of them note stands once, at the end."""
    notes = [e.note for e in estimates]
    shared = {note for note in notes if note and notes.count(note) > 1}
    cells = [_cell(e, shared) for e in estimates]
    return ", ".join(cells) + "".join(f"; {note}" for note in sorted(shared))


def _cell(estimate: Estimate, shared: set[str]) -> str:
    row = estimate.to_dict()
    text = f"{estimate.name} = {value(row)} {estimate.unit}".rstrip()
    if estimate.note:
        return text if estimate.note in shared else f"{text} ({estimate.note})"
    return f"{text} (95 %: {interval(row)})"


def _known(number: Any) -> bool:
    return isinstance(number, int | float) and math.isfinite(number)


def _digits(row: Mapping[str, Any]) -> int:
    """Decimals that show the interval's width with two significant digits."""
    width = abs(row["high"] - row["low"])
    return max(0, 1 - math.floor(math.log10(width))) if width > 0 else 6
