"""Turns a sample of a posterior into pictures: a corner plot, and the band of what would be measured."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from twin.drawing.theme import AFTER, BEFORE, MEASURED, legend_above, png, style
from twin.targets import Array

COMPONENTS = ((0, "U1"), (2, "U3"))
SIDE = 1.7  # inches of a panel


def draw_corner(values: Array, titles: Sequence[str], best: Array) -> bytes:
    """A PNG of all marginals and pairs of values (k, d) by their titles, with the best fit (d,) marked: lines
    around 10, 50 and 90 % of each pair. A value that is the same in all of the sample is left out. ValueError
    without corner."""
    corner = _corner()
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
    """A PNG of measured displacements (s, p, 3) mm of named points over time (s,) s.

    ends, outer (2, s, p, 3) mm: the 95 % bands of what the model shows, and of what would be measured again.
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


def _corner() -> Any:
    with warnings.catch_warnings():  # it imports arviz where that is installed, which warns of its future
        warnings.simplefilter("ignore", FutureWarning)
        import corner
    return corner
