"""A marker, dot or board in, what has to be printed out: shapes in mm, x right and y down."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.calibration.boards import Board, charuco, grid
from vision.camera import Array
from vision.dictionaries import dictionary_of

QUIET_CELLS = 1  # border round a marker that has to stay clear, in its cells
DOT_PAPER = 1.6  # side of the clear square round a dot, in its diameters
CIRCLE = 0.3  # radius of a circle of a board, in distances of two circles


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


def marker_artwork(marker: int, size_mm: float, dictionary: str, *, inverted: bool = False) -> Artwork:
    """A marker with its clear border; size_mm: mm, side of the square with the code.

    Raises ValueError for an id that the dictionary does not have.
    """
    words = dictionary_of(dictionary)
    if not 0 <= marker < len(words.bytesList):
        raise ValueError(
            f"marker {marker} is not in {dictionary}: it has ids 0 to {len(words.bytesList) - 1}"
        )
    cells = words.markerSize + 2
    cell = size_mm / cells
    border = QUIET_CELLS * cell
    dark = _moved(_runs(_bits(words, marker) == 0) * cell, border, border)
    side = size_mm + 2.0 * border
    return _finished(side, side, dark, np.empty((0, 3)), inverted)


def dot_artwork(diameter_mm: float, *, inverted: bool = False) -> Artwork:
    """A dot in its clear square."""
    side = DOT_PAPER * diameter_mm
    circle = np.array([[side / 2.0, side / 2.0, diameter_mm / 2.0]])
    return _finished(side, side, np.empty((0, 4)), circle, inverted)


def board_artwork(board: Board) -> Artwork:
    """A calibration board with a clear border of half a square."""
    border, square = 0.5 * board.square_mm, board.square_mm
    if board.kind in ("circles", "acircles"):
        centre = grid(board)[:, :2] + square
        width, height = centre.max(axis=0) + square
        circles = np.column_stack([centre, np.full(len(centre), CIRCLE * square)])
        return _finished(width, height, np.empty((0, 4)), circles, board.inverted)
    more = 1 if board.kind == "chessboard" else 0
    columns, rows = board.columns + more, board.rows + more
    white_first = board.legacy and board.rows % 2 == 0
    squares = (np.add.outer(np.arange(rows), np.arange(columns)) + white_first) % 2 == 0
    dark = _runs(squares) * square
    if board.kind == "charuco":
        dark = np.concatenate([dark, _board_markers(board)])
    dark = _moved(dark, border, border)
    size = (columns * square + 2.0 * border, rows * square + 2.0 * border)
    return _finished(*size, dark, np.empty((0, 3)), board.inverted)


def _board_markers(board: Board) -> Array:
    """Black rectangles (n,4) mm of the markers in the white squares of a ChArUco board."""
    printed, words = charuco(board), dictionary_of(board.dictionary)
    cell = board.marker_mm / (words.markerSize + 2)
    found = []
    for marker, corners in zip(np.asarray(printed.getIds()).ravel(), printed.getObjPoints(), strict=True):
        x, y, _ = np.asarray(corners, dtype=np.float64)[0]
        found.append(_moved(_runs(_bits(words, int(marker)) == 0) * cell, x, y))
    return np.concatenate(found)


def _bits(words: cv2.aruco.Dictionary, marker: int) -> NDArray[np.uint8]:
    cells = words.markerSize + 2
    return np.asarray(words.generateImageMarker(marker, cells), dtype=np.uint8)


def _runs(dark: NDArray[np.bool_]) -> Array:
    """Rectangles (n,4), in cells, that cover the dark cells: one for each run of them in a row."""
    found = []
    for row, line in enumerate(dark):
        ends = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]).astype(np.int8)))
        found += [(first, row, last - first, 1) for first, last in ends.reshape(-1, 2)]
    return np.array(found, dtype=np.float64).reshape(-1, 4)


def _moved(rectangles: Array, x: float, y: float) -> Array:
    return rectangles + np.array([x, y, 0.0, 0.0])


def _finished(width: float, height: float, dark: Array, circles: Array, inverted: bool) -> Artwork:
    shapes = Shapes(not inverted, dark, circles)
    ground = Shapes(True, np.array([[0.0, 0.0, width, height]]), np.empty((0, 3)))
    return Artwork(float(width), float(height), (ground, shapes) if inverted else (shapes,))
