"""Cameras that other programs calibrated: OpenCV and ROS YAML, OpenCV XML and JSON, caliscope TOML."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vision.camera import DISTORTION, Array, Camera

MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "M1", "matrix")
LENS = ("distortion_coefficients", "dist_coeffs", "distCoeffs", "Distortion_Coefficients", "D", "D1")
SIZES = (("image_width", "image_height"), ("image_Width", "image_Height"))
LONGEST = 1000  # focal length over the picture's longest side: that of a telescope
RMS = ("avg_reprojection_error", "Avg_Reprojection_Error", "rms")


@dataclass(frozen=True)
class _Numbers:
    """Numbers of a camera as a file holds them."""

    matrix: Any
    lens: Any
    size: tuple[int, int] | None
    rms_px: float


def read_camera(path: Path, *, name: str, size: tuple[int, int]) -> Camera:
    """The camera in a file of another program.

    name: which one to take where a TOML file holds several: its key, or the number at the end of the name.
    size: px, width and height of the film; the file's own, where it has one, must be the same.

    Such files hold no covariance, so that the calibration adds nothing to the stated uncertainty: a remark
    says so. Raises ValueError when matrix or distortion is missing, when the lens model is another one than
    k1 k2 p1 p2 k3, or when the size differs.
    """
    if not path.is_file():
        raise ValueError(
            f"camera file {path} does not exist: give an OpenCV YAML, XML or caliscope TOML file"
        )
    numbers = _toml(path, name) if path.suffix == ".toml" else _storage(path)
    if numbers.size not in (None, size):
        raise ValueError(
            f"camera file {path.name} is for {numbers.size} px, the film has {size} px: use the camera of "
            "the same setting, not scaled or cropped"
        )
    matrix, distortion = _matrix(path, numbers.matrix), _distortion(path, numbers.lens)
    _check_sane(path, matrix, distortion, size)
    remark = (
        f"{path.name} does not say how well the camera is known, so that its error is not in the stated "
        "uncertainty: calibrate with board images to include it."
    )
    used = tuple(term for term, value in zip(DISTORTION, distortion, strict=True) if value != 0.0)
    return Camera(matrix, distortion, size, numbers.rms_px, 0, model=used, remarks=(remark,))


def _check_sane(path: Path, matrix: Array, distortion: Array, size: tuple[int, int]) -> None:
    """Raises ValueError unless the numbers can belong to a camera that takes pictures of this size."""
    width, height = size
    (fx, skew, cx), (lower, fy, cy), last = matrix
    wrong = ""
    if not (np.isfinite(matrix).all() and np.isfinite(distortion).all()):
        wrong = "holds numbers that are not finite"
    elif not (fx > 0.0 and fy > 0.0 and 0.5 < fx / fy < 2.0):
        wrong = f"has the focal lengths {fx:g} and {fy:g} px, wanted two of about the same size above 0"
    elif not fx < LONGEST * max(size):
        wrong = f"has the focal length {fx:g} px, wanted less than {LONGEST} times its {max(size)} px"
    elif skew != 0.0 or lower != 0.0 or last.tolist() != [0.0, 0.0, 1.0]:
        wrong = "has a matrix other than [fx 0 cx; 0 fy cy; 0 0 1]"
    elif not (0.0 < cx < width and 0.0 < cy < height):
        wrong = f"has its centre at ({cx:g}, {cy:g}) px, wanted it inside its {width} x {height} px"
    if wrong:
        raise ValueError(f"camera file {path.name} {wrong}: correct the file, or calibrate with board images")


def _toml(path: Path, name: str) -> _Numbers:
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"camera file {path} is no TOML ({error}): write it again") from error
    cameras = data.get("cameras", data)
    if not isinstance(cameras, Mapping):
        raise ValueError(f"camera file {path.name}: cameras is no table; wanted one table for each camera")
    tables = {key: value for key, value in cameras.items() if isinstance(value, Mapping)}
    digits = name[len(name.rstrip("0123456789")) :]
    key = next((k for k in (name, digits, *(tables if len(tables) == 1 else ())) if k in tables), None)
    if key is None:
        raise ValueError(
            f"camera file {path.name} holds the cameras {', '.join(tables) or 'none'}, wanted {name!r}: call "
            "the camera in twin.toml as one of them"
        )
    camera = tables[key]
    try:
        size = tuple(int(side) for side in camera["size"]) if "size" in camera else None
        rms = float(camera.get("error", 0.0))
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"camera file {path.name}: size or error of {key} is wrong: wanted size = [width, height] "
            "and a number"
        ) from None
    lens = camera.get("distortions", camera.get("dist_coeffs"))
    return _Numbers(camera.get("matrix"), lens, size, rms)  # type: ignore[arg-type]


def _storage(path: Path) -> _Numbers:
    text = path.read_text(encoding="utf-8", errors="replace")
    if path.suffix in (".yml", ".yaml") and not text.startswith("%YAML"):
        text = "%YAML:1.0\n---\n" + text  # ROS writes none
    try:
        return _stored(cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY))
    except (cv2.error, SystemError, OverflowError, ValueError) as error:
        raise ValueError(f"camera file {path} cannot be read as YAML, XML or JSON: write it again") from error


def _stored(storage: cv2.FileStorage) -> _Numbers:
    """Numbers that OpenCV reads from a file; it raises errors of its own for what is no matrix."""
    width, height = (_first(storage, keys) for keys in zip(*SIZES, strict=True))
    size = None if width is None or height is None else (int(width.real()), int(height.real()))
    rms = _first(storage, RMS)
    matrix, lens = (_values(_first(storage, keys)) for keys in (MATRIX, LENS))
    return _Numbers(matrix, lens, size, 0.0 if rms is None else float(rms.real()))


def _first(storage: cv2.FileStorage, keys: tuple[str, ...]) -> Any:
    return next((node for node in map(storage.getNode, keys) if not node.empty()), None)


def _values(node: Any) -> Any:
    """Numbers of an OpenCV matrix, or of a plain map with `data` as ROS writes it."""
    if node is None:
        return None
    data = node.getNode("data") if node.isMap() else node
    if data.isSeq():
        return [data.at(i).real() for i in range(data.size())]
    return node.mat()


def _numbers(path: Path, values: Any) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"camera file {path.name}: matrix or distortion holds other things than numbers: write it again"
        ) from None


def _matrix(path: Path, values: Any) -> Array:
    matrix = None if values is None else _numbers(path, values)
    if matrix is None or matrix.size != 9:
        raise ValueError(
            f"camera file {path.name} has no camera matrix of 9 numbers: wanted the key {MATRIX[0]} as "
            "OpenCV writes it"
        )
    return matrix.reshape(3, 3)


def _distortion(path: Path, values: Any) -> Array:
    if values is None:
        raise ValueError(
            f"camera file {path.name} has no distortion: wanted the key {LENS[0]} as OpenCV writes it (zeros "
            "if there is none)"
        )
    terms = _numbers(path, values).ravel()
    if np.any(terms[5:] != 0.0):
        raise ValueError(
            f"camera file {path.name} has {terms.size} distortion terms, wanted k1 k2 p1 p2 k3 alone: "
            "calibrate without the rational, thin prism, tilted or fisheye model"
        )
    return np.concatenate([terms[:5], np.zeros(5 - len(terms[:5]))])
