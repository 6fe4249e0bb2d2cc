"""A printed calibration board and where its corners are seen in a picture."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Image
from vision.dictionaries import dictionary_of


@dataclass(frozen=True)
class Board:
    """A ChArUco board: how many squares, how large, which markers; `inverted` is white printed on black."""

    columns: int
    rows: int
    square_mm: float
    marker_mm: float
    dictionary: str = "DICT_4X4_50"
    inverted: bool = False


def charuco(board: Board) -> cv2.aruco.CharucoBoard:
    """The board as OpenCV draws and detects it, lengths in mm."""
    if not 0 < board.marker_mm < board.square_mm:
        raise ValueError(
            f"board marker is {board.marker_mm} mm in squares of {board.square_mm} mm: "
            "the marker must be smaller than the square, both in mm"
        )
    return cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square_mm, board.marker_mm, dictionary_of(board.dictionary)
    )


def corners(picture: Image, board: Board) -> tuple[Array, Array]:
    """Board corners (n,3) mm and where they are seen (n,2) px; empty when the board is not found."""
    printed = charuco(board)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(printed).detectBoard(picture)
    if corners is None or ids is None or len(corners) < 4:
        return np.empty((0, 3)), np.empty((0, 2))
    pixels = np.asarray(corners, dtype=np.float32).reshape(-1, 1, 2)
    points = np.asarray(printed.getChessboardCorners())[np.asarray(ids).reshape(-1)]
    half = _half_window(points, pixels.reshape(-1, 2), board)
    # A window wider than half a square reaches the neighbouring corners and moves the focal length by 7 sd.
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    refined = cv2.cornerSubPix(picture, pixels.copy(), (half, half), (-1, -1), stop)
    return np.asarray(points, dtype=np.float64), np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def _half_window(points: NDArray[Any], pixels: NDArray[Any], board: Board) -> int:
    """Half window in px that keeps clear of the markers inside the squares."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    apart = np.linalg.norm(pixels[:, None] - pixels[None], axis=-1)
    neighbours = apart[np.isclose(distance, board.square_mm)]
    square = float(np.min(neighbours)) if neighbours.size else 12.0
    margin = 0.5 * (board.square_mm - board.marker_mm) / board.square_mm * square
    return int(np.clip(margin, 2, 5))
