"""ChArUco board pictures in, camera out: matrix, distortion, how well they are known."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

MIN_IMAGES = 6
MIN_CORNERS = 8
# Largest dictionary of each family, and the sizes of the smaller ones, which are its first words.
FAMILIES = (
    *((f"DICT_{bits}X{bits}_1000", (50, 100, 250, 1000)) for bits in (4, 5, 6, 7)),
    *((f"DICT_{name}", ()) for name in ("ARUCO_ORIGINAL", "ARUCO_MIP_36h12")),
    *((f"DICT_APRILTAG_{name}", ()) for name in ("16h5", "25h9", "36h10", "36h11")),
)
MIN_TILT_DEG = 10.0  # below it focal length and distance are one number, and OpenCV's sd does not tell


@dataclass(frozen=True)
class Board:
    """A ChArUco board: how many squares, how large, which markers; `inverted` is white printed on black."""

    columns: int
    rows: int
    square_mm: float
    marker_mm: float
    dictionary: str = "DICT_4X4_50"
    inverted: bool = False


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with lens distortion as in OpenCV; pixel (0, 0) is the top-left one's centre."""

    matrix: Array  # (3,3) px
    distortion: Array  # (5,) k1 k2 p1 p2 k3
    size: tuple[int, int]  # px, width and height
    rms_px: float = 0.0  # px, reprojection error of the board corners
    images: int = 0  # number of board pictures used
    stdevs: Array = field(default_factory=lambda: np.zeros(9))  # (9,) 1 sd of fx fy cx cy k1 k2 p1 p2 k3

    def distort(self, points: Array) -> Array:
        """Where ideal pinhole pixels (...,2) land in the raw picture (...,2) px."""
        x, y = self._normal(points)
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        xy2 = 2.0 * x * y
        return self._pixels(
            x * radial + p1 * xy2 + p2 * (r2 + 2.0 * x * x), y * radial + p2 * xy2 + p1 * (r2 + 2.0 * y * y)
        )

    def undistort(self, points: Array) -> Array:
        """Ideal pinhole pixels (...,2) of raw pixels (...,2); the inverse of `distort`, to 1e-9 px."""
        raw = np.asarray(points, dtype=np.float64)
        ideal = raw
        for _ in range(30):
            error = self.distort(ideal) - raw
            ideal = ideal - error
            if not np.any(np.abs(error) > 1e-9):  # NaN (lost) compares false
                break
        return ideal

    def _normal(self, points: Array) -> tuple[Array, Array]:
        (fx, _, cx), (_, fy, cy), _ = self.matrix
        points = np.asarray(points, dtype=np.float64)
        return (points[..., 0] - cx) / fx, (points[..., 1] - cy) / fy

    def _pixels(self, x: Array, y: Array) -> Array:
        (fx, _, cx), (_, fy, cy), _ = self.matrix
        return np.stack([fx * x + cx, fy * y + cy], axis=-1)

    def to_dict(self) -> dict[str, Any]:
        """The camera as plain lists and numbers, for a JSON file."""
        return {
            "matrix": self.matrix.tolist(),
            "distortion": self.distortion.tolist(),
            "size": list(self.size),
            "rms_px": self.rms_px,
            "images": self.images,
            "stdevs": self.stdevs.tolist(),
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Camera":
        """The camera that `to_dict` wrote."""
        width, height = data["size"]
        return cls(
            np.array(data["matrix"], dtype=np.float64),
            np.array(data["distortion"], dtype=np.float64),
            (int(width), int(height)),
            float(data["rms_px"]),
            int(data["images"]),
            np.array(data["stdevs"], dtype=np.float64),
        )


def dictionary_of(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's predefined marker dictionary of that name; raises ValueError for a name it does not have."""
    if not name.startswith("DICT_") or not hasattr(cv2.aruco, name):
        raise ValueError(f"marker dictionary {name!r} is not known: use a name such as DICT_4X4_50")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def other_dictionary(images: Iterable[Image], tried: str) -> tuple[str, int] | None:
    """The other predefined dictionary that finds most markers in the images, and how many, if any does."""
    pictures = list(images)
    found: dict[str, list[int]] = {}
    for family, _ in FAMILIES:
        detector = cv2.aruco.ArucoDetector(dictionary_of(family))
        ids = [detector.detectMarkers(picture)[1] for picture in pictures]
        found[family] = [int(i) for some in ids if some is not None for i in np.asarray(some).reshape(-1)]
    best, sizes = max(FAMILIES, key=lambda f: len(found[f[0]]))
    if len(found[best]) < 2:  # the larger families decode a mark of anything: a lone one is no evidence
        return None
    enough = [best.replace("1000", str(size)) for size in sizes if max(found[best]) < size]
    name = enough[0] if enough else best
    return None if name == tried else (name, len(found[best]))


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


def calibrate_camera(images: Sequence[Path], board: Board, *, max_rms_px: float = 0.3) -> Camera:
    """The camera that took the pictures of a ChArUco board.

    images: picture files, all of one size, the board tilted differently in each.
    board: the printed board; its square sets the scale.
    max_rms_px: px, the largest reprojection error that is accepted.

    Zhang's method as in cv2.calibrateCameraExtended, doi 10.1109/34.888718. Raises ValueError when
    pictures are missing or differ in size, when fewer than 6 show the board (says which other dictionary
    finds markers), when the error is above max_rms_px, or when the focal length stays unknown.
    """
    if not images:
        raise ValueError(
            f"no board images were given: film or photograph the ChArUco board in at least {MIN_IMAGES} poses"
        )
    pictures = [_read(Path(path), board) for path in images]
    sizes = {picture.shape for picture in pictures}
    if len(sizes) > 1:
        raise ValueError(
            f"board images differ in size ({sorted(sizes)} px): use pictures of one camera setting"
        )
    detected = [_corners(picture, board) for picture in pictures]
    used = [i for i, (_, pixels) in enumerate(detected) if len(pixels) >= MIN_CORNERS]
    if len(used) < MIN_IMAGES:
        raise ValueError(_too_few(len(used), pictures, board))
    camera, per_view, tilt_deg = _solve([detected[i] for i in used], pictures[0].shape)
    _accept(camera, max_rms_px, Path(images[used[int(np.argmax(per_view))]]), float(per_view.max()), tilt_deg)
    return camera


def _read(path: Path, board: Board) -> Image:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
    if picture is None:
        raise ValueError(f"board image {path} is missing or cannot be read: give a PNG or JPEG file")
    grey = np.asarray(picture, dtype=np.uint8)
    return np.asarray(255 - grey, dtype=np.uint8) if board.inverted else grey


def _corners(picture: Image, board: Board) -> tuple[Array, Array]:
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


def _solve(detected: list[tuple[Array, Array]], shape: tuple[int, ...]) -> tuple[Camera, Array, float]:
    """Camera, rms (n,) px of each picture, and the largest angle in degrees between two of the boards."""
    points = [p.astype(np.float32) for p, _ in detected]
    pixels = [q.astype(np.float32) for _, q in detected]
    size = (int(shape[1]), int(shape[0]))
    rms, matrix, distortion, turns, _, spread, _, per_view = cv2.calibrateCameraExtended(
        points, pixels, size, np.eye(3), np.zeros(5)
    )
    camera = Camera(
        np.asarray(matrix, dtype=np.float64),
        np.asarray(distortion, dtype=np.float64).reshape(-1)[:5],
        size,
        float(rms),
        len(points),
        np.asarray(spread, dtype=np.float64).reshape(-1)[:9],
    )
    normals = np.array([cv2.Rodrigues(np.asarray(turn))[0][:, 2] for turn in turns])
    tilt = np.degrees(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0).min()))
    return camera, np.asarray(per_view, dtype=np.float64).reshape(-1), float(tilt)


def _accept(camera: Camera, limit: float, worst: Path, worst_rms: float, tilt_deg: float) -> None:
    if not camera.rms_px <= limit:
        raise ValueError(
            f"reprojection error of the board corners is {camera.rms_px:.3f} px, wanted at most "
            f"{limit} px; {worst.name} is worst with {worst_rms:.3f} px: remove blurred pictures "
            "and check that the board is flat and its squares are as stated"
        )
    if tilt_deg < MIN_TILT_DEG:
        raise ValueError(
            f"the boards are tilted by at most {tilt_deg:.1f} degrees against each other, wanted "
            f"{MIN_TILT_DEG}: the focal length stays unknown; add pictures tilted by 20 to 40 degrees"
        )


def _too_few(usable: int, pictures: list[Image], board: Board) -> str:
    detector = cv2.aruco.ArucoDetector(dictionary_of(board.dictionary))
    markers = sum(len(detector.detectMarkers(picture)[0]) for picture in pictures)
    start = (
        f"{usable} of {len(pictures)} board images show at least {MIN_CORNERS} corners of the "
        f"{board.columns} x {board.rows} board, wanted {MIN_IMAGES}; {board.dictionary} finds {markers}"
    )
    other = other_dictionary(pictures[:2], board.dictionary) if markers < len(pictures) else None
    if other:
        return start + f", {other[0]} finds {other[1]} in the first {len(pictures[:2])}: set that dictionary"
    inverted = sum(len(detector.detectMarkers(np.asarray(255 - p, dtype=np.uint8))[0]) for p in pictures[:2])
    if inverted > 3 and markers == 0:
        return start + f" and {inverted} in the inverted pictures: set inverted"
    return start + ": check columns, rows and dictionary, and photograph the whole board sharply"
