"""Turns a Pareto front of misfits into a picture: one panel for each pair of objectives."""

from collections.abc import Sequence
from itertools import combinations

from matplotlib.figure import Figure

from twin.drawing.theme import AFTER, BEFORE, EXTRA, MEASURED, NOISE, legend_above, png, style
from twin.targets import Array

COLUMNS = 3


def draw_front(
    names: Sequence[str], *, front: Array, solved: Array, knee: int, fit: Array, noise: Array
) -> bytes:
    """A PNG of misfits over their errors: front (n, m) by the response, solved (k, m) by whole solves with
    the number of the knee, those of the one fit (m,); noise (m,): up to where they are as good as the best
    for each alone."""
    pairs = list(combinations(range(len(names)), 2))
    columns = min(COLUMNS, len(pairs))
    rows = -(-len(pairs) // columns)
    with style():
        size = (max(3.2 * columns, 7.0), 3.0 * rows + 0.5)
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, (i, k) in zip(grid, pairs, strict=False):
            axes.axvspan(0, noise[i], color=NOISE, alpha=0.15, linewidth=0)
            axes.axhspan(0, noise[k], color=NOISE, alpha=0.15, linewidth=0, label="within noise of its best")
            axes.plot(front[:, i], front[:, k], ".", color=MEASURED, markersize=4, label="response")
            axes.plot(solved[:, i], solved[:, k], "o", color=AFTER, markersize=4.5, label="solved")
            axes.plot(*solved[knee, [i, k]], "D", color=EXTRA, markersize=6, label="knee")
            axes.plot(fit[i], fit[k], "*", color=BEFORE, markersize=11, label="the one fit")
            for limits, set_limits in ((solved[:, i], axes.set_xlim), (solved[:, k], axes.set_ylim)):
                n = i if set_limits == axes.set_xlim else k
                low, high = min(limits.min(), fit[n]), max(limits.max(), fit[n], noise[n])
                room = 0.08 * (high - low) or 0.1 * high
                set_limits(low - room, high + room)
            axes.set_xlabel(f"misfit of {names[i]} over its errors")
            axes.set_ylabel(f"misfit of {names[k]} over its errors")
        for axes in grid[len(pairs) :]:
            axes.set_axis_off()
        legend_above(figure, grid[0])
        return png(figure)
