"""Quantities over batches with their 95 % intervals, and where the newest was expected, as an SVG text."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin.drawing.theme import AFTER, BEFORE, FAINT, MUTED, style, svg
from twin.targets import Array


@dataclass(frozen=True, kw_only=True)
class DriftCourse:
    """One quantity over batches: values (b,), 95 % ends low and high (b,), NaN where unknown; the span in
    which the newest was expected, None where it was not tested; whether it differs."""

    name: str
    unit: str
    values: Array
    low: Array
    high: Array
    expected: tuple[float, float] | None
    differs: bool


def drift_chart(batches: Sequence[str], courses: Sequence[DriftCourse]) -> str:
    """A panel a quantity, the batches from left to right; a value without an interval is a hollow circle."""
    with style():
        figure = Figure(figsize=(7.6, 0.6 + 1.5 * len(courses)), layout="constrained")
        panels = figure.subplots(len(courses), 1, sharex=True, squeeze=False)[:, 0]
        for axes, course in zip(panels, courses, strict=True):
            _panel(axes, course)
            axes.set_title(f"{course.name}{', ' if course.unit else ''}{course.unit}")
        turned = 30 if len(batches) > 6 else 0
        panels[-1].set_xticks(range(len(batches)), batches, rotation=turned, parse_math=False)
        panels[-1].set_xlim(-0.5, len(batches) - 0.5)
        return svg(figure)


def _panel(axes: Axes, course: DriftCourse) -> None:
    x = np.arange(len(course.values))
    last = len(x) - 1
    if course.expected is not None:
        low, high = course.expected
        axes.fill_between([last - 0.35, last + 0.35], low, high, color=FAINT, label="expected")
    bounded = np.isfinite(course.low) & np.isfinite(course.high)
    colours = [BEFORE if course.differs and k == last else AFTER for k in x]
    for k in x[bounded]:
        axes.plot([k, k], [course.low[k], course.high[k]], color=colours[k], linewidth=1.6)
        axes.plot(k, course.values[k], "o", color=colours[k], markersize=5)
    axes.plot(x[~bounded], course.values[~bounded], "o", color=MUTED, markerfacecolor="none", markersize=5)
    axes.grid(axis="x", visible=False)
