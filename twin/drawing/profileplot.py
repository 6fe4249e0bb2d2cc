"""Turns likelihood profiles into a picture: one panel a value, likelihood ratio against the value."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.interpolate import PchipInterpolator

from twin.drawing.theme import AFTER, BEFORE, MUTED, NOISE, legend_above, png, style
from twin.targets import Array

COLUMNS = 3
SHOWN = 8.0  # deviance up to which points are shown


@dataclass(frozen=True, kw_only=True)
class ProfileCurve:
    """A profile: values (v,) in rising order with their deviances (v,), the best value, and the normal
    approximation by the fit's covariance: its centre and sd, NaN where there is none."""

    title: str
    values: Array
    deviances: Array
    best: float
    centre: float
    sd: float


def draw_profiles(curves: Sequence[ProfileCurve], *, level: float) -> bytes:
    """A PNG of likelihood ratios exp(-deviance / 2); level: the deviance at the ends of the 95 % interval."""
    columns = min(COLUMNS, len(curves))
    rows = math.ceil(len(curves) / columns)
    with style():
        figure = Figure(figsize=(max(2.6 * columns + 0.6, 4.8), 2.1 * rows + 0.5), layout="constrained")
        panels = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
        for axes, curve in zip(panels, curves, strict=False):
            _panel(axes, curve, level)
        for axes in panels[len(curves) :]:
            axes.set_axis_off()
        for axes in panels[::columns]:
            axes.set_ylabel("likelihood ratio")
        legend_above(figure, panels[0])
        return png(figure)


def _panel(axes: Axes, curve: ProfileCurve, level: float) -> None:
    near = curve.deviances <= SHOWN
    x, first = np.unique(curve.values[near], return_index=True)
    deviance = np.maximum(curve.deviances[near][first], 0.0)
    root = np.sign(x - curve.best) * np.sqrt(deviance)  # nearly straight: between solves drawn through it
    if len(x) > 1:
        fine = np.linspace(x[0], x[-1], 300)
        axes.plot(fine, np.exp(-(PchipInterpolator(x, root)(fine) ** 2) / 2), color=AFTER, label="profile")
        if math.isfinite(curve.sd) and curve.sd > 0:
            normal = np.exp(-(((fine - curve.centre) / curve.sd) ** 2) / 2)
            axes.plot(fine, normal, "--", color=BEFORE, label="by covariance")
    axes.plot(x, np.exp(-deviance / 2), "o", color=AFTER, markersize=3.5, label="solved")
    axes.axvline(curve.best, color=MUTED, linewidth=0.8)
    axes.axhline(math.exp(-level / 2), color=NOISE, linewidth=1.0, linestyle=":", label="95 %")
    axes.set_ylim(0, 1.05)
    axes.set_title(curve.title)
    axes.tick_params(axis="x", labelsize=7.5)
