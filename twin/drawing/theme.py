"""The look that all plots share: colours, letters, and the way from a figure to an SVG text."""

import io
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.targets import Array

# Okabe and Ito, https://jfly.uni-koeln.de/color/ : distinct with every kind of colour vision.
INK, MUTED, FAINT, MEASURED = "#1d2733", "#66717f", "#d5dae0", "#aab2bc"
BEFORE, AFTER, NOISE, EXTRA = "#d55e00", "#0072b2", "#8a94a0", "#009e73"
STYLE: dict[str, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "softtwin",
    "figure.facecolor": "white",
    "font.size": 9.0,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.4,
    "path.simplify_threshold": 0.4,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
}
COLUMNS = 3  # panels in a row
LINE = 0.15  # of the height of a plot is what a line of text needs in the smallest of them
FONTS = "system-ui, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, 'DejaVu Sans', sans-serif"


@contextmanager
def style(more: Mapping[str, Any] | None = None) -> Iterator[None]:
    """The look of all plots, and silence about underflow: a pixel that rounds to 0 is right."""
    look: Any = {**STYLE, **(more or {})}
    with matplotlib.rc_context(look), np.errstate(under="ignore"):
        yield


def svg(figure: Figure) -> str:
    """The figure as an <svg> element that can stand in a page: no prolog, no date, the page's own fonts."""
    buffer = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(buffer, format="svg", metadata=nothing)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<style type=\"text/css\">.*?</style>", "", text, flags=re.DOTALL)
    return text.replace("'DejaVu Sans'", FONTS).strip()


def png(figure: Figure) -> bytes:
    """The figure as a PNG file, sharp on a screen of twice the usual density."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():  # a name may hold letters that the font does not have: boxes stand there
        warnings.filterwarnings("ignore", message="Glyph .* missing")
        figure.savefig(buffer, format="png", dpi=200, metadata={"Software": None})
    return buffer.getvalue()


def both(figure: Figure) -> tuple[str, bytes]:
    """`svg` and `png` of a figure, which is laid out once."""
    text = svg(figure)
    figure.set_layout_engine("none")
    return text, png(figure)


def panels(
    count: int, *, size: tuple[float, float], border: tuple[float, float], least: float, sharey: bool = False
) -> tuple[Figure, list[Axes], list[Axes]]:
    """Figure with a grid of `count` panels, at most COLUMNS in a row, and the first panel of every row.

    size, border: width and height in inches of a panel and around all; least: smallest width of the figure.
    """
    columns = min(COLUMNS, count)
    rows = -(-count // columns)
    width, height = max(size[0] * columns + border[0], least), size[1] * rows + border[1]
    figure = Figure(figsize=(width, height), layout="constrained")
    grid = list(figure.subplots(rows, columns, sharey=sharey, squeeze=False).ravel())
    for axes in grid[count:]:
        axes.set_axis_off()
    return figure, grid[:count], grid[::columns]


def legend_above(
    figure: Figure, axes: Axes, *, loc: Any = "outside upper right", columns: int = 99, **style: Any
) -> None:
    """Name the curves of all panels once, above them, `columns` beside each other at most."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc=loc, ncols=min(columns, len(labels)), fontsize=8.5, **style)


def label_ends(
    axes: Axes, x: NDArray[Any], curves: Array, *, names: Sequence[str], colours: Sequence[str]
) -> None:
    """Write each curve's name beside its last point, names of neighbours apart; curves (c, k) over x (k,)."""
    finite = [np.flatnonzero(np.isfinite(y)) for y in curves]
    ends = [(float(y[k[-1]]), n) for n, (y, k) in enumerate(zip(curves, finite, strict=True)) if len(k)]
    line = LINE * float(np.ptp(axes.get_ylim()))
    height = -np.inf
    for y, n in sorted(ends):
        height = max(y, height + line)
        place = (float(x[finite[n][-1]]), height)
        axes.annotate(
            names[n], place, xytext=(5, 0), textcoords="offset points", color=colours[n], va="center",
            annotation_clip=False,
        )  # fmt: skip


def log_if_wide(axes: Axes, values: Array) -> None:
    """A logarithmic axis where positive values span more than a factor of 30."""
    finite = values[np.isfinite(values)]
    if len(finite) and finite.min() > 0 and finite.max() > 30 * finite.min():
        axes.set_yscale("log")


def beside(axes: Axes, value: float, row: float, *, text: str) -> None:
    """Write text just right of the end of a bar; where there is no bar, at its foot."""
    end = max(value, 0.0) if np.isfinite(value) else 0.0
    axes.annotate(text, (end, row), xytext=(4, 0), textcoords="offset points", va="center")


def cycle(count: int) -> list[str]:
    """Colours for that many curves."""
    palette = (AFTER, BEFORE, EXTRA, "#cc79a7", "#e69f00", "#56b4e9")
    return [palette[i % len(palette)] for i in range(count)]
