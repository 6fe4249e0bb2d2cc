"""Boards of circles in rows, straight or every other one shifted."""

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.measure import find_contours

from vision.artwork import Artwork, sheet
from vision.boards.board import NOTHING, Board, BoardView, Print
from vision.boards.corners import px_per_mm, shrunk
from vision.boards.dotgrid import find_dots_of_board, walk
from vision.camera import Array, Image

CIRCLE = 0.3  # radius of a circle, in distances of two circles
MIN_PART, SHARE = 12, 0.25  # circles, and share of the board's, that a part of a board must show


@dataclass(frozen=True, kw_only=True)
class CircleBoard(Board, kind="circles"):
    """Columns x rows circles, square_mm apart."""

    shows: ClassVar[str] = "circles"
    joins_cameras: ClassVar[bool] = False
    pattern: ClassVar[int] = cv2.CALIB_CB_SYMMETRIC_GRID
    reach: ClassVar[float] = 0.5  # squares round a circle that belong to no other

    def look(self, picture: Image) -> BoardView:
        """All circles with their outlines."""
        small, factor = shrunk(picture)
        size = (self.columns, self.rows)
        for flags in (self.pattern, self.pattern + cv2.CALIB_CB_CLUSTERING):
            seen, centres = cv2.findCirclesGrid(small, size, flags=flags, blobDetector=_blobs(small))
            if seen:
                break
        else:
            return self._part(picture)
        pixels = (np.asarray(centres, dtype=np.float64).reshape(-1, 2) + 0.5) * factor - 0.5
        return outlined(picture, self.points, pixels, self.reach * self.square_mm)

    def _part(self, picture: Image) -> BoardView:
        """The part of the board that the picture shows, wherever on the board it is; `NOTHING` where it is a
        small one, or more than the board has.

        Which circle is which cannot be told, and one camera need not know: every picture has its own pose.
        """
        dots = find_dots_of_board(picture)
        rows, step = walk(dots.centre)
        if len(rows) < max(MIN_PART, SHARE * self.columns * self.rows):
            return NOTHING
        place = self._lattice(step)
        place = place - place.min(axis=0)
        most = np.ptp(self.points[:, :2], axis=0) / self.square_mm
        if not any(np.all(place.max(axis=0) <= size) for size in (most, most[::-1])):
            return NOTHING
        points = np.column_stack([place, np.zeros(len(place))]) * self.square_mm
        return outlined(picture, points, dots.centre[rows], self.reach * self.square_mm)

    def _lattice(self, step: NDArray[np.intp]) -> Array:
        """Places (n,2) in squares after steps (n,2) from circle to the nearest circles."""
        return step.astype(np.float64)

    def artwork(self) -> Artwork:
        """The sheet to print, with a clear border of a square."""
        square = self.square_mm
        centre = self.points[:, :2] + square
        circles = np.column_stack([centre, np.full(len(centre), CIRCLE * square)])
        return sheet(tuple(centre.max(axis=0) + square), circles=circles, inverted=self.inverted)

    def print_of(self, texels: float) -> Print:
        """The print with at least `texels` texels from circle to circle."""
        square = 2 * int(np.ceil(0.5 * texels))  # halves are whole texels
        centre = self.points[:, :2] / self.square_mm + 1.0
        paper = np.ones(np.asarray((centre.max(axis=0)[::-1] + 1.0) * square, dtype=int))
        offset = np.arange(square) + 0.5 - 0.5 * square
        circle = np.clip(np.hypot(offset[:, None], offset) - CIRCLE * square + 0.5, 0.0, 1.0)
        for column, row in np.asarray((centre - 0.5) * square, dtype=int):
            paper[row : row + square, column : column + square] = circle
        return Print(paper, float(square), square / self.square_mm)


@dataclass(frozen=True, kw_only=True)
class AsymmetricCircleBoard(CircleBoard, kind="acircles"):
    """Rows of circles, every other row shifted by square_mm, counted as OpenCV does.

    The circles of a row are 2 square_mm apart, the rows square_mm.

    >>> AsymmetricCircleBoard(columns=2, rows=2, square_mm=10.0).points[:, :2].tolist()
    [[0.0, 0.0], [20.0, 0.0], [10.0, 10.0], [30.0, 10.0]]
    """

    pattern: ClassVar[int] = cv2.CALIB_CB_ASYMMETRIC_GRID
    reach: ClassVar[float] = 0.7

    def _lattice(self, step: NDArray[np.intp]) -> Array:
        """Places (n,2) in squares, the nearest circles being along the diagonals."""
        return np.stack([step[:, 0] - step[:, 1], step[:, 0] + step[:, 1]], axis=1).astype(np.float64)

    @property
    def points(self) -> Array:
        """Places (n,3) mm of the circles, row by row."""
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        return np.stack([2 * column + row % 2, row, np.zeros(len(row))], axis=1) * self.square_mm


def outlined(picture: Image, points: Array, pixels: Array, reach_mm: float) -> BoardView:
    """The circles with their outlines, from about where they are; those without a clear outline are left out.

    reach_mm: round a circle, belongs to no other.
    """
    outlines = [
        _outline(picture, pixel, reach_mm * scale)
        for pixel, scale in zip(pixels, px_per_mm(points, pixels), strict=True)
    ]
    seen = [i for i, outline in enumerate(outlines) if outline is not None]
    shapes = tuple(outline for outline in outlines if outline is not None)
    return BoardView(points[seen], np.array([centroid(o) for o in shapes]).reshape(-1, 2), shapes)


def _blobs(picture: Image) -> cv2.SimpleBlobDetector:
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.minArea, parameters.maxArea = 12.0, 0.02 * picture.size
    parameters.minThreshold, parameters.thresholdStep = 20.0, 10.0
    parameters.minDistBetweenBlobs = 3.0
    return cv2.SimpleBlobDetector.create(parameters)


def _outline(picture: Image, centre: Array, reach: float) -> Array | None:
    """Sub-pixel outline (k,2) px at half the grey step of the dark circle round a centre."""
    low = np.maximum(np.floor(centre - reach).astype(int), 0)
    high = np.minimum(np.ceil(centre + reach).astype(int) + 1, picture.shape[::-1])
    part = picture[low[1] : high[1], low[0] : high[0]].astype(np.float64)
    if min(part.shape) < 5:
        return None
    level = 0.5 * (np.percentile(part, 3.0) + np.percentile(part, 90.0))
    around = [c for c in find_contours(part, level) if len(c) > 8 and np.array_equal(c[0], c[-1])]
    local = (centre - low)[::-1].astype(np.float32)
    around = [c for c in around if cv2.pointPolygonTest(c.astype(np.float32), local.tolist(), False) > 0]
    # A ring has two, of which the outer one is as wide as a plain circle's.
    return max(around, key=lambda c: float(np.ptp(c, axis=0).prod()))[:-1, ::-1] + low if around else None


def centroid(polygon: Array) -> Array:
    """Centroid (2,) of the area inside a polygon (k,2).

    >>> centroid(np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]]))
    array([1., 1.])
    """
    origin = polygon.mean(axis=0)
    a = polygon - origin
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.asarray(origin + ((a + b) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum()))
