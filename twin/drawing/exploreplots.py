"""Turns a design of experiments into pictures: main effects, and parallel coordinates of all runs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from twin.drawing.theme import AFTER, INK, MEASURED, MUTED, png, style
from twin.targets import Array

COLOURS = "viridis"


@dataclass(frozen=True)
class EffectPanel:
    """One answer over one variable: its runs x (n,) and y (n,), and rows (m, 3) of the means of levels or
    bins: where, the mean, its standard error."""

    x: Array
    y: Array
    levels: Array


@dataclass(frozen=True)
class Coordinate:
    """One axis of parallel coordinates: its title, and values (n,) of the runs."""

    title: str
    values: Array


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


def draw_parallel(coordinates: Sequence[Coordinate], *, colour: Array, label: str) -> bytes:
    """A PNG with a line for each run through all coordinates, coloured by values (n,) that `label` names."""
    shade = ScalarMappable(Normalize(float(colour.min()), float(colour.max())), COLOURS)
    with style({"axes.grid": False, "axes.spines.left": False, "axes.spines.bottom": False}):
        figure = Figure(figsize=(max(1.2 * len(coordinates) + 1.2, 5.0), 3.4), layout="constrained")
        axes = figure.subplots()
        heights = np.stack([_share(coordinate.values) for coordinate in coordinates], axis=1)
        place = np.arange(float(len(coordinates)))
        lines = shade.to_rgba(colour)
        for k in np.argsort(colour):
            axes.plot(place, heights[k], color=lines[k], linewidth=1.0, alpha=0.8)
        for x, coordinate in enumerate(coordinates):
            axes.axvline(x, color=MUTED, linewidth=0.8)
            for y, value in ((-0.04, coordinate.values.min()), (1.04, coordinate.values.max())):
                side = "top" if y < 0 else "bottom"
                axes.text(x, y, f"{value:.3g}", ha="center", va=side, fontsize=7.5, color=INK,
                          bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0})  # fmt: skip
        titles = [coordinate.title.replace(", ", "\n") for coordinate in coordinates]
        axes.set_xticks(place, titles, fontsize=7.5)
        axes.tick_params(axis="x", length=0, pad=12)
        axes.set_yticks([])
        axes.set_ylim(-0.14, 1.14)
        figure.colorbar(shade, ax=axes, label=label)
        return png(figure)


def _share(values: Array) -> Array:
    """Values (n,) scaled to 0 .. 1 over their range; 0.5 where the range is 0."""
    width = float(np.ptp(values))
    return (values - values.min()) / width if width > 0 else np.full(len(values), 0.5)
