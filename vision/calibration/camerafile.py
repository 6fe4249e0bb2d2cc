"""Cameras that other programs calibrated: YAML of OpenCV, ROS and Kalibr, XML, JSON, TOML of caliscope."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vision.camera import DISTORTION, Array, Camera
from vision.opencvfile import bounded_text, read_opencv

MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "M1", "matrix", "intrinsics")
LENS = (
    "distortion_coefficients", "dist_coeffs", "distCoeffs", "Distortion_Coefficients", "D", "D1",
    "distortions", "distortion_coeffs",
)  # fmt: skip
SIZES = (("image_width", "image_height"), ("image_Width", "image_Height"))
LONGEST = 1000  # focal length over the picture's longest side: that of a telescope
BOTH_SIZES = ("size", "resolution", "image_size")
RMS = ("avg_reprojection_error", "Avg_Reprojection_Error", "rms", "error")
SPEAKS_OF_LENS = re.compile(
    r"(?i)fish|omni|equi|kannala|model|distort|dist_|lens|mirror|rational|prism|tilt|skew|^xi$|^alpha$|^k\d|^p\d"
)
BROWN = (
    "plumb_bob", "radtan", "brown", "brown_conrady", "pinhole", "perspective", "opencv", "standard", "none",
    "", "0", "0.0", "false", "rational_polynomial",  # whose further terms must be 0
)  # fmt: skip
# Keys that say nothing of the lens
IDLE = (
    "camera_name", "name", "port", "rectification_matrix", "projection_matrix", "R", "P", "rotation",
    "translation", "rotation_count", "exposure", "grid_count", "ignore", "verified_resolutions", "nframes",
    "calibration_time", "nr_of_frames", "board_width", "board_height", "square_size", "marker_size", "flags",
    "flagValue", "aspectRatio", "fix_aspect_ratio", "extrinsic_parameters", "Extrinsic_Parameters",
    "image_points", "Image_points", "grid_points", "per_view_reprojection_errors",
    "Per_View_Reprojection_Errors", "rostopic", "T_cam_imu", "T_cn_cnm1", "timeshift_cam_imu",
    "cam_overlaps", "board_Width", "board_Height", "square_Size",
)  # fmt: skip


@dataclass(frozen=True)
class _Numbers:
    """Numbers of a camera as a file holds them."""

    matrix: Any
    lens: Any
    size: tuple[int, int] | None
    rms_px: float
    unused: tuple[str, ...]  # keys that are not known


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
    numbers = _read(path, _camera(path, _tree(path), name))
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
    remarks: tuple[str, ...] = (remark,)
    if numbers.unused:
        keys = ", ".join(numbers.unused[:8])
        remarks += (f"{path.name} has keys that are not used: {keys}. Does one of them change the lens?",)
    used = tuple(term for term, value in zip(DISTORTION, distortion, strict=True) if value != 0.0)
    return Camera(matrix, distortion, size, numbers.rms_px, 0, model=used, remarks=remarks)


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


def _tree(path: Path) -> dict[str, Any]:
    """What a file holds: tables, lists, numbers and texts."""
    if path.suffix != ".toml":
        return read_opencv(path, what="camera file")
    text = bounded_text(path, what="camera file")
    try:
        if re.search(r"(?:[\w\"'-]+\s*\.\s*){33}", text):
            raise ValueError("a key of more than 32 parts")
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"camera file {path} is no TOML ({error}): write it again") from error


def _camera(path: Path, tree: dict[str, Any], name: str) -> dict[str, Any]:
    """The table of one camera: the file itself, or one of its tables by its key or its name."""
    if _first(tree, MATRIX + LENS) is not None:
        return tree
    cameras = tree.get("cameras", tree)
    if not isinstance(cameras, Mapping):
        raise ValueError(f"camera file {path.name}: cameras is no table; wanted one table for each camera")
    tables = {key: value for key, value in cameras.items()
              if isinstance(value, Mapping) and _first(value, MATRIX + LENS) is not None}  # fmt: skip
    if not tables and path.suffix != ".toml":
        return tree
    digits = name[len(name.rstrip("0123456789")) :]
    named = (key for key, table in tables.items() if table.get("name") == name)
    only = tables if len(tables) == 1 else ()
    key = next((k for k in (name, *named, digits, *only) if k in tables), None)
    if key is None:
        raise ValueError(
            f"camera file {path.name} holds the cameras {', '.join(tables) or 'none'}, wanted {name!r}: call "
            "the camera in twin.toml as one of them"
        )
    above = {k: v for level in (tree, cameras) for k, v in level.items() if not isinstance(v, Mapping)}
    return above | dict(tables[key])


def _read(path: Path, camera: dict[str, Any]) -> _Numbers:
    """The numbers of a camera's table. ValueError where it has another lens model than Brown's, or a key that
    is not known and may say so."""
    known = {*MATRIX, *LENS, *BOTH_SIZES, *RMS, *IDLE, *(key for pair in SIZES for key in pair)}
    for key in (key for key in camera if key not in known):
        value = str(camera[key]).strip()[:40]
        says = SPEAKS_OF_LENS.search(key) or SPEAKS_OF_LENS.search(value)
        if says and value.lower().replace("-", "_").replace(" ", "_") not in BROWN:
            raise ValueError(
                f"camera file {path.name} has the lens model {key} = {value!r}: wanted Brown's, k1 k2 p1 p2 "
                "k3 (plumb_bob, radtan); calibrate without another model, or with board images in softtwin"
            )
    sides = [_first(camera, keys) for keys in zip(*SIZES, strict=True)]
    both = _first(camera, BOTH_SIZES) if None in sides else sides
    try:
        size = None if both is None else (int(both[0]), int(both[1]))
        rms = float(_first(camera, RMS) or 0.0)
    except (TypeError, ValueError, OverflowError, IndexError, KeyError):
        raise ValueError(
            f"camera file {path.name}: size or error is wrong: wanted size = [width, height] and a number"
        ) from None
    matrix, lens = (_values(_first(camera, keys)) for keys in (MATRIX, LENS))
    if "intrinsics" in camera and isinstance(matrix, list) and len(matrix) == 4:  # of Kalibr
        matrix = [matrix[0], 0.0, matrix[2], 0.0, matrix[1], matrix[3], 0.0, 0.0, 1.0]
    unused = sorted(key for key in set(camera) - known if not SPEAKS_OF_LENS.search(key))
    return _Numbers(matrix, lens, size, rms, tuple(unused))


def _first(camera: Mapping[str, Any], keys: tuple[str, ...]) -> Any:
    return next((camera[key] for key in keys if key in camera), None)


def _values(value: Any) -> Any:
    """Numbers of a list, or of a matrix as OpenCV and ROS write it."""
    return value.get("data") if isinstance(value, Mapping) else value


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
