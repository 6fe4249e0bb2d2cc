"""A ChArUco board: squares with markers in the white ones, so that a part of it is enough."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.artwork import Artwork, dark_runs, dark_squares, sheet, shifted
from vision.boards.board import NOTHING, Board, BoardView, Print, Reading, flipped
from vision.boards.corners import WINDOW, refined
from vision.camera import Array, Image
from vision.dictionaries import bits_of, dictionary_of, other_dictionary

# Ways in which a picture may have to be changed to show the markers, and the key that says so.
MIRRORED = (
    "set mirrored = true (false where it is true already), in [cameras.board] where only the board is "
    "mirrored, in [[cameras]] where the film is too"
)
WAYS: tuple[tuple[str, Callable[[Image], Image], str], ...] = (
    (
        "inverted",
        lambda p: np.asarray(255 - p, dtype=np.uint8),
        "set inverted = true in [cameras.board], false where it is true already",
    ),
    ("mirrored", flipped, MIRRORED),
    (
        "inverted and mirrored",
        lambda p: flipped(np.asarray(255 - p, dtype=np.uint8)),
        f"set inverted = true in [cameras.board]; and {MIRRORED}",
    ),
)


@dataclass(frozen=True, kw_only=True)
class CharucoBoard(Board, kind="charuco"):
    """Columns x rows squares with markers of marker_mm.

    legacy: as OpenCV drew it before 4.6: it begins with a white square when rows are even.

    Raises ValueError for markers that do not fit the squares, and for a dictionary with too few of them.

    >>> CharucoBoard(columns=3, rows=3, square_mm=20.0, marker_mm=15.0).points.tolist()
    [[20.0, 20.0, 0.0], [40.0, 20.0, 0.0], [20.0, 40.0, 0.0], [40.0, 40.0, 0.0]]
    """

    marker_mm: float
    dictionary: str = "DICT_4X4_50"
    legacy: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.marker_mm < self.square_mm:
            raise ValueError(
                f"board marker is {self.marker_mm} mm in squares of {self.square_mm} mm: "
                "the marker must be smaller than the square, both in mm"
            )
        needed, there = self.columns * self.rows // 2, len(dictionary_of(self.dictionary).bytesList)
        if needed > there:
            raise ValueError(
                f"a charuco board of {self.columns} x {self.rows} squares needs {needed} markers, "
                f"{self.dictionary} has {there}: take a larger dictionary or fewer squares"
            )

    @property
    def opencv(self) -> cv2.aruco.CharucoBoard:
        """The board as OpenCV draws and detects it, lengths in mm."""
        size, words = (self.columns, self.rows), dictionary_of(self.dictionary)
        printed = cv2.aruco.CharucoBoard(size, self.square_mm, self.marker_mm, words)
        printed.setLegacyPattern(self.legacy)
        return printed

    @property
    def points(self) -> Array:
        """Places (n,3) mm of the inner corners, row by row."""
        return np.asarray(self.opencv.getChessboardCorners(), dtype=np.float64)

    def look(self, picture: Image) -> BoardView:
        """The inner corners between markers that the picture shows."""
        detector = cv2.aruco.CharucoDetector(self.opencv)
        corners, ids, _, _ = detector.detectBoard(picture)
        if ids is None or len(ids) < 4:
            # One foreign marker with an id of the board and OpenCV sees no board: leave out those seen twice.
            quads, names = self._once(picture)
            corners, ids, _, _ = detector.detectBoard(picture, markerCorners=quads, markerIds=names)
        if corners is None or ids is None or len(corners) < 4:
            return NOTHING
        margin = 0.5 * (self.square_mm - self.marker_mm)  # keeps clear of the markers inside the squares
        return refined(
            picture,
            self.points[np.asarray(ids).reshape(-1)],
            np.asarray(corners, dtype=np.float64).reshape(-1, 2),
            min(WINDOW * self.square_mm, margin),
        )

    def _once(self, picture: Image) -> tuple[list[NDArray[np.float32]], NDArray[np.int32]]:
        """Corners and ids of the markers that the picture shows once."""
        corners, ids, _ = cv2.aruco.ArucoDetector(dictionary_of(self.dictionary)).detectMarkers(picture)
        names = [] if ids is None else np.asarray(ids).ravel().tolist()
        rows = [i for i, name in enumerate(names) if names.count(name) == 1]
        quads = [np.asarray(corners[i], dtype=np.float32) for i in rows]
        return quads, np.array([names[i] for i in rows], dtype=np.int32)

    def artwork(self) -> Artwork:
        """The sheet to print, with a clear border of half a square."""
        border, square = 0.5 * self.square_mm, self.square_mm
        white_first = self.legacy and self.rows % 2 == 0
        dark = dark_runs(dark_squares(self.columns, self.rows, white_first=white_first)) * square
        size = (self.columns * square + 2.0 * border, self.rows * square + 2.0 * border)
        both = np.concatenate([dark, self._markers()])
        return sheet(size, rectangles=shifted(both, border, border), inverted=self.inverted)

    def _markers(self) -> Array:
        """Black rectangles (n,4) mm of the markers in the white squares."""
        printed, words = self.opencv, dictionary_of(self.dictionary)
        cell = self.marker_mm / (words.markerSize + 2)
        rectangles = []
        for marker, corners in zip(np.asarray(printed.getIds()).ravel(), printed.getObjPoints(), strict=True):
            x, y, _ = np.asarray(corners, dtype=np.float64)[0]
            rectangles.append(shifted(dark_runs(bits_of(int(marker), self.dictionary) == 0) * cell, x, y))
        return np.concatenate(rectangles)

    def print_of(self, texels: float) -> Print:
        """The print with at least `texels` texels a square."""
        square = self._square_texels(texels)
        size = (self.columns * square, self.rows * square)
        printed = np.asarray(self.opencv.generateImage(size, marginSize=0, borderBits=1))
        border = square // 2
        return Print(np.pad(printed / 255.0, border, constant_values=1.0), border, square / self.square_mm)

    def _square_texels(self, least: float) -> int:
        """Texels per square, at least the wanted number, for which the marker's cells come out whole."""
        cells = dictionary_of(self.dictionary).markerSize + 2
        for square in range(int(least), int(least) + 400):
            marker = square * self.marker_mm / self.square_mm
            if abs(marker / cells - round(marker / cells)) < 1e-6 and (square - round(marker)) % 2 == 0:
                return square
        return int(least) + int(least) % 2

    def other_readings(self) -> list[Reading]:
        """As OpenCV drew it before 4.6, where that is different."""
        text = "The ChArUco board was read as OpenCV before 4.6 drew it, with a white square first."
        differs = self.rows % 2 == 0 and not self.legacy
        return [Reading(replace(self, legacy=True), text, asks=False)] if differs else []

    def advice(self, pictures: Sequence[Image], needed: int) -> str:
        """Advice: another dictionary, inverted, columns for rows, or a sharper picture."""
        detector = cv2.aruco.ArucoDetector(dictionary_of(self.dictionary))
        markers = sum(len(detector.detectMarkers(picture)[0]) for picture in pictures)
        start, few = f"; {self.dictionary} finds {markers}", pictures[:2]
        for word, changed, key in WAYS:
            others = sum(len(detector.detectMarkers(changed(p))[0]) for p in pictures)
            if others > 2 * markers + 3:
                return start + f" and {others} in the {word} pictures: {key}"
        better = other_dictionary(few, self.dictionary) if markers < len(pictures) else None
        if better:
            return start + f", {better[0]} finds {better[1]} in the first {len(few)}: set that dictionary"
        turned = replace(self, columns=self.rows, rows=self.columns)
        if turned.usable(pictures) >= needed:
            return start + f": the board is one of {self.rows} columns and {self.columns} rows, set these"
        return start + ": check columns, rows and dictionary, and photograph the whole board sharply"
