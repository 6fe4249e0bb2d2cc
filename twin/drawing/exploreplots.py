"""Turns a design of experiments into a picture of its main effects."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from twin.drawing.theme import AFTER, MEASURED, png, style
from twin.targets import Array


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
