"""ChArUco pictures in, camera out."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.messages import saying
from vision import Board, Camera, calibrate_camera
from vision.boards.charuco import CharucoBoard
from vision.drawing import synthetic

BOARD = CharucoBoard(columns=7, rows=5, square_mm=12.0, marker_mm=9.0, dictionary="DICT_5X5_50")
TRUTH = Camera(
    np.array([[900.0, 0, 322.0], [0, 902.0, 238.0], [0, 0, 1.0]]),
    np.array([-0.15, 0.06, 0.0006, -0.0004, 0.0]),
    (640, 480),
)
TILTS = [(25, 0), (-25, 5), (0, 28), (5, -28), (20, 20), (-20, 18), (18, -22), (0, 0)]


def pictures(folder: Path, board: Board, tilts: Sequence[tuple[float, float]]) -> list[Path]:
    paths = []
    for i, (a, b) in enumerate(tilts):
        rvec = np.deg2rad([a, b, 4.0 * i])
        middle = np.array([board.columns, board.rows, 0.0]) * board.square_mm / 2.0
        tvec = (
            np.array([6.0 * np.sin(i), 5.0 * np.cos(2 * i), 130.0 + 3 * i]) - cv2.Rodrigues(rvec)[0] @ middle
        )
        picture = synthetic.board_image(TRUTH, board, (rvec, tvec), seed=i)
        paths.append(folder / f"board{i}.png")
        cv2.imwrite(str(paths[-1]), picture)
    return paths


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return pictures(tmp_path_factory.mktemp("boards"), BOARD, TILTS)


def test_camera_is_recovered_within_its_own_sd(drawn: list[Path]) -> None:
    camera = calibrate_camera(drawn, BOARD)
    assert camera.images == len(TILTS)
    assert camera.size == (640, 480)
    assert camera.rms_px < 0.1  # corners of drawn boards scatter by some 0.03 px
    found = np.array([camera.matrix[0, 0], camera.matrix[1, 1], camera.matrix[0, 2], camera.matrix[1, 2]])
    pull = (found - [900.0, 902.0, 322.0, 238.0]) / camera.stdevs[:4]
    assert np.all(np.abs(pull) < 4.0)  # four numbers at 4 sd: false once in 4000
    assert camera.stdevs[0] < 2.0


def test_the_same_pictures_give_the_same_bits(drawn: list[Path]) -> None:
    # by four threads, which add up in another order each time, the focal length has another last digit
    before = cv2.getNumThreads()
    cv2.setNumThreads(4)
    try:
        found = [json.dumps(calibrate_camera(drawn, BOARD).to_dict()) for _ in range(4)]
        assert cv2.getNumThreads() == 4
    finally:
        cv2.setNumThreads(before)
    assert len(set(found)) == 1


def test_camera_makes_a_json_round_trip(drawn: list[Path]) -> None:
    camera = calibrate_camera(drawn, BOARD)
    again = Camera.from_dict(json.loads(json.dumps(camera.to_dict())))
    np.testing.assert_array_equal(again.matrix, camera.matrix)
    np.testing.assert_array_equal(again.stdevs, camera.stdevs)
    assert (again.size, again.rms_px, again.images) == (camera.size, camera.rms_px, camera.images)


def test_distortion_is_opencvs_and_undone() -> None:
    pixels = np.random.default_rng(0).uniform((0, 0), TRUTH.size, (50, 2))
    ideal = TRUTH.undistort(pixels)
    np.testing.assert_allclose(TRUTH.distort(ideal), pixels, atol=1e-8)
    rays = np.column_stack([(ideal - TRUTH.matrix[:2, 2]) / [900.0, 902.0], np.ones(50)])
    projected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), TRUTH.matrix, TRUTH.distortion)
    np.testing.assert_allclose(projected[:, 0], pixels, atol=1e-8)
    assert np.isnan(TRUTH.undistort(np.array([[np.nan, np.nan]]))).all()


def test_inverted_board(tmp_path: Path) -> None:
    board = replace(BOARD, inverted=True)
    paths = pictures(tmp_path, board, TILTS[:6])
    assert calibrate_camera(paths, board).images == 6
    with pytest.raises(ValueError, match="set inverted"):
        calibrate_camera(paths, BOARD)


def test_a_limit_on_the_reprojection_error(drawn: list[Path]) -> None:
    with pytest.raises(
        ValueError, match=r"reprojection error .* wanted at most 0.001 px; board\d.png is worst"
    ):
        calibrate_camera(drawn, BOARD, max_rms_px=0.001)


@pytest.mark.slow
def test_the_dictionary_that_would_fit_is_named(drawn: list[Path]) -> None:
    with pytest.raises(ValueError, match=saying("DICT_4X4_50", "0", "DICT_5X5_50")):
        calibrate_camera(drawn, replace(BOARD, dictionary="DICT_4X4_50"))


def test_too_few_or_missing_or_unlike_pictures(drawn: list[Path], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no board images"):
        calibrate_camera([], BOARD)
    with pytest.raises(ValueError, match="5 of 5 board images"):
        calibrate_camera(drawn[:5], BOARD)
    with pytest.raises(ValueError, match=r"absent\.png is missing"):
        calibrate_camera([*drawn, tmp_path / "absent.png"], BOARD)
    cv2.imwrite(str(tmp_path / "small.png"), np.full((240, 320), 128, dtype=np.uint8))
    with pytest.raises(ValueError, match="differ in size"):
        calibrate_camera([*drawn, tmp_path / "small.png"], BOARD)


def test_untilted_boards_do_not_tell_the_focal_length(tmp_path: Path) -> None:
    paths = pictures(tmp_path, BOARD, [(0.0, 0.0)] * 6)
    with pytest.raises(ValueError, match="focal length stays unknown"):
        calibrate_camera(paths, BOARD)


def test_unknown_dictionary(drawn: list[Path]) -> None:
    with pytest.raises(ValueError, match="'DICT_9X9' is not known"):
        calibrate_camera(drawn, replace(BOARD, dictionary="DICT_9X9"))
