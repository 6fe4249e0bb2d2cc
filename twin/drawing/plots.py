"""Plots of displacements, residuals and errors, each an SVG text, readable with every colour vision.

NaN is a gap everywhere. The text of a picture depends on its data alone (no date, no random ids).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from twin.drawing.theme import (
    AFTER,
    BEFORE,
    MEASURED,
    NOISE,
    beside,
    both,
    legend_above,
    style,
    svg,
)
from twin.targets import Array

AXES_NAMES = ("U1", "U2", "U3")
SEEN = [0, 2]  # components that one camera sees


def displacements(
    time_s: Array,
    *,
    measured: Array,
    models: Mapping[str, Array],
    names: Sequence[str],
    components: Sequence[int] = (0, 2),
) -> str:
    """Displacement against film time, a row per marker: measured, and up to two models by name.

    time_s (s,) s; measured, models (s,p,3) mm; names (p,); components shown, 0 to 2.
    """
    with style():
        figure = Figure(figsize=(7.6, 0.55 + 0.95 * len(names)), layout="constrained")
        rows = figure.subplots(len(names), len(components), sharex=True, squeeze=False)
        for p, name in enumerate(names):
            for column, i in enumerate(components):
                axes = rows[p, column]
                axes.plot(time_s, measured[:, p, i], color=MEASURED, linewidth=3.2, label="measured")
                for (label, u), colour, line in zip(models.items(), (BEFORE, AFTER), ("--", "-")):
                    axes.plot(time_s, u[:, p, i], line, color=colour, label=label, linewidth=1.0)
                axes.yaxis.set_major_locator(MaxNLocator(3))
                axes.margins(x=0.01)
            rows[p, 0].set_ylabel(name, rotation=0, ha="right", va="center")
        for column, i in enumerate(components):
            rows[0, column].set_title(f"{AXES_NAMES[i]}, mm")
            rows[-1, column].set_xlabel("film time, s")
        figure.align_ylabels(rows[:, 0])
        legend_above(figure, rows[0, 0])
        return svg(figure)


def residual_pictures(
    time_s: Array, *, maps: Mapping[str, Array], names: Sequence[str], unit: str
) -> tuple[str, bytes]:
    """Measured minus model, markers against film time, a row per component and a column per map: SVG and PNG.

    time_s (s,) s; maps {title: residual (s,p,3)} in `unit`; names (p,). The colours end at the 98th
    percentile of all sizes. Grey: not observed.
    """
    with style({"axes.grid": False}):
        return both(_residuals(time_s, maps=maps, names=names, unit=unit))


def _residuals(
    time_s: Array, *, maps: Mapping[str, Array], names: Sequence[str], unit: str
) -> Figure:
    sizes = np.concatenate([np.abs(r[..., SEEN]).ravel() for r in maps.values()])
    sizes = sizes[np.isfinite(sizes)]
    top = (float(np.quantile(sizes, 0.98)) if len(sizes) else 0.0) or 1.0
    height = 0.7 + len(SEEN) * (0.25 + 0.2 * len(names))
    figure = Figure(figsize=(7.6, height), layout="constrained")
    grid = figure.subplots(len(SEEN), len(maps), sharex=True, sharey=True, squeeze=False)
    for column, (title, residual) in enumerate(maps.items()):
        for row, i in enumerate(SEEN):
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


Fall = Sequence[tuple[str, float]]


def falling(rows: Fall, *, expected_mm: float) -> str:
    """RMS errors in mm of models one after the other (what was done, error), and that of a right model at
    their foot.

    From each the bar shows what the next takes off. The axis is logarithmic where the errors span a lot.
    """
    with style({"axes.grid": False}):
        return svg(_falling(rows, expected_mm))


def falling_pictures(rows: Fall, *, expected_mm: float) -> tuple[str, bytes]:
    """The same, and as a PNG file."""
    with style({"axes.grid": False}):
        return both(_falling(rows, expected_mm))


def _falling(rows: Fall, expected_mm: float) -> Figure:
    values = np.array([row[1] for row in rows])
    sizes = np.array([*values, expected_mm])
    sizes = sizes[np.isfinite(sizes)]
    figure = Figure(figsize=(4.6, 0.55 + 0.36 * (len(rows) + 1)), layout="constrained")
    axes = figure.subplots()
    least = 0.6 * float(sizes[sizes > 0].min()) if (sizes > 0).any() else 0.0
    wide = len(sizes) > 0 and least > 0 and sizes.max() > 20 * least
    start = least if wide else 0.0
    for row, value in enumerate(np.nan_to_num(values)):
        after = values[row + 1] if row + 1 < len(values) and np.isfinite(values[row + 1]) else value
        colour = AFTER if row and row == len(rows) - 1 else BEFORE  # the model of now
        axes.barh(row, max(min(value, after) - start, 0.0), left=start, color=colour, height=0.62)
        if value > after:
            axes.barh(row, value - after, left=after, color=colour, alpha=0.35, height=0.62)
        text = f"{values[row]:.3g} mm" if np.isfinite(values[row]) else "not known"
        beside(axes, max(value, start), row, text=text)
    foot = max(np.nan_to_num(expected_mm), start)
    axes.barh(len(rows), foot - start, left=start, color=NOISE, height=0.62)
    beside(axes, foot, len(rows), text=f"{expected_mm:.3g} mm")
    axes.axvline(foot, color=NOISE, linewidth=0.8, linestyle=":")
    axes.set_yticks(range(len(rows) + 1), [*(name for name, *_ in rows), "a right model"])
    _bare(axes)
    if wide:
        axes.set_xscale("log")
        axes.set_xlim(least, sizes.max() * (sizes.max() / least) ** 0.3)
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
