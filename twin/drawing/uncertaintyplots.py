"""Plots of uncertainty, each a PNG: likelihood profiles, corner plot and band of a posterior, predictions."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.drawing.theme import (
    AFTER,
    BEFORE,
    MEASURED,
    MUTED,
    NOISE,
    legend_above,
    panels,
    png,
    style,
)  # fmt: skip
from twin.targets import Array

SHOWN = 8.0  # largest deviance of a point in the plot
COMPONENTS = ((0, "U1"), (2, "U3"))
SIDE = 1.7  # inches of a panel of the corner plot


@dataclass(frozen=True, kw_only=True)
class ProfileCurve:
    """Profile of a quantity: values (v,) in rising order, their deviances (v,), and the best value.

    centre, sd: normal approximation by the fit's covariance, NaN where there is none.
    """

    title: str
    values: Array
    deviances: Array
    best: float
    centre: float
    sd: float


def draw_profiles(curves: Sequence[ProfileCurve], *, level: float) -> bytes:
    """Likelihood ratios exp(-deviance / 2) over each quantity; level: deviance at the ends of the 95 %
    interval."""
    with style():
        size, border = (2.6, 2.1), (0.6, 0.5)
        figure, grid, edge = panels(len(curves), size=size, border=border, least=4.8, sharey=True)
        for axes, curve in zip(grid, curves, strict=True):
            _profile(axes, curve, level)
        for axes in edge:
            axes.set_ylabel("likelihood ratio")
        legend_above(figure, grid[0])
        return png(figure)


def _profile(axes: Axes, curve: ProfileCurve, level: float) -> None:
    near = curve.deviances <= SHOWN
    x, index = np.unique(curve.values[near], return_index=True)
    deviance = np.maximum(curve.deviances[near][index], 0.0)
    root = np.sign(x - curve.best) * np.sqrt(deviance)  # nearly straight, so it is interpolated
    if len(x) > 1:
        fine = np.linspace(x[0], x[-1], 300)
        root_at = scipy.interpolate.PchipInterpolator(x, root)(fine)
        axes.plot(fine, np.exp(-(root_at**2) / 2), color=AFTER, label="profile")
        if math.isfinite(curve.sd) and curve.sd > 0:
            normal = np.exp(-(((fine - curve.centre) / curve.sd) ** 2) / 2)
            axes.plot(fine, normal, "--", color=BEFORE, label="by covariance")
    axes.plot(x, np.exp(-deviance / 2), "o", color=AFTER, markersize=3.5, label="solved")
    axes.axvline(curve.best, color=MUTED, linewidth=0.8)
    axes.axhline(math.exp(-level / 2), color=NOISE, linewidth=1.0, linestyle=":", label="95 %")
    axes.set_ylim(0, 1.05)
    axes.set_title(curve.title)
    axes.tick_params(axis="x", labelsize=7.5)


def draw_corner(values: Array, titles: Sequence[str], best: Array) -> bytes:
    """Marginals and pairs of a sample (k, d), with contours at 10, 50 and 90 % and the best fit (d,) marked.

    A value that is constant over the sample is left out. Needs corner.
    """
    with warnings.catch_warnings():  # it imports arviz where that is installed, which warns of its future
        warnings.simplefilter("ignore", FutureWarning)
        import corner
    moving = np.ptp(values, axis=0) > 0
    size = int(moving.sum())
    with style({"axes.grid": False}):
        figure = Figure(figsize=(SIDE * size + 1.0, SIDE * size + 1.0))
        corner.corner(
            values[:, moving], fig=figure, labels=[t for t, m in zip(titles, moving, strict=True) if m],
            truths=best[moving], truth_color=BEFORE, color=AFTER, quantiles=(0.025, 0.975), bins=30,
            levels=(0.1, 0.5, 0.9), plot_datapoints=False, smooth=1.0,
            label_kwargs={"fontsize": 8}, max_n_ticks=4,
        )  # fmt: skip
        for axes in figure.axes:
            axes.tick_params(labelsize=6.5)
        return png(figure)


def draw_band(
    time: Array, measured: Array, ends: Array, outer: Array, *, names: Sequence[str]
) -> bytes:
    """Measured displacements (s, p, 3) mm of named points over time (s,) s, with two 95 % bands.

    ends, outer (2, s, p, 3) mm: bands of the model, and of a repeated measurement.
    """
    with style():
        figure = Figure(figsize=(7.6, 0.55 + 1.25 * len(names)), layout="constrained")
        rows = figure.subplots(len(names), len(COMPONENTS), sharex=True, squeeze=False)
        for p, name in enumerate(names):
            for axes, (i, title) in zip(rows[p], COMPONENTS, strict=True):
                axes.plot(time, measured[:, p, i], ".", color=MEASURED, markersize=3.0, label="measured")
                for pair, alpha, label in ((outer, 0.25, "measured again, 95 %"), (ends, 0.7, "model, 95 %")):
                    low, high = pair[:, :, p, i]
                    axes.fill_between(time, low, high, color=AFTER, alpha=alpha, linewidth=0, label=label)
                if p == 0:
                    axes.set_title(f"{title}, mm")
            rows[p, 0].set_ylabel(name, rotation=0, ha="right", va="center")
        for axes in rows[-1]:
            axes.set_xlabel("film time, s")
        legend_above(figure, rows[0, 0])
        return png(figure)


def draw_prediction(
    x: Array, u: Array, half: Array | None, *, names: Sequence[str], label: str, beyond: NDArray[np.bool_],
    statics: Array | None = None,
) -> bytes:  # fmt: skip
    """Predicted displacements u (s, p, 3) mm of named points over x (s,), with its axis label.

    half (s, p, 3) mm: half of the 95 % intervals, where there are any. beyond (s,): values beyond the tested
    range, on grey ground. statics (s, p, 3) mm: without inertia, dotted.
    """
    marks = "o-" if len(x) < 30 else "-"
    with style():
        figure = Figure(figsize=(7.6, 3.6), layout="constrained")
        sides = figure.subplots(1, 2)
        for axes, (i, title) in zip(sides, COMPONENTS, strict=True):
            for k, name in enumerate(names):
                (line,) = axes.plot(x, u[:, k, i], marks, label=name, markersize=3.5, linewidth=1.2)
                if statics is not None:
                    axes.plot(x, statics[:, k, i], ":", color=line.get_color(), linewidth=1.0)
                if half is not None:
                    ends = u[:, k, i] - half[:, k, i], u[:, k, i] + half[:, k, i]
                    axes.fill_between(x, *ends, color=line.get_color(), alpha=0.25, linewidth=0)
            low, high = axes.get_ylim()
            axes.fill_between(x, low, high, where=beyond, color=NOISE, alpha=0.25, linewidth=0)
            axes.set_ylim(low, high)
            axes.set_title(f"{title}, mm")
            axes.set_xlabel(label)
        legend_above(figure, sides[0])
        return png(figure)
