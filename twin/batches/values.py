"""Comparable quantities of two batches: the constants' sum and share, and the effects, each with its sd.

C10 and C01 trade off within one fit, so a difference in one of them says little. Their sum and the share of
C01 are nearly uncorrelated: they are compared in their place.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibrate import Fit
from twin.judging.fitrecord import FitRecord
from twin.laws.mooneyrivlin import NAMES

SUM, SHARE = "C10 + C01", "C01/(C10 + C01)"
Z95 = 1.959964  # of a normal distribution


@dataclass(frozen=True, kw_only=True)
class BatchValue:
    """One quantity of a batch with its sd, which is None, with a note, where there is no interval."""

    name: str
    value: float
    unit: str
    sd: float | None
    note: str

    @property
    def span(self) -> tuple[float, float] | None:
        """Its 95 % interval."""
        return None if self.sd is None else (self.value - Z95 * self.sd, self.value + Z95 * self.sd)


@dataclass(frozen=True, kw_only=True)
class BatchChange:
    """Difference of a quantity between two batches, with its 95 % interval, None where unknown."""

    name: str
    before: float
    after: float
    unit: str
    low: float | None
    high: float | None
    note: str

    @property
    def difference(self) -> float:
        """After - before."""
        return self.after - self.before

    @property
    def known(self) -> bool:
        """True where the 95 % interval of the difference excludes zero."""
        return self.low is not None and self.high is not None and (self.low > 0 or self.high < 0)

    @property
    def words(self) -> str:
        """The change in a sentence."""
        unit = f" {self.unit}".rstrip()
        if self.low is None or self.high is None:
            return (f"{self.name}: {self.before:.4g}{unit} before, {self.after:.4g}{unit} now. Whether that "
                    f"is a change is not known: {self.note}.")  # fmt: skip
        digits = max(0, 1 - math.floor(math.log10(self.high - self.low)))
        span = f"(95 % interval of the difference: {self.low:.{digits}f} to {self.high:.{digits}f}{unit})"
        if not self.known:
            return f"{self.name} has not changed measurably: {self.difference:+.{digits}f}{unit} {span}."
        turn = "larger" if self.difference > 0 else "smaller"
        part = f", {100 * abs(self.difference / self.before):.2g} %," if self.before else ""
        return f"{self.name} is {turn} by {abs(self.difference):.{digits}f}{unit}{part} {span}."


def values_of(record: FitRecord) -> tuple[BatchValue, ...]:
    """The quantities of a fit.json: sum and share where both constants were fitted, then all others.

    The sds of sum and share follow from the covariance to first order. A quantity has none where the fit says
    that its parameter has no interval.
    """
    fit, notes = record.fit, {name: _reason(e.note) for name, e in record.estimates.items()}
    both = set(NAMES) <= set(notes)
    return (*(_pair(fit, notes) if both else ()), *_others(fit, notes, but=NAMES if both else ()))


def _reason(note: str) -> str:
    """Reason against an interval, without its introduction."""
    return "; ".join(part.removeprefix("no interval: ") for part in note.split("; "))


def _pair(fit: Fit, notes: Mapping[str, str]) -> tuple[BatchValue, BatchValue]:
    i, j = ([p.name for p in fit.parameters].index(name) for name in NAMES)
    a, b = float(fit.theta[i]), float(fit.theta[j])
    block = fit.covariance[np.ix_([i, j], [i, j])]
    note = next((notes[name] for name in NAMES if notes[name]), "")
    slopes = {SUM: np.ones(2), SHARE: np.array([-b, a]) / (a + b) ** 2}
    sd = {name: None if note else math.sqrt(float(g @ block @ g)) for name, g in slopes.items()}
    return (
        BatchValue(name=SUM, value=a + b, unit=fit.parameters[i].unit, sd=sd[SUM], note=note),
        BatchValue(name=SHARE, value=b / (a + b), unit="", sd=sd[SHARE], note=note),
    )


def _others(fit: Fit, notes: Mapping[str, str], *, but: Sequence[str]) -> tuple[BatchValue, ...]:
    rows = zip(fit.parameters, fit.theta, fit.sd, strict=True)
    return tuple(
        BatchValue(
            name=p.name,
            value=float(x),
            unit=p.unit,
            sd=None if notes[p.name] else float(sd),
            note=notes[p.name],
        )
        for p, x, sd in rows
        if p.name not in but
    )


def changes_of(before: Sequence[BatchValue], after: Sequence[BatchValue]) -> tuple[BatchChange, ...]:
    """Differences of the quantities that two batches share, with independent errors."""
    former = {v.name: v for v in before}
    return tuple(_change(former[v.name], v) for v in after if v.name in former)


def _change(a: BatchValue, b: BatchValue) -> BatchChange:
    note = "; ".join(dict.fromkeys(v.note for v in (a, b) if v.note))
    half = None if a.sd is None or b.sd is None else Z95 * math.hypot(a.sd, b.sd)
    ends = (None, None) if half is None else (b.value - a.value - half, b.value - a.value + half)
    return BatchChange(
        name=b.name, before=a.value, after=b.value, unit=b.unit, low=ends[0], high=ends[1], note=note
    )
