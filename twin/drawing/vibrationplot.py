"""Turns natural vibrations into a picture: a row a pressure, a panel a vibration."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from fe.element import Integers
from twin.drawing.theme import AFTER, BEFORE, FAINT, png, style
from twin.targets import Array

SWING = 0.12  # of the finger's length, by which the largest motion is drawn


@dataclass(frozen=True)
class ShapePanel:
    """One vibration to draw: places (n, 3) mm about which it moves, its shape (n, 3), largest 1, the
    triangles (t, 3) of the surface, the two axes that are seen, and what is written over it."""

    places: Array
    shape: Array
    triangles: Integers
    seen: tuple[int, int]
    title: str


def draw_vibrations(rows: Sequence[Sequence[ShapePanel]]) -> bytes:
    """A PNG of vibrations, a row a pressure: the finger at rest and at both ends of its motion, which is
    drawn large."""
    columns = max(len(row) for row in rows)
    with style({"axes.grid": False}):
        figure = Figure(figsize=(3.0 * columns, 2.3 * len(rows)), layout="constrained")
        grid = figure.subplots(len(rows), columns, squeeze=False)
        for axes in grid.ravel():
            axes.set_axis_off()
        for row, panels in zip(grid, rows, strict=True):
            for axes, panel in zip(row, panels, strict=False):
                _drawn(axes, panel)
        return png(figure)


def _drawn(axes: Axes, panel: ShapePanel) -> None:
    swing = SWING * float(np.ptp(panel.places[:, 0])) * panel.shape
    ends = []
    for moved, colour, alpha in ((0 * swing, FAINT, 1.0), (-swing, AFTER, 0.25), (swing, BEFORE, 0.35)):
        place = (panel.places + moved)[:, list(panel.seen)]
        skin = list(place[panel.triangles])
        axes.add_collection(PolyCollection(skin, facecolor=colour, edgecolor="none", alpha=alpha))
        ends.append(place)
    low, high = np.concatenate(ends).min(axis=0), np.concatenate(ends).max(axis=0)
    axes.set(xlim=(low[0] - 2, high[0] + 2), ylim=(low[1] - 2, high[1] + 2), aspect="equal")
    axes.set_title(panel.title, fontsize=8)
