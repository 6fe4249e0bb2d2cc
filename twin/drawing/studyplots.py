"""Plots of a calibration by a genetic algorithm, each an SVG text: figures 5a to 6d of the reference study.

The report uses them, too. Every curve carries an id (`gid`) in the SVG, so that a figure can be read back.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from twin.drawing.theme import (
    AFTER,
    BEFORE,
    EXTRA,
    INK,
    MEASURED,
    MUTED,
    NOISE,
    cycle,
    label_ends,
    legend_above,
    log_if_wide,
    style,
    svg,
)
from twin.targets import Array

SIZE = (4.6, 3.4)  # inches: two stand beside each other on a page
INITIAL, FINAL, EXPERIMENT = "initial model", "updated model", "experiment"
MANY = 20  # readings of a film are drawn small
COLOURS = {EXPERIMENT: MUTED, INITIAL: BEFORE, FINAL: AFTER}
MARKS = (("*", "#e69f00"), ("s", "white"), ("D", "#cc79a7"), ("^", BEFORE))  # shape and colour of models
LEGEND: dict[str, Any] = {"loc": "outside upper left", "columns": 4, "columnspacing": 1.2}
BARS = 0.26  # width of a bar, of the distance from one point to the next


def best_error(
    generation: NDArray[np.integer], *, rms_mm: Array, initial_mm: float | None = None
) -> str:
    """Figure 5a: the best RMS error (g,) mm by generation (g,), and that of the initial model."""
    with style():
        figure, axes = _one()
        if initial_mm is not None:
            axes.axhline(initial_mm, color=BEFORE, ls="--", linewidth=1.1, label=INITIAL, gid="initial")
        axes.plot(generation, rms_mm, color=AFTER, marker="o", markersize=3, label="best so far", gid="best")
        log_if_wide(axes, np.append(rms_mm, [] if initial_mm is None else initial_mm))
        if axes.get_yscale() == "linear":
            axes.set_ylim(bottom=0.0)
        _by_generation(axes, "RMS error, mm")
        legend_above(figure, axes, **LEGEND)
        return svg(figure)


def best_constants(
    generation: NDArray[np.integer], *, best: Array, names: Sequence[str], unit: str = "MPa"
) -> str:
    """Figure 5b: the best constants (g, d) in `unit` by generation (g,), of two also their sum."""
    with style():
        figure, axes = _one()
        curves, titles, colours = list(best.T), list(names), cycle(len(names))
        if len(names) == 2:
            curves, titles = [*curves, best.sum(axis=1)], [*titles, " + ".join(names)]
            colours = [*colours, MUTED]
        for curve, title, colour in zip(curves, titles, colours, strict=True):
            axes.plot(generation, curve, color=colour, marker="o", markersize=3, gid=title)
        axes.set_ylim(0.0, 1.12 * float(np.nanmax(curves)))
        label_ends(axes, generation, np.array(curves), names=titles, colours=colours)
        _by_generation(axes, f"constants of the best, {unit}")
        return svg(figure)


def valley(
    candidates: Array,
    *,
    rms_mm: Array,
    marks: Mapping[str, Array],
    names: Sequence[str],
    ridge: Array | None = None,
    unit: str = "MPa",
) -> str:
    """Figure 5c: the error rms_mm (m,) mm of all candidates (m, 2) over the two constants (NaN or inf: no
    solution), models (2,) by name, and the ridge (h, 2) of least error."""
    with style():
        figure = Figure(figsize=(SIZE[0], 3.9), layout="constrained")
        axes = figure.subplots()
        solved = np.isfinite(rms_mm)
        order = np.argsort(-rms_mm[solved])  # the best on top
        place, error = candidates[solved][order], rms_mm[solved][order]
        if not solved.all():
            axes.plot(
                *candidates[~solved].T, "x", color=NOISE, markersize=4, label="no solution", gid="unsolved"
            )
        if len(error):
            norm = LogNorm(error.min(), max(error.max(), 1.001 * error.min()))
            dots = axes.scatter(
                place[:, 0], place[:, 1], c=error, norm=norm, cmap="viridis_r", s=16, linewidths=0,
                gid="candidates",
            )  # fmt: skip
            figure.colorbar(dots, ax=axes, label="RMS error, mm").outline.set_visible(False)
        if ridge is not None:
            axes.plot(*ridge.T, color=INK, linewidth=1.0, label="ridge: least error", gid="ridge")
        for (name, (x, y)), (shape, colour) in zip(marks.items(), MARKS):
            axes.plot(
                x, y, shape, color=colour, markersize=13 if shape == "*" else 8, markeredgecolor=INK,
                markeredgewidth=0.9, label=name, linestyle="none", gid=name, clip_on=False, zorder=5,
            )  # fmt: skip
        axes.set(xlabel=f"{names[0]}, {unit}", ylabel=f"{names[1]}, {unit}")
        legend_above(figure, axes, **LEGEND | {"columns": 3})
        return svg(figure)


def against_pressure(
    pressure: Array,
    *,
    models: Mapping[str, Array],
    read_at: Array,
    read_mm: Array,
    read_sd_mm: Array | None = None,
    title: str,
    component: str = "U3",
) -> str:
    """Figures 6a, 6b: displacement of one point against pressure: one or two models (k,) mm by name at
    pressures (k,) MPa, and what was read (n,) mm at pressures (n,) MPa with its sds (n,) mm.

    Without sds the models are those of a film's steps, each a dot: a line would join the steps of a fast
    release, between which the path is not known.
    """
    with style():
        figure, axes = _one()
        if read_sd_mm is None:
            lines: tuple[str, str] = ("o", "o")
            axes.plot(1e3 * read_at, read_mm, "o", color=MEASURED, markersize=4.5, label="measured")
        else:
            lines = ("--", "-")
            axes.errorbar(
                1e3 * read_at, read_mm, yerr=1.96 * read_sd_mm, fmt="o", color=INK, capsize=3, elinewidth=0.9,
                markersize=4.5 if len(read_at) < MANY else 2, label=f"{EXPERIMENT}, 95 %", zorder=4,
            )[0].set_gid("experiment")  # fmt: skip
        for (name, u), colour, gid, line in zip(models.items(), (BEFORE, AFTER), ("initial", "final"), lines):
            axes.plot(1e3 * pressure, u, line, color=colour, label=name, gid=gid, markersize=1.4)
        axes.set(xlabel="pressure, kPa", ylabel=f"{component}, mm")
        axes.set_title(title)
        axes.margins(x=0.03)
        legend_above(figure, axes, **LEGEND)
        return svg(figure)


def end_values(
    points: Sequence[str], rows: Mapping[str, Array], *, component: str = "U3", sd_mm: float | None = None
) -> str:
    """Figures 6c, 6d: displacements (p,) mm at the top pressure, of EXPERIMENT, INITIAL and FINAL.

    With the sd of a reading in mm the rows are absolute errors of INITIAL and FINAL, and a line shows the sd.
    """
    with style():
        figure, axes = _one()
        _bars(axes, points, rows, digits=1 if sd_mm is None else 2)
        if sd_mm is None:
            axes.axhline(0.0, color=MUTED, linewidth=0.8)
            axes.set_ylabel(f"{component}, mm")
        else:
            axes.axhline(sd_mm, color=EXTRA, linewidth=1.1, linestyle=":",
                         label="error of a reading, 1 sd", gid="reading")  # fmt: skip
            axes.set_ylabel(f"absolute error of {component}, mm")
            axes.set_ylim(0.0, 1.12 * max(sd_mm, *(float(v.max()) for v in rows.values())))
        legend_above(figure, axes, **LEGEND)
        return svg(figure)


def _one() -> tuple[Figure, Axes]:
    figure = Figure(figsize=SIZE, layout="constrained")
    return figure, figure.subplots()


def _by_generation(axes: Axes, label: str) -> None:
    axes.set(xlabel="generation", ylabel=label)
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))


def _bars(axes: Axes, points: Sequence[str], rows: Mapping[str, Array], *, digits: int) -> None:
    """Groups of bars, one a point, with their values at the ends."""
    ticks = np.arange(len(points))
    for k, (name, values) in enumerate(rows.items()):
        x = ticks + (k - (len(rows) - 1) / 2) * (BARS + 0.02)
        bars: Any = axes.bar(x, values, width=BARS, color=COLOURS[name], label=name)
        for bar, point in zip(bars, points, strict=True):
            bar.set_gid(f"{name}: {point}")
        axes.bar_label(bars, [f"{v:.{digits}f}" for v in values], padding=2, fontsize=8)
    axes.set_xticks(ticks, points)
    axes.tick_params(axis="x", length=0)
    axes.grid(False, axis="x")
    axes.margins(y=0.1)
