"""Sheets to print: shapes in mm, x right and y down."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array

NO_RECTANGLES, NO_CIRCLES = np.empty((0, 4)), np.empty((0, 3))


@dataclass(frozen=True)
class Shapes:
    """Shapes of one colour."""

    black: bool
    rectangles: Array  # (n,4) mm: x, y of the top left corner, width, height
    circles: Array  # (m,3) mm: x, y of the centre, radius


@dataclass(frozen=True)
class Artwork:
    """Layers, the first at the bottom, on a sheet of width x height mm that starts at (0, 0)."""

    width: float
    height: float
    layers: tuple[Shapes, ...]


def sheet(
    size: tuple[float, float],
    *,
    rectangles: Array = NO_RECTANGLES,
    circles: Array = NO_CIRCLES,
    inverted: bool = False,
) -> Artwork:
    """Artwork of a size (width, height) in mm with black shapes; white ones on black where inverted.

    rectangles: (n,4) mm.   circles: (m,3) mm, as in `Shapes`.
    """
    width, height = map(float, size)
    shapes = Shapes(not inverted, rectangles, circles)
    ground = Shapes(True, np.array([[0.0, 0.0, width, height]]), NO_CIRCLES)
    return Artwork(width, height, (ground, shapes) if inverted else (shapes,))


def dark_runs(dark: NDArray[np.bool_]) -> Array:
    """Rectangles (n,4), in cells, that cover the dark cells: one for each run of them in a row.

    >>> dark_runs(np.array([[True, True, False], [False, False, True]]))
    array([[0., 0., 2., 1.],
           [2., 1., 1., 1.]])
    """
    runs = []
    for row, line in enumerate(dark):
        ends = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]).astype(np.int8)))
        runs += [(start, row, last - start, 1) for start, last in ends.reshape(-1, 2)]
    return np.array(runs, dtype=np.float64).reshape(-1, 4)


def dark_squares(columns: int, rows: int, *, white_first: bool = False) -> NDArray[np.bool_]:
    """Mask (rows,columns) of the dark squares of a board; the first is dark, unless `white_first`.

    >>> dark_squares(3, 2).astype(int)
    array([[1, 0, 1],
           [0, 1, 0]])
    """
    return np.asarray((np.add.outer(np.arange(rows), np.arange(columns)) + white_first) % 2 == 0)


def shifted(rectangles: Array, x: float, y: float) -> Array:
    """The rectangles (n,4) moved by x and y, in their own unit."""
    return rectangles + np.array([x, y, 0.0, 0.0])
