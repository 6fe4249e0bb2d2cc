"""Cameras of other programs read in: the numbers, and one sentence for what is wrong."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from vision.calibration.camerafile import read_camera
from vision.dictionaries import dictionary_of

MATRIX = np.array([[910.0, 0.0, 640.5], [0.0, 912.0, 355.0], [0.0, 0.0, 1.0]])
LENS = np.array([-0.2, 0.05, 1e-3, -2e-3, 0.01])
SIZE = (1280, 720)
ROS = """image_width: 1280
image_height: 720
camera_name: side
camera_matrix:
  rows: 3
  cols: 3
  data: [910.0, 0.0, 640.5, 0.0, 912.0, 355.0, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.2, 0.05, 0.001, -0.002, 0.01]
"""
CALISCOPE = """[cameras.0]
size = [640, 480]
matrix = [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1]]
distortions = [0, 0, 0, 0, 0]
[cameras.1]
size = [1280, 720]
error = 0.4
matrix = [[910.0, 0.0, 640.5], [0.0, 912.0, 355.0], [0.0, 0.0, 1.0]]
distortions = [-0.2, 0.05, 0.001, -0.002, 0.01]
"""


def written(path: Path, lens: np.ndarray, size: tuple[int, int] | None = SIZE) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    if size is not None:
        storage.write("image_width", size[0])
        storage.write("image_height", size[1])
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", lens)
    storage.write("avg_reprojection_error", 0.21)
    storage.release()
    return path


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
@pytest.mark.parametrize("size", [SIZE, None])
def test_what_opencv_writes(tmp_path: Path, suffix: str, size: tuple[int, int] | None) -> None:
    camera = read_camera(written(tmp_path / f"camera.{suffix}", LENS, size), name="side", size=SIZE)
    np.testing.assert_allclose(camera.matrix, MATRIX)
    np.testing.assert_allclose(camera.distortion, LENS)
    assert (camera.size, camera.rms_px, camera.images) == (SIZE, pytest.approx(0.21), 0)
    assert not camera.covariance.any()
    assert "does not say how well the camera is known" in camera.remarks[0]


def test_ros_and_caliscope(tmp_path: Path) -> None:
    (tmp_path / "ros.yaml").write_text(ROS)
    (tmp_path / "array.toml").write_text(CALISCOPE)
    for path, name in (("ros.yaml", "side"), ("array.toml", "cam_1"), ("array.toml", "1")):
        camera = read_camera(tmp_path / path, name=name, size=SIZE)
        np.testing.assert_allclose(camera.matrix, MATRIX)
        np.testing.assert_allclose(camera.distortion, LENS)


def test_fewer_terms_are_zeros_and_trailing_zeros_are_nothing(tmp_path: Path) -> None:
    four = read_camera(written(tmp_path / "four.yml", LENS[:4]), name="side", size=SIZE)
    np.testing.assert_allclose(four.distortion, [*LENS[:4], 0.0])
    assert four.model == ("k1", "k2", "p1", "p2")
    longer = np.concatenate([LENS, np.zeros(3)])
    np.testing.assert_allclose(
        read_camera(written(tmp_path / "8.yml", longer), name="side", size=SIZE).distortion, LENS
    )


def test_real_files(shared_data: Path) -> None:
    path = shared_data / "opencv_boards" / "tutorial_camera_params.yml"
    camera = read_camera(path, name="side", size=(640, 480))
    assert camera.matrix[0, 0] == pytest.approx(628.158)
    assert camera.distortion[2] == pytest.approx(0.00754589)
    array = shared_data / "charuco_4cam" / "camera_array.toml"
    assert read_camera(array, name="cam_2", size=SIZE).matrix[0, 0] == pytest.approx(650.8019, abs=1e-4)


def test_bad_files(tmp_path: Path) -> None:
    def refused(path: Path, sentence: str, *, size: tuple[int, int] = SIZE) -> None:
        with pytest.raises(ValueError, match=sentence):
            read_camera(path, name="side", size=size)

    refused(tmp_path / "absent.yml", "does not exist: give an OpenCV YAML, XML or caliscope TOML")
    refused(written(tmp_path / "a.yml", LENS), r"is for \(1280, 720\) px, the film has", size=(640, 480))
    (tmp_path / "far.yaml").write_text(ROS.replace("910.0", "1.0e+9").replace("912.0", "1.0e+9"))
    refused(tmp_path / "far.yaml", r"has the focal length 1e\+09 px, wanted less than 1000 times its 1280 px")
    refused(written(tmp_path / "b.yml", np.full(8, 0.1)), "8 distortion terms, wanted k1 k2 p1 p2 k3 alone")
    for name, text, sentence in (
        ("c.yml", "%YAML:1.0\n---\nimage_width: 1280\n", "no camera matrix of 9 numbers"),
        ("d.yml", "%YAML:1.0\n---\nK: [1., 0., 0., 0., 1., 0., 0., 0., 1.]\n", "has no distortion"),
        ("e.toml", CALISCOPE, "holds the cameras 0, 1, wanted 'side'"),
        ("f.toml", "[cameras", "is no TOML"),
        ("g.xml", "<nothing", "cannot be read as YAML, XML or JSON|no camera matrix"),
    ):
        (tmp_path / name).write_text(text)
        refused(tmp_path / name, sentence)


KALIBR = """cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.2, 0.05, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [910.0, 912.0, 640.5, 355.0]
  resolution: [1280, 720]
  rostopic: /cam0/image_raw
"""
ANIPOSE = """[cam_0]
name = "side"
size = [1280, 720]
matrix = [[910.0, 0.0, 640.5], [0.0, 912.0, 355.0], [0.0, 0.0, 1.0]]
distortions = [-0.2, 0.05, 0.001, -0.002]
fisheye = false
rotation = [0.0, 0.0, 0.0]

[metadata]
error = 0.4
"""


def test_kalibr_and_anipose(tmp_path: Path) -> None:
    (tmp_path / "camchain.yaml").write_text(KALIBR)
    (tmp_path / "calibration.toml").write_text(ANIPOSE)
    for name in ("camchain.yaml", "calibration.toml"):
        camera = read_camera(tmp_path / name, name="side", size=SIZE)
        np.testing.assert_allclose(camera.matrix, MATRIX)
        np.testing.assert_allclose(camera.distortion, [*LENS[:4], 0.0])
        assert len(camera.remarks) == 1


@pytest.mark.parametrize(
    ("text", "suffix", "named"),
    [
        (ROS.replace("plumb_bob", "equidistant"), "yaml", "distortion_model = 'equidistant'"),
        (ROS.replace("camera_name: side", "fisheye_model: 1"), "yaml", "fisheye_model = '1'"),
        (ROS.replace("camera_name: side", "xi: 0.8"), "yaml", "xi = '0.8'"),
        (ROS.replace("camera_name: side", "type: fisheye"), "yaml", "type = 'fisheye'"),
        (ANIPOSE.replace("fisheye = false", "fisheye = true"), "toml", "fisheye = 'True'"),
        ("fisheye = true\n" + ANIPOSE.replace("fisheye = false\n", ""), "toml", "fisheye = 'True'"),
        (KALIBR.replace("radtan", "equidistant"), "yaml", "distortion_model = 'equidistant'"),
        (KALIBR.replace("pinhole", "omni"), "yaml", "camera_model = 'omni'"),
    ],
)
def test_another_lens_model_is_refused_by_name(text: str, suffix: str, named: str, tmp_path: Path) -> None:
    (tmp_path / f"lens.{suffix}").write_text(text)
    with pytest.raises(ValueError, match=f"has the lens model {named}: wanted Brown's"):
        read_camera(tmp_path / f"lens.{suffix}", name="side", size=SIZE)


def test_a_key_that_is_not_known_is_told(tmp_path: Path) -> None:
    (tmp_path / "ros.yaml").write_text(ROS.replace("camera_name: side", "binning: 2"))
    camera = read_camera(tmp_path / "ros.yaml", name="side", size=SIZE)
    assert "has keys that are not used: binning" in camera.remarks[1]


DEEP = 100_000
BOMBS = [
    ("yml", "%YAML:1.0\n---\na: " + DEEP * "["), ("yml", "%YAML:1.0\n---\na: " + DEEP * "{a:"),
    ("yaml", "%YAML:1.0\n---\na:\n " + DEEP * "- "), ("json", '{"a":' + DEEP * "["),
    ("json", DEEP * '{"a":'), ("xml", '<?xml version="1.0"?>\n<opencv_storage>\n' + DEEP * "<a>"),
    ("toml", "a = " + DEEP * "["), ("toml", ".".join(DEEP * ["a"]) + " = 1"),
]  # fmt: skip


@pytest.mark.parametrize(("suffix", "text"), BOMBS)
def test_files_that_kill_a_parser_are_refused(suffix: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / f"deep.{suffix}"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"brackets or tags more than 32 deep|a key of more than 32 parts"):
        read_camera(path, name="side", size=SIZE)
    if suffix != "toml":
        with pytest.raises(ValueError, match=r"marker dictionary .* brackets or tags more than 32 deep"):
            dictionary_of(str(path))


def test_a_pipe_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "lens.yml")
    with pytest.raises(ValueError, match=r"is no file|does not exist"):
        read_camera(tmp_path / "lens.yml", name="side", size=SIZE)
    with pytest.raises(ValueError, match="is no file"):
        dictionary_of(str(tmp_path / "lens.yml"))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("markersize: 4", "markersize: -4", "markersize = -4; wanted 3 to 16"),
        ("markersize: 4", "markersize: 5", "marker_0 = '1011010101001101'; wanted 25 bits"),
        ("1011010101001101", "zzzz010101001101", "marker_0 = 'zzzz010101001101'; wanted 16 bits"),
        ('"1011010101001101"', "[1, 0]", r"marker_0 = '\[1, 0\]'; wanted 16 bits"),
        ("Bits: 1", "Bits: 2147483647", "maxCorrectionBits = 2147483647; wanted 0 to 8"),
        ("nmarkers: 2", "nmarkers: 3", "marker_2 = 'None'; wanted 16 bits"),
    ],
)
def test_dictionaries_of_impossible_bits_are_refused(old: str, new: str, sentence: str, tmp_path: Path) -> None:
    right = (Path(__file__).parents[2] / "corpora" / "cameras" / "dictionary.yml").read_text()
    path = tmp_path / "dictionary.yml"
    path.write_text(right)
    assert dictionary_of(str(path)).bytesList.shape == (2, 2, 4)
    path = tmp_path / "wrong.yml"
    path.write_text(right.replace(old, new))
    with pytest.raises(ValueError, match=sentence):
        dictionary_of(str(path))
