"""Turns what a calibration has found into the seven figures of the reference study, each an SVG text: 5a to
5c of the search, 6a to 6d of the models before and after.

Every curve carries an id (`gid`) in the SVG, so that a figure can be read back.
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
    MUTED,
    NOISE,
    cycle,
    label_ends,
    log_if_wide,
    style,
    svg,
)
from twin.targets import Array

SIZE = (4.6, 3.4)  # inches: two stand beside each other on a page
INITIAL, FINAL, MEASURED = "initial model", "updated model", "experiment"
MANY = 20  # readings of a film are drawn small
BARS = 0.26  # width of a bar, of the distance from one point to the next


def best_error(generation: NDArray[np.integer], *, rms_mm: Array, initial_mm: float) -> str:
    """Figure 5a: the best RMS error (g,) mm by generation (g,), and that of the initial model."""
    with style():
        figure, axes = _one()
        axes.axhline(initial_mm, color=BEFORE, linestyle="--", linewidth=1.1, label=INITIAL, gid="initial")
        axes.plot(generation, rms_mm, color=AFTER, marker="o", markersize=3, label="best so far", gid="best")
        log_if_wide(axes, np.append(rms_mm, initial_mm))
        if axes.get_yscale() == "linear":
            axes.set_ylim(bottom=0.0)
        _by_generation(axes, "RMS error, mm")
        _legend(figure, axes)
        return svg(figure)


def best_constants(
    generation: NDArray[np.integer], *, best: Array, names: Sequence[str], unit: str = "MPa"
) -> str:
    """Figure 5b: the best constants (g, 2) in `unit` by generation (g,), and their sum."""
    with style():
        figure, axes = _one()
        curves = [*best.T, best.sum(axis=1)]
        titles, colours = [*names, f"{names[0]} + {names[1]}"], [*cycle(2), MUTED]
        for curve, title, colour in zip(curves, titles, colours, strict=True):
            axes.plot(generation, curve, color=colour, marker="o", markersize=3, gid=title)
        axes.set_ylim(0.0, 1.12 * max(float(c.max()) for c in curves))
        label_ends(axes, generation, np.array(curves), names=titles, colours=colours)
        _by_generation(axes, f"constants of the best, {unit}")
        return svg(figure)


def valley(
    candidates: Array,
    *,
    rms_mm: Array,
    ridge: Array,
    marks: Mapping[str, Array],
    names: Sequence[str],
    unit: str = "MPa",
) -> str:
    """Figure 5c: the error rms_mm (m,) mm of all candidates (m, 2) over the two constants (NaN or inf: no
    solution), the ridge (h, 2) of least error, and models by name."""
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
        norm = LogNorm(error.min(), max(error.max(), 1.001 * error.min()))
        dots = axes.scatter(
            place[:, 0],
            place[:, 1],
            c=error,
            norm=norm,
            cmap="viridis_r",
            s=16,
            linewidths=0,
            gid="candidates",
        )
        figure.colorbar(dots, ax=axes, label="RMS error, mm").outline.set_visible(False)
        axes.plot(*ridge.T, color=INK, linewidth=1.0, label="ridge: least error", gid="ridge")
        for (name, at), (shape, colour) in zip(marks.items(), _shapes(len(marks))):
            axes.plot(
                *at, shape, color=colour, markersize=13 if shape == "*" else 8, markeredgecolor=INK,
                markeredgewidth=0.9, label=name, linestyle="none", gid=name, clip_on=False, zorder=5,
            )  # fmt: skip
        axes.set(xlabel=f"{names[0]}, {unit}", ylabel=f"{names[1]}, {unit}")
        _legend(figure, axes, columns=3)
        return svg(figure)


def against_pressure(
    pressure: Array,
    *,
    initial_mm: Array,
    final_mm: Array,
    read_at: Array,
    read_mm: Array,
    read_sd_mm: Array,
    title: str,
    component: str = "U3",
) -> str:
    """Figures 6a, 6b: displacement of one point against pressure: models (k,) mm at pressures (k,) MPa, and
    what was read (n,) mm at pressures (n,) MPa with its sds (n,) mm."""
    with style():
        figure, axes = _one()
        axes.plot(1e3 * pressure, initial_mm, "--", color=BEFORE, label=INITIAL, gid="initial")
        axes.plot(1e3 * pressure, final_mm, color=AFTER, label=FINAL, gid="final")
        axes.errorbar(
            1e3 * read_at, read_mm, yerr=1.96 * read_sd_mm, fmt="o", color=INK, capsize=3, elinewidth=0.9,
            markersize=4.5 if len(read_at) < MANY else 2, label=f"{MEASURED}, 95 %", zorder=4,
        )[0].set_gid("experiment")  # fmt: skip
        axes.set(xlabel="pressure, kPa", ylabel=f"{component}, mm")
        axes.set_title(title)
        axes.margins(x=0.03)
        _legend(figure, axes)
        return svg(figure)


def end_values(
    points: Sequence[str], *, measured: Array, initial: Array, final: Array, component: str = "U3"
) -> str:
    """Figure 6c: displacements (p,) mm at the top pressure: experiment, initial and updated model."""
    with style():
        figure, axes = _one()
        rows = {MEASURED: (measured, MUTED), INITIAL: (initial, BEFORE), FINAL: (final, AFTER)}
        _bars(axes, points, rows, digits=1)
        axes.axhline(0.0, color=MUTED, linewidth=0.8)
        axes.set_ylabel(f"{component}, mm")
        _legend(figure, axes)
        return svg(figure)


def end_errors(
    points: Sequence[str], *, initial: Array, final: Array, sd_mm: float, component: str = "U3"
) -> str:
    """Figure 6d: absolute errors (p,) mm at the top pressure before and after, and the sd of a reading."""
    with style():
        figure, axes = _one()
        _bars(axes, points, {INITIAL: (initial, BEFORE), FINAL: (final, AFTER)}, digits=2)
        axes.axhline(
            sd_mm, color=EXTRA, linewidth=1.1, linestyle=":", label="error of a reading, 1 sd", gid="reading"
        )
        axes.set_ylabel(f"absolute error of {component}, mm")
        axes.set_ylim(0.0, 1.12 * max(float(initial.max()), float(final.max()), sd_mm))
        _legend(figure, axes)
        return svg(figure)


def _one() -> tuple[Figure, Axes]:
    figure = Figure(figsize=SIZE, layout="constrained")
    return figure, figure.subplots()


def _by_generation(axes: Axes, label: str) -> None:
    axes.set(xlabel="generation", ylabel=label)
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))


def _shapes(count: int) -> list[tuple[str, str]]:
    """Markers and colours of that many models."""
    known = [("*", "#e69f00"), ("s", "white"), ("D", "#cc79a7"), ("^", BEFORE)]
    return [known[k % len(known)] for k in range(count)]


def _bars(axes: Axes, points: Sequence[str], rows: Mapping[str, tuple[Array, str]], *, digits: int) -> None:
    """Groups of bars, one a point, with their values at the ends."""
    at = np.arange(len(points))
    for k, (name, (values, colour)) in enumerate(rows.items()):
        place = at + (k - (len(rows) - 1) / 2) * (BARS + 0.02)
        drawn: Any = axes.bar(place, values, width=BARS, color=colour, label=name)
        for bar, point in zip(drawn, points, strict=True):
            bar.set_gid(f"{name}: {point}")
        axes.bar_label(drawn, [f"{v:.{digits}f}" for v in values], padding=2, fontsize=8)
    axes.set_xticks(at, points)
    axes.tick_params(axis="x", length=0)
    axes.grid(False, axis="x")
    axes.margins(y=0.1)


def _legend(figure: Figure, axes: Axes, *, columns: int = 4) -> None:
    """Name the curves above them, without a frame."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside upper left",
        ncols=min(columns, len(labels)),
        fontsize=8.5,
        columnspacing=1.2,
    )
