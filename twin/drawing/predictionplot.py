"""Turns predictions into a plot: U1 and U3 of every point with their 95 % bands."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.drawing.theme import NOISE, legend_above, png, style
from twin.targets import Array

COMPONENTS = ((0, "U1"), (2, "U3"))


def draw_prediction(
    x: Array, u: Array, half: Array | None, *, names: Sequence[str], label: str, beyond: NDArray[np.bool_]
) -> bytes:
    """A PNG of displacements u (s, p, 3) mm of named points over x (s,), which `label` says.

    half (s, p, 3) mm: half of their 95 % intervals, where there are any. beyond (s,): what was not tested, on
    grey ground.
    """
    marks = "o-" if len(x) < 30 else "-"
    with style():
        figure = Figure(figsize=(7.6, 3.6), layout="constrained")
        sides = figure.subplots(1, 2)
        for axes, (i, title) in zip(sides, COMPONENTS, strict=True):
            for k, name in enumerate(names):
                (line,) = axes.plot(x, u[:, k, i], marks, label=name, markersize=3.5, linewidth=1.2)
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
