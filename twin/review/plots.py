"""Turns arrays into plots, each an SVG text: white ground, colours that survive colour blindness, units.

NaN is a gap everywhere. The text of a picture depends on its data alone (no date, no random ids).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from twin.review.styling import (
    AFTER,
    BEFORE,
    MEASURED,
    NOISE,
    beside,
    cycle,
    label_ends,
    legend_above,
    log_if_wide,
    style,
    svg,
)
from twin.targets import Array

AXES_NAMES = ("U1", "U2", "U3")
MODELS = ("model before", "model after")  # what the two models of a picture are called, unless told


def displacements(
    time_s: Array,
    *,
    measured: Array,
    before: Array | None = None,
    after: Array | None = None,
    names: Sequence[str],
    labels: tuple[str, str] = MODELS,
    components: Sequence[int] = (0, 2),
) -> str:
    """Displacement against film time, a row per marker: measured, model before, model after.

    time_s (s,) s; measured, before, after (s,p,3) mm; names (p,); labels of the two models; components
    shown, 0 to 2.
    """
    with style():
        figure = Figure(figsize=(7.6, 0.55 + 0.95 * len(names)), layout="constrained")
        rows = figure.subplots(len(names), len(components), sharex=True, squeeze=False)
        for p, name in enumerate(names):
            for column, i in enumerate(components):
                axes = rows[p, column]
                axes.plot(time_s, measured[:, p, i], color=MEASURED, linewidth=3.2, label="measured")
                if before is not None:
                    axes.plot(
                        time_s, before[:, p, i], "--", color=BEFORE, label=labels[0], linewidth=1.1
                    )
                if after is not None:
                    axes.plot(time_s, after[:, p, i], color=AFTER, label=labels[1], linewidth=1.0)
                axes.yaxis.set_major_locator(MaxNLocator(3))
                axes.margins(x=0.01)
            rows[p, 0].set_ylabel(name, rotation=0, ha="right", va="center")
        for column, i in enumerate(components):
            rows[0, column].set_title(f"{AXES_NAMES[i]}, mm")
            rows[-1, column].set_xlabel("film time, s")
        figure.align_ylabels(rows[:, 0])
        legend_above(figure, rows[0, 0])
        return svg(figure)


def residual_map(
    time_s: Array,
    *,
    maps: Mapping[str, Array],
    names: Sequence[str],
    unit: str = "sd",
    components: Sequence[int] = (0, 2),
) -> str:
    """Measured minus model, markers against film time, a row per component and a column per map.

    time_s (s,) s; maps {title: residual (s,p,3)} in `unit`; names (p,). The colours end at the 98th
    percentile of all sizes. Grey: not observed.
    """
    shown = np.concatenate([np.abs(r[..., list(components)]).ravel() for r in maps.values()])
    shown = shown[np.isfinite(shown)]
    top = float(np.quantile(shown, 0.98)) if len(shown) else 1.0
    top = top if top > 0.0 else 1.0
    with style({"axes.grid": False}):
        height = 0.7 + len(components) * (0.25 + 0.2 * len(names))
        figure = Figure(figsize=(7.6, height), layout="constrained")
        grid = figure.subplots(len(components), len(maps), sharex=True, sharey=True, squeeze=False)
        for column, (title, residual) in enumerate(maps.items()):
            for row, i in enumerate(components):
                axes = grid[row, column]
                image = _heat(axes, time_s, residual[..., i].T, top=top)
                axes.set_title(f"{title}: {AXES_NAMES[i]}")
                axes.set_yticks(range(len(names)), names)
                axes.tick_params(length=0)
            grid[-1, column].set_xlabel("film time, s")
        bar = figure.colorbar(image, ax=grid, pad=0.01, aspect=30, extend="both", ticks=[-top, 0.0, top])
        bar.set_ticklabels([f"{-top:.3g}", "0", f"{top:.3g}"])
        bar.set_label(f"measured - model, {unit}")
        bar.outline.set_visible(False)
        return svg(figure)


def generations(
    generation: NDArray[np.integer], *, rms_mm: Array, best: Array, names: Sequence[str], unit: str = "MPa"
) -> str:
    """Best RMS error and, below it, its parameters over the generations of the genetic algorithm.

    generation (g,); rms_mm (g,) mm; best (g,d) parameters in `unit`; names (d,).
    """
    with style():
        figure = Figure(figsize=(4.6, 3.6), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        above.plot(generation, rms_mm, color=AFTER, marker="o", markersize=3)
        above.set_title("best RMS error, mm")
        log_if_wide(above, rms_mm)
        for value, colour in zip(best.T, cycle(len(names))):
            below.plot(generation, value, color=colour, marker="o", markersize=3)
        label_ends(below, generation, best.T, names=names, colours=cycle(len(names)))
        below.set_title(f"parameters of the best, {unit}")
        below.set_xlabel("generation")
        below.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        return svg(figure)


def landscape(
    candidates: Array,
    *,
    rms_mm: Array,
    names: Sequence[str],
    unit: str = "MPa",
    best: Array | None = None,
) -> str:
    """Error of all candidates over two parameters.

    candidates (m,2) in `unit`; rms_mm (m,) mm, NaN = no solution; best (2,).
    """
    with style():
        figure = Figure(figsize=(4.6, 3.6), layout="constrained")
        axes = figure.subplots()
        solved = np.isfinite(rms_mm) & (rms_mm > 0)
        order = np.argsort(-rms_mm[solved])  # the best on top
        place, error = candidates[solved][order], rms_mm[solved][order]
        failed = candidates[~np.isfinite(rms_mm)]
        axes.plot(failed[:, 0], failed[:, 1], "x", color=NOISE, markersize=4, label="no solution")
        if len(place):
            norm = LogNorm(error.min(), max(error.max(), 1.001 * error.min()))
            dots = axes.scatter(
                place[:, 0], place[:, 1], c=error, norm=norm, cmap="viridis_r", s=16, linewidths=0
            )
            figure.colorbar(dots, ax=axes, label="RMS error, mm").outline.set_visible(False)
        if best is not None:
            axes.plot(*best, "*", color=BEFORE, markersize=11, markeredgecolor="white", label="best")
        axes.set(xlabel=f"{names[0]}, {unit}", ylabel=f"{names[1]}, {unit}")
        legend_above(figure, axes)
        return svg(figure)


def pressure_curves(
    pressure: Array,
    *,
    measured: Array,
    before: Array | None = None,
    after: Array | None = None,
    names: Sequence[str],
    labels: tuple[str, str] = MODELS,
    component: str = "U3",
) -> str:
    """Displacement against pressure, a panel per marker: measured, model before, model after.

    pressure (s,) MPa; measured, before, after (s,p) mm; names (p,); labels of the two models. Every step is a
    dot: a line would join the steps of a fast release, between which the path is not known.
    """
    with style():
        figure = Figure(figsize=(7.6, 2.8), layout="constrained")
        panels = figure.subplots(1, len(names), squeeze=False)[0]
        kilopascal = 1e3 * pressure
        for p, (axes, name) in enumerate(zip(panels, names)):
            axes.plot(kilopascal, measured[:, p], "o", color=MEASURED, markersize=4.5, label="measured")
            for model, colour, label in ((before, BEFORE, labels[0]), (after, AFTER, labels[1])):
                if model is not None:
                    axes.plot(kilopascal, model[:, p], "o", color=colour, markersize=1.4, label=label)
            axes.set(title=f"{name}: {component}, mm", xlabel="pressure, kPa")
        legend_above(figure, panels[0])
        return svg(figure)


def error_bars(
    before_mm: float, *, after_mm: float | None, noise_mm: float, labels: tuple[str, str] = MODELS
) -> str:
    """RMS error of the models before and after an effect was added, beside the noise; all in mm."""
    rows = [(labels[0], before_mm, BEFORE)]
    if after_mm is not None:
        rows.append((labels[1], after_mm, AFTER))
    rows.append(("noise", noise_mm, NOISE))
    with style({"axes.grid": False}):
        figure = Figure(figsize=(4.6, 0.5 + 0.38 * len(rows)), layout="constrained")
        axes = figure.subplots()
        values = np.array([value for _, value, _ in rows])
        axes.barh(range(len(rows)), np.nan_to_num(values), color=[colour for *_, colour in rows], height=0.62)
        for row, value in enumerate(values):
            beside(axes, value, row, text=f"{value:.3g} mm" if np.isfinite(value) else "not known")
        axes.axvline(np.nan_to_num(noise_mm), color=NOISE, linewidth=0.8, linestyle=":")
        axes.set_yticks(range(len(rows)), [name for name, *_ in rows])
        _bare(axes)
        axes.set_title("RMS error")
        return svg(figure)


def _heat(axes: Axes, time_s: Array, values: Array, *, top: float) -> Any:
    """Draw values (p,s) as a picture inside the SVG: thousands of cells as shapes would be megabytes."""
    axes.set_facecolor("#c4c9cf")
    edges = _edges(time_s)
    return axes.pcolormesh(
        edges,
        np.arange(len(values) + 1) - 0.5,
        np.ma.masked_invalid(values),
        cmap="RdBu_r",
        vmin=-top,
        vmax=top,
        rasterized=True,
    )


def _edges(time_s: Array) -> Array:
    """Edges (s+1,) halfway between times (s,)."""
    if len(time_s) == 1:
        return time_s[0] + np.array([-0.5, 0.5])
    middle = 0.5 * (time_s[1:] + time_s[:-1])
    return np.concatenate([[2 * time_s[0] - middle[0]], middle, [2 * time_s[-1] - middle[-1]]])


def _bare(axes: Axes) -> None:
    """Bars with their numbers beside them need no axis."""
    axes.invert_yaxis()
    axes.set_xticks([])
    axes.margins(x=0.2)
    axes.tick_params(axis="y", length=0)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
