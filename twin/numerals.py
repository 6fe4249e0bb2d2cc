"""Numbers as text for people: in the report and in messages."""

import math
from collections.abc import Mapping
from typing import Any

from twin.judging.fitrecord import Estimate


def short(value: Any) -> str:
    """A number with three significant digits, whole from 100 on; text unchanged; a dash for None.

    >>> short(0.123456), short(1234.5), short(1.2e-7), short(None)
    ('0.123', '1,234', '1.20e-07', '–')
    """
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


def interval(low: Any, high: Any) -> str:
    """The 95 % interval of a parameter, both ends with the digits that its width gives.

    >>> interval(0.19873, 0.20411)
    '0.1987 to 0.2041'
    """
    if not _known(low) or not _known(high):
        return "–"
    digits = _digits(low, high)
    return f"{low:.{digits}f} to {high:.{digits}f}"


def value(best: Any, low: Any, high: Any) -> str:
    """The value of a parameter with as many digits as its interval.

    >>> value(0.2014239, 0.19873, 0.20411)
    '0.2014'
    """
    if not _known(best) or not _known(low) or not _known(high):
        return short(best)
    return f"{best:.{_digits(low, high)}f}"


def with_sd(number: float, sd: float) -> str:
    """A number with its sd, both to the digits that the sd has.

    >>> with_sd(111.8234, 0.1234), with_sd(-0.0004, 0.31)
    ('111.82 +- 0.12', '0.00 +- 0.31')
    """
    digits = _digits(0.0, sd)
    return f"{round(number, digits) + 0.0:.{digits}f} +- {sd:.{digits}f}"


def probability(p: Any) -> str:
    """A probability with two digits; a bound where it is too small to print.

    >>> probability(0.03214), probability(1e-120)
    ('0.032', '< 1e-99')
    """
    if not _known(p):
        return "–"
    return "< 1e-99" if p < 1e-99 else f"{p:.2g}"


def correlation(r: Any) -> str:
    """A correlation with two digits of its distance from 1.

    >>> correlation(0.5), correlation(0.99876)
    ('0.50', '0.9988')
    """
    if not _known(r):
        return "–"
    lack = max(1.0 - abs(r), 1e-9)
    return f"{r:.{min(max(2, 1 - math.floor(math.log10(lack))), 9)}f}"


def in_words(estimates: Mapping[str, Estimate]) -> str:
    """All estimates in a line: values with intervals; a note of several stands once, at the end."""
    notes = [e.note for e in estimates.values()]
    shared = {note for note in notes if note and notes.count(note) > 1}
    cells = [_cell(name, e, shared) for name, e in estimates.items()]
    return ", ".join(cells) + "".join(f"; {note}" for note in sorted(shared))


def _cell(name: str, e: Estimate, shared: set[str]) -> str:
    text = f"{name} = {value(e.value, e.low, e.high)} {e.unit}".rstrip()
    if e.note:
        return text if e.note in shared else f"{text} ({e.note})"
    return f"{text} (95 %: {interval(e.low, e.high)})"


def _known(number: Any) -> bool:
    return isinstance(number, int | float) and math.isfinite(number)


def _digits(low: float, high: float) -> int:
    """Decimals that show the interval's width with two significant digits."""
    width = abs(high - low)
    return max(0, 1 - math.floor(math.log10(width))) if width > 0 else 6
