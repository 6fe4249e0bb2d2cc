"""Plots of several fits or solves: ends of least squares from many starts, material tests, a Pareto front,
the main effects of a design of experiments, and quantities over batches."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin.drawing.theme import (
    AFTER,
    BEFORE,
    EXTRA,
    FAINT,
    MEASURED,
    MUTED,
    NOISE,
    legend_above,
    panels,
    png,
    style,
    svg,
)  # fmt: skip
from twin.judging.fitrecord import MaterialTestRow
from twin.targets import Array

LEAST = 1e-3  # least chi2 above the best on the logarithmic axis


def draw_starts(chi2: Array, *, same: float) -> bytes:
    """Waterfall plot of the chi2 (m,) at the ends of least squares, in rising order, above the lowest.

    same: chi2 above the lowest up to which an end is as good as the best. Starts without an end (inf) are
    counted in the label of the axis.
    """
    ends = chi2[np.isfinite(chi2)]
    above = np.maximum(ends - ends.min(initial=np.inf), LEAST) if len(ends) else ends
    best, number = above <= same, np.arange(1, len(ends) + 1)
    lost = len(chi2) - len(ends)
    with style():
        figure = Figure(figsize=(5.2, 3.0), layout="constrained")
        axes = figure.subplots()
        axes.plot(number, above, color=MUTED, linewidth=0.8)
        axes.plot(number[best], above[best], "o", color=AFTER, markersize=5, label="at the best")
        axes.plot(number[~best], above[~best], "o", color=BEFORE, markersize=5, label="elsewhere")
        axes.axhline(same, color=MUTED, linestyle=":", linewidth=1.0)
        axes.set_yscale("log")
        axes.set_ylim(LEAST / 2, 2 * max(float(above.max(initial=same)), 10 * same))
        axes.set_xlabel("start, the best end first" + (f"; {lost} without an end" if lost else ""))
        axes.set_ylabel("chi2 above the lowest")
        legend_above(figure, axes)
        return png(figure)


def draw_curves(tests: Sequence[MaterialTestRow]) -> bytes:
    """Nominal stress over strain of each material test: measured with 1 sd, and the fitted law."""
    with style():
        figure, grid, edge = panels(len(tests), size=(2.8, 2.4), border=(0.4, 0.4), least=4.8)
        for axes, test in zip(grid, tests, strict=True):
            strain, order = 100 * np.array(test.strain), np.argsort(test.strain)
            axes.errorbar(strain, test.stress_MPa, yerr=test.sd_MPa, fmt="o", color=MEASURED, markersize=3.0,
                          linewidth=0.8, label="measured, 1 sd")  # fmt: skip
            axes.plot(strain[order], np.array(test.fitted_MPa)[order], color=AFTER, label="law of the fit")
            axes.set_title(f"{test.name} ({test.kind})")
            axes.set_xlabel("amount of shear, %" if test.kind == "shear" else "nominal strain, %")
        for axes in edge:
            axes.set_ylabel("nominal stress, MPa")
        legend_above(figure, grid[0])
        return png(figure)


def draw_front(
    names: Sequence[str], *, front: Array, solved: Array, knee: int, fit: Array, noise: Array
) -> bytes:
    """Misfits over their errors, a panel for each pair of the m objectives.

    front (n, m): by the response; solved (k, m): by whole solves, with the index of the knee; fit (m,): of
    the one fit; noise (m,): misfits up to which an objective is as good as fitted alone.
    """
    pairs = list(combinations(range(len(names)), 2))
    with style():
        figure, grid, _ = panels(len(pairs), size=(3.2, 3.0), border=(0.0, 0.5), least=7.0)
        for axes, (i, k) in zip(grid, pairs, strict=True):
            axes.axvspan(0, noise[i], color=NOISE, alpha=0.15, linewidth=0)
            axes.axhspan(0, noise[k], color=NOISE, alpha=0.15, linewidth=0, label="within noise of its best")
            axes.plot(front[:, i], front[:, k], ".", color=MEASURED, markersize=4, label="response")
            axes.plot(solved[:, i], solved[:, k], "o", color=AFTER, markersize=4.5, label="solved")
            axes.plot(*solved[knee, [i, k]], "D", color=EXTRA, markersize=6, label="knee")
            axes.plot(fit[i], fit[k], "*", color=BEFORE, markersize=11, label="the one fit")
            for n, set_limits in ((i, axes.set_xlim), (k, axes.set_ylim)):
                low, high = min(solved[:, n].min(), fit[n]), max(solved[:, n].max(), fit[n], noise[n])
                room = 0.08 * (high - low) or 0.1 * high
                set_limits(low - room, high + room)
            axes.set_xlabel(f"misfit of {names[i]} over its errors")
            axes.set_ylabel(f"misfit of {names[k]} over its errors")
        legend_above(figure, grid[0])
        return png(figure)


@dataclass(frozen=True)
class EffectPanel:
    """One answer over one variable: its runs x (n,) and y (n,), and rows (m, 3) of the means of levels or
    bins: where, the mean, its standard error."""

    x: Array
    y: Array
    levels: Array


def draw_effects(
    panels: Sequence[Sequence[EffectPanel]], *, variables: Sequence[str], answers: Sequence[str]
) -> bytes:
    """A PNG of panels (a, d): a row for each answer, a column for each variable; the means with their
    standard errors over all runs."""
    a, d = len(answers), len(variables)
    with style():
        figure = Figure(figsize=(max(1.7 * d + 1.0, 4.0), 1.4 * a + 0.5), layout="constrained")
        grid = figure.subplots(a, d, sharex="col", sharey="row", squeeze=False)
        for row, row_panels in enumerate(panels):
            for column, panel in enumerate(row_panels):
                axes, (centre, mean, sd) = grid[row, column], panel.levels.T
                axes.plot(panel.x, panel.y, ".", color=MEASURED, markersize=3.5)
                axes.errorbar(centre, mean, np.nan_to_num(sd), fmt="o-", color=AFTER, markersize=4, capsize=2)
                axes.tick_params(labelsize=7.5)
            grid[row, 0].set_ylabel(answers[row], fontsize=8)
        for axes, name in zip(grid[-1], variables, strict=True):
            axes.set_xlabel(name, fontsize=8)
        return png(figure)


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
