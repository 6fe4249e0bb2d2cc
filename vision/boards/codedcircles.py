"""Boards of circles with three coding dots that mark origin and axes, as measuring systems have them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from vision.artwork import Artwork
from vision.boards.board import MIN_CORNERS, NOTHING, BoardView, Print
from vision.boards.circles import CIRCLE, CircleBoard, outlined
from vision.boards.dotgrid import coding, find_dots_of_board, walk
from vision.camera import Image

_QUARTERS = ([[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, -1]], [[0, -1], [1, 0]])
TURNS = tuple(np.array(t) for t in _QUARTERS)
# A walk along a board that is tilted by more than 55 degrees may take diagonals for one of its directions.
_DIAGONAL = ([[1, 0], [0, 1]], [[1, 1], [0, 1]], [[1, -1], [0, 1]], [[1, 0], [1, 1]], [[1, 0], [-1, 1]])
SHEARS = tuple(np.array(s) for s in _DIAGONAL)
MOST_MARKED = 6  # dots that look like coding dots: more is another board
MOST_ON = 0.9  # share of the dots that must lie on the board
HOLE = 0.5  # radius of the light middle of a ring, in radii of its circle


@dataclass(frozen=True, kw_only=True)
class CodedCircleBoard(CircleBoard, kind="codedcircles"):
    """Columns x rows circles, three of them rings or larger: a part of the board that has these is enough.

    coding: (column, row) of the three, from 0 at the top left.

    Raises ValueError for coding dots that are not on the board, or look the same when the board is turned.
    """

    joins_cameras: ClassVar[bool] = True

    coding: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        marked = np.array(self.coding).reshape(-1, 2)
        inside = np.all((marked >= 0) & (marked < (self.columns, self.rows)))
        if len(marked) != 3 or not inside:
            raise ValueError(
                f"coding = {[list(dot) for dot in self.coding]}: wanted the column and row of three dots, "
                f"counted from 0, on a board of {self.columns} x {self.rows}"
            )
        if len(_placings(marked, marked)) != 1:
            raise ValueError(
                f"coding = {[list(dot) for dot in self.coding]} looks the same when the board is turned: "
                "wanted three dots at distances that tell origin and axes"
            )

    def look(self, picture: Image) -> BoardView:
        """The circles that are seen and connected to all three coding dots."""
        dots = find_dots_of_board(picture)
        rows, step = walk(dots.centre)
        if len(rows) < MIN_CORNERS:
            return NOTHING
        place = self._placed(step, coding(dots, rows))
        if place is None:
            return NOTHING
        on = self._on(place)
        points = np.column_stack([place[on], np.zeros(int(on.sum()))]) * self.square_mm
        return outlined(picture, points, dots.centre[rows[on]], self.reach * self.square_mm)

    def _placed(self, step: NDArray[np.intp], marked: NDArray[np.bool_]) -> NDArray[np.intp] | None:
        """Columns and rows (m,2) of dots with steps (m,2), None where the marked ones (m,) do not tell."""
        if not 3 <= marked.sum() <= MOST_MARKED:
            return None
        for shear in SHEARS:
            placings = _placings(step[marked] @ shear, np.array(self.coding))
            places = [step @ shear @ turn.T + shift for turn, shift in placings]
            places = [place for place in places if np.mean(self._on(place)) > MOST_ON]
            if len(places) == 1:
                return places[0]
        return None

    def _on(self, place: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Mask (m,) of the columns and rows (m,2) that are on the board."""
        return np.asarray(np.all((place >= 0) & (place < (self.columns, self.rows)), axis=1))

    def advice(self, pictures: Sequence[Image], needed: int) -> str:
        """Advice: the coding dots must be seen, and be where `coding` says."""
        return (
            ": the three coding dots (rings, or larger ones) must be in every picture, and coding must say "
            "their columns and rows, counted from 0; photograph the board sharply"
        )

    def artwork(self) -> Artwork:
        """The sheet to print, the coding dots as rings."""
        plain = super().artwork()
        (black,) = (layer for layer in plain.layers if layer.circles.size)
        row, column = np.array(self.coding)[:, 1], np.array(self.coding)[:, 0]
        holes = black.circles[row * self.columns + column] * (1.0, 1.0, HOLE)
        return replace(plain, layers=(*plain.layers, replace(black, black=not black.black, circles=holes)))

    def print_of(self, texels: float) -> Print:
        """The print with at least `texels` texels from circle to circle."""
        plain = super().print_of(texels)
        square, paper = round(plain.origin), plain.paper.copy()
        offset = np.arange(square) + 0.5 - 0.5 * square
        hole = np.clip(HOLE * CIRCLE * square - np.hypot(offset[:, None], offset) + 0.5, 0.0, 1.0)
        for column, row in self.coding:
            x, y = (round((k + 0.5) * square) for k in (column, row))
            part = paper[y : y + square, x : x + square]
            part[:] = np.maximum(part, hole)
        return plain._replace(paper=paper)


def _placings(
    marked: NDArray[np.intp], coding: NDArray[np.intp]
) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Turns (2,2) and shifts (2,) that take three of the found dots (m,2) to the wanted ones (3,2)."""
    placings = []
    for turn in TURNS:
        turned = marked @ turn.T
        for dot in turned:
            shift = coding[0] - dot
            there = {tuple(place) for place in (turned + shift).tolist()}
            if all(tuple(place) in there for place in coding.tolist()):
                placings.append((turn, shift))
    return placings
