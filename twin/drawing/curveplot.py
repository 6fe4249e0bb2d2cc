"""Tests of the silicone become a picture: nominal stress against strain, measured with errors and fitted."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from twin.drawing.theme import AFTER, MEASURED, legend_above, png, style
from twin.judging.record import MaterialTestRow

COLUMNS = 3


def draw_curves(tests: Sequence[MaterialTestRow]) -> bytes:
    """A PNG with a panel for each test: measured values with 1 sd, and the law that was fitted."""
    columns = min(COLUMNS, len(tests))
    rows = math.ceil(len(tests) / columns)
    with style():
        figure = Figure(figsize=(max(2.8 * columns + 0.4, 4.8), 2.4 * rows + 0.4), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, test in zip(panels, tests, strict=False):
            strain, order = 100 * np.array(test.strain), np.argsort(test.strain)
            axes.errorbar(strain, test.stress_MPa, yerr=test.sd_MPa, fmt="o", color=MEASURED, markersize=3.0,
                          linewidth=0.8, label="measured, 1 sd")  # fmt: skip
            axes.plot(strain[order], np.array(test.fitted_MPa)[order], color=AFTER, label="law of the fit")
            axes.set_title(f"{test.name} ({test.kind})")
            axes.set_xlabel("amount of shear, %" if test.kind == "shear" else "nominal strain, %")
        for axes in panels[len(tests) :]:
            axes.set_axis_off()
        for axes in panels[::columns]:
            axes.set_ylabel("nominal stress, MPa")
        legend_above(figure, panels[0])
        return png(figure)
