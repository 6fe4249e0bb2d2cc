"""Boards of circles in rows, straight or every other one shifted, and with three coding dots that mark origin
and axes, as measuring systems have them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.measure import find_contours

from vision.artwork import Artwork, sheet
from vision.boards.board import MIN_CORNERS, NOTHING, Board, BoardView, Print
from vision.boards.corners import px_per_mm, shrunk
from vision.boards.dotgrid import coding, find_dots_of_board, walk
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
