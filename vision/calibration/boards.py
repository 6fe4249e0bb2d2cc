"""A printed calibration board and where its corners or circles are seen in a picture."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.measure import find_contours

from vision.camera import Array, Image
from vision.dictionaries import dictionary_of

KINDS = ("charuco", "chessboard", "circles", "acircles")
SEARCH_PX = 1280  # larger pictures are shrunk to this to find a board without markers, not to measure it
# Half window of the corner refinement in squares: at 0.4 it reaches the next corners of tilted boards and
# moves the focal length by sds; at 0.1 it wastes half the information (measured on real boards).
WINDOW = 0.3
LEAST_HALF, MOST_HALF = 2, 12  # px


@dataclass(frozen=True)
class Board:
    """A printed board, flat, with one size of square.

    kind: "charuco" (columns x rows squares, markers of marker_mm), "chessboard" (columns x rows inner
    corners), "circles" (columns x rows circles, square_mm apart), "acircles" (rows of `columns` circles
    2 square_mm apart, every other row shifted by square_mm, rows square_mm apart), as OpenCV counts them.
    inverted: white printed on black.
    legacy: a ChArUco board of before OpenCV 4.6, which begins with a white square when rows are even.
    """

    columns: int
    rows: int
    square_mm: float
    marker_mm: float = 0.0
    dictionary: str = "DICT_4X4_50"
    inverted: bool = False
    kind: str = "charuco"
    legacy: bool = False


@dataclass(frozen=True)
class BoardView:
    """What one picture shows of a board."""

    points: Array  # (n,3) mm on the board
    pixels: Array  # (n,2) raw px
    outlines: tuple[Array, ...] = ()  # (n) of (k,2) raw px, of circles

    def __len__(self) -> int:
        return len(self.pixels)


NOTHING = BoardView(np.empty((0, 3)), np.empty((0, 2)))


def charuco(board: Board) -> cv2.aruco.CharucoBoard:
    """The board as OpenCV draws and detects it, lengths in mm."""
    if not 0 < board.marker_mm < board.square_mm:
        raise ValueError(
            f"board marker is {board.marker_mm} mm in squares of {board.square_mm} mm: "
            "the marker must be smaller than the square, both in mm"
        )
    words = dictionary_of(board.dictionary)
    needed = board.columns * board.rows // 2
    if needed > len(words.bytesList):
        raise ValueError(
            f"a charuco board of {board.columns} x {board.rows} squares needs {needed} markers, "
            f"{board.dictionary} has {len(words.bytesList)}: take a larger dictionary or fewer squares"
        )
    size = (board.columns, board.rows)
    printed = cv2.aruco.CharucoBoard(size, board.square_mm, board.marker_mm, words)
    printed.setLegacyPattern(board.legacy)
    return printed


def grid(board: Board) -> Array:
    """Places (columns * rows, 3) mm of a board's inner corners or circles, row by row."""
    row, column = np.divmod(np.arange(board.columns * board.rows), board.columns)
    across = 2 * column + row % 2 if board.kind == "acircles" else column
    return np.stack([across, row, np.zeros(len(row))], axis=1) * board.square_mm


def find_board(picture: Image, board: Board) -> BoardView:
    """Where a picture (h,w) shows the board; nothing when it is not found. Raises ValueError for its kind."""
    if board.kind not in KINDS:
        raise ValueError(f"board kind {board.kind!r} is not known: use one of {', '.join(KINDS)}")
    find = {"charuco": _charuco, "chessboard": _chessboard}.get(board.kind, _circles)
    return find(picture, board)


def _charuco(picture: Image, board: Board) -> BoardView:
    printed = charuco(board)
    detector = cv2.aruco.CharucoDetector(printed)
    corners, ids, _, _ = detector.detectBoard(picture)
    if ids is None or len(ids) < 4:
        # One foreign marker with an id of the board and OpenCV sees no board: those seen twice are left out.
        once = _once(picture, board)
        corners, ids, _, _ = detector.detectBoard(picture, markerCorners=once[0], markerIds=once[1])
    if corners is None or ids is None or len(corners) < 4:
        return NOTHING
    points = np.asarray(printed.getChessboardCorners(), dtype=np.float64)[np.asarray(ids).reshape(-1)]
    margin = 0.5 * (board.square_mm - board.marker_mm)  # keeps clear of the markers inside the squares
    return _refined(
        picture,
        points,
        np.asarray(corners, dtype=np.float64).reshape(-1, 2),
        min(WINDOW * board.square_mm, margin),
    )


def _once(picture: Image, board: Board) -> tuple[list[NDArray[np.float32]], NDArray[np.int32]]:
    """Corners and ids of the markers that the picture shows once."""
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary_of(board.dictionary)).detectMarkers(picture)
    names = [] if ids is None else np.asarray(ids).ravel().tolist()
    kept = [i for i, name in enumerate(names) if names.count(name) == 1]
    quads = [np.asarray(corners[i], dtype=np.float32) for i in kept]
    return quads, np.array([names[i] for i in kept], dtype=np.int32)


def _chessboard(picture: Image, board: Board) -> BoardView:
    """OpenCV's classic finder, and its sector-based one where that fails; both may see a smaller picture."""
    size = (board.columns, board.rows)
    small, factor = _shrunk(picture)
    found, corners = cv2.findChessboardCorners(small, size)
    if not found:
        found, corners = cv2.findChessboardCornersSB(small, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        return NOTHING
    pixels = (np.asarray(corners, dtype=np.float64).reshape(-1, 2) + 0.5) * factor - 0.5
    return _refined(picture, grid(board), pixels, WINDOW * board.square_mm)


def _shrunk(picture: Image) -> tuple[Image, float]:
    """The picture with no side above SEARCH_PX, and by what it was divided."""
    factor = max(1.0, max(picture.shape) / SEARCH_PX)
    if factor == 1.0:
        return picture, 1.0
    size = (round(picture.shape[1] / factor), round(picture.shape[0] / factor))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8), factor


def _refined(picture: Image, points: Array, pixels: Array, reach_mm: float) -> BoardView:
    """Corners to a few hundredths of a pixel, each in a window that reaches reach_mm on the board."""
    half = np.clip(reach_mm * _px_per_mm(points, pixels), LEAST_HALF, MOST_HALF).astype(int)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    refined = np.array(pixels, dtype=np.float64)
    for size in np.unique(half):
        rows = np.flatnonzero(half == size)
        start = np.ascontiguousarray(pixels[rows], dtype=np.float32).reshape(-1, 1, 2)
        window = (int(size), int(size))
        refined[rows] = cv2.cornerSubPix(picture, start, window, (-1, -1), stop).reshape(-1, 2)
    return BoardView(points, refined)


def _px_per_mm(points: Array, pixels: Array) -> Array:
    """Smallest scale (n,) px/mm from each corner to the ones nearest to it on the board."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    apart = np.linalg.norm(pixels[:, None] - pixels[None], axis=-1)
    np.fill_diagonal(distance, np.inf)
    near = distance < 1.01 * distance.min(axis=1, keepdims=True)
    return np.asarray(np.where(near, apart / distance, np.inf).min(axis=1))


def _circles(picture: Image, board: Board) -> BoardView:
    small, factor = _shrunk(picture)
    pattern = cv2.CALIB_CB_ASYMMETRIC_GRID if board.kind == "acircles" else cv2.CALIB_CB_SYMMETRIC_GRID
    for flags in (pattern, pattern + cv2.CALIB_CB_CLUSTERING):
        found, centres = cv2.findCirclesGrid(
            small, (board.columns, board.rows), flags=flags, blobDetector=_blobs(small)
        )
        if found:
            break
    else:
        return NOTHING
    pixels = (np.asarray(centres, dtype=np.float64).reshape(-1, 2) + 0.5) * factor - 0.5
    points = grid(board)
    reach = 0.7 * board.square_mm if board.kind == "acircles" else 0.5 * board.square_mm
    outlines = [
        _outline(picture, pixel, reach * scale)
        for pixel, scale in zip(pixels, _px_per_mm(points, pixels), strict=True)
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
    return around[0][:-1, ::-1] + low if around else None


def centroid(polygon: Array) -> Array:
    """Centroid (2,) of the area inside a polygon (k,2)."""
    origin = polygon.mean(axis=0)
    a = polygon - origin
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.asarray(origin + ((a + b) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum()))
