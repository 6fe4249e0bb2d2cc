"""Board pictures in, camera out: Zhang's method, the lens model chosen by evidence, gates with reasons."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from vision.boards import Board, corners
from vision.camera import Array, Camera, Image
from vision.dictionaries import dictionary_of, other_dictionary

MIN_IMAGES = 6
MIN_CORNERS = 8
MIN_TILT_DEG = 10.0  # below it focal length and distance are one number, and OpenCV's sd does not tell


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
    detected = [corners(picture, board) for picture in pictures]
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
        np.diag(np.asarray(spread, dtype=np.float64).reshape(-1)[:9] ** 2),
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
