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

from twin.drawing.theme import (
    AFTER,
    BEFORE,
    MEASURED,
    NOISE,
    beside,
    cycle,
    label_ends,
    legend_above,
    log_if_wide,
    png,
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
    with style({"axes.grid": False}):
        return svg(_residuals(time_s, maps=maps, names=names, unit=unit, components=components))


def residual_image(time_s: Array, *, maps: Mapping[str, Array], names: Sequence[str], unit: str) -> bytes:
    """The same as a PNG file."""
    with style({"axes.grid": False}):
        return png(_residuals(time_s, maps=maps, names=names, unit=unit, components=(0, 2)))


def _residuals(
    time_s: Array, *, maps: Mapping[str, Array], names: Sequence[str], unit: str, components: Sequence[int]
) -> Figure:
    shown = np.concatenate([np.abs(r[..., list(components)]).ravel() for r in maps.values()])
    shown = shown[np.isfinite(shown)]
    top = float(np.quantile(shown, 0.98)) if len(shown) else 1.0
    top = top if top > 0.0 else 1.0
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
    return figure


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


def falling(rows: Sequence[tuple[str, float]], *, noise_mm: float) -> str:
    """RMS errors in mm of models one after the other (what was done, error), and the noise at their foot.

    From each the bar shows what the next takes off. The axis is logarithmic where the errors span a lot.
    """
    with style({"axes.grid": False}):
        return svg(_falling(rows, noise_mm))


def falling_image(rows: Sequence[tuple[str, float]], *, noise_mm: float) -> bytes:
    """The same as a PNG file."""
    with style({"axes.grid": False}):
        return png(_falling(rows, noise_mm))


def _falling(rows: Sequence[tuple[str, float]], noise_mm: float) -> Figure:
    values = np.array([value for _, value in rows])
    known = np.append(values[np.isfinite(values)], noise_mm if np.isfinite(noise_mm) else [])
    figure = Figure(figsize=(4.6, 0.55 + 0.36 * (len(rows) + 1)), layout="constrained")
    axes = figure.subplots()
    foot = 0.6 * float(known[known > 0].min()) if (known > 0).any() else 0.0
    wide = len(known) > 0 and foot > 0 and known.max() > 20 * foot
    start = foot if wide else 0.0
    for row, value in enumerate(np.nan_to_num(values)):
        after = values[row + 1] if row + 1 < len(values) and np.isfinite(values[row + 1]) else value
        colour = AFTER if row and row == len(rows) - 1 else BEFORE  # the model of now
        axes.barh(row, max(min(value, after) - start, 0.0), left=start, color=colour, height=0.62)
        if value > after:
            axes.barh(row, value - after, left=after, color=colour, alpha=0.35, height=0.62)
        text = f"{values[row]:.3g} mm" if np.isfinite(values[row]) else "not known"
        beside(axes, max(value, start), row, text=text)
    axes.barh(len(rows), max(np.nan_to_num(noise_mm) - start, 0.0), left=start, color=NOISE, height=0.62)
    beside(axes, max(np.nan_to_num(noise_mm), start), len(rows), text=f"{noise_mm:.3g} mm")
    axes.axvline(max(np.nan_to_num(noise_mm), start), color=NOISE, linewidth=0.8, linestyle=":")
    axes.set_yticks(range(len(rows) + 1), [*(name for name, _ in rows), "noise"])
    _bare(axes)
    if wide:
        axes.set_xscale("log")
        axes.set_xlim(foot, known.max() * (known.max() / foot) ** 0.3)
    axes.minorticks_off()
    axes.set_xticks([])
    axes.set_title("RMS error" + (", logarithmic" if wide else ""))
    return figure


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
