"""Turns the ends of least squares from many starts into a picture: the waterfall of their misfits."""

import numpy as np
from matplotlib.figure import Figure

from twin.drawing.theme import AFTER, BEFORE, MUTED, legend_above, png, style
from twin.targets import Array

LEAST = 1e-3  # of chi2 above the best, which a logarithmic axis still shows


def draw_starts(chi2: Array, *, same: float) -> bytes:
    """A PNG of the chi2 (m,) at the ends, in rising order, above the lowest; same: up to where an end is as
    good as the best. Starts without an end (inf) are counted in the label of the axis."""
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
