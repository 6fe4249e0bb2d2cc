"""A chessboard, counted by its inner corners."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from vision.artwork import Artwork, dark_runs, dark_squares, sheet, shifted
from vision.boards.board import NOTHING, Board, BoardView, Print, Reading
from vision.boards.corners import WINDOW, refined, shrunk
from vision.camera import Image
from vision.dictionaries import other_dictionary

MARKERS = 4  # in a picture: a chessboard's squares are read as one now and then


@dataclass(frozen=True, kw_only=True)
class Chessboard(Board, kind="chessboard"):
    """Columns x rows inner corners."""

    def look(self, picture: Image) -> BoardView:
        """All corners, by OpenCV's classic finder, and its sector-based one where that fails."""
        size = (self.columns, self.rows)
        small, factor = shrunk(picture)
        seen, corners = cv2.findChessboardCorners(small, size)
        if not seen:
            seen, corners = cv2.findChessboardCornersSB(small, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not seen:
            return NOTHING
        pixels = (np.asarray(corners, dtype=np.float64).reshape(-1, 2) + 0.5) * factor - 0.5
        return refined(picture, self.points, pixels, WINDOW * self.square_mm)

    def doubt(self, pictures: Sequence[Image]) -> str:
        """Evidence for markers in its squares, as the end of a sentence."""
        few = pictures[:2]
        markers = other_dictionary(few, "")
        if markers is None or markers[1] < MARKERS * len(few):
            return ""
        return f"; {markers[0]} finds {markers[1]} markers in the first {len(few)}: is the kind charuco?"

    def artwork(self) -> Artwork:
        """The sheet to print, with a clear border of half a square."""
        border, square = 0.5 * self.square_mm, self.square_mm
        columns, rows = self.columns + 1, self.rows + 1
        dark = dark_runs(dark_squares(columns, rows)) * square
        size = (columns * square + 2.0 * border, rows * square + 2.0 * border)
        return sheet(size, rectangles=shifted(dark, border, border), inverted=self.inverted)

    def print_of(self, texels: float) -> Print:
        """The print with at least `texels` texels a square; (0, 0) is an inner corner."""
        square = 2 * int(np.ceil(0.5 * texels))  # halves are whole texels
        white = ~dark_squares(self.columns + 1, self.rows + 1)
        paper = np.kron(white, np.ones((square, square)))
        return Print(np.pad(paper, square, constant_values=1.0), 2.0 * square, square / self.square_mm)

    def other_readings(self) -> list[Reading]:
        """Counted by its squares in place of its inner corners."""
        columns, rows = self.columns - 1, self.rows - 1
        text = (
            f"columns = {self.columns}, rows = {self.rows} were read as squares. A chessboard is counted by "
            f"its inner corners: write columns = {columns}, rows = {rows}."
        )
        fewer = min(self.columns, self.rows) > 3
        return [Reading(replace(self, columns=columns, rows=rows), text, asks=True)] if fewer else []
