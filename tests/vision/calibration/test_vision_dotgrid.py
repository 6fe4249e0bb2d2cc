"""Boards of circles of which a picture shows a part: the grid is walked, coding dots tell which part."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.messages import saying
from tests.strangers.right import CODED, LargerDots
from vision import Camera, calibrate_camera
from vision.boards.board import Board
from vision.boards.circles import AsymmetricCircleBoard, CircleBoard
from vision.boards.dotgrid import walk
from vision.calibration.stereo import _photographed, calibrate_rig
from vision.drawing import synthetic

Array = NDArray[np.float64]
TRUTH = Camera(
    np.array([[900.0, 0, 322.0], [0, 902.0, 238.0], [0, 0, 1.0]]),
    np.array([-0.15, 0.06, 0, 0, 0]),
    (640, 480),
)


def pose(board: Board, i: int, away: float = 120.0) -> tuple[Array, Array]:
    """A board that reaches beyond the picture, tilted and turned by up to 170 degrees."""
    rvec = np.deg2rad(
        [[25, 0], [-25, 5], [0, 28], [5, -28], [20, 20], [-20, 18], [18, -22], [-24, -20]][i % 8]
    )
    turned = (
        cv2.Rodrigues(np.array([*rvec, 0.0]))[0] @ cv2.Rodrigues(np.array([0, 0, np.deg2rad(24.0 * i)]))[0]
    )
    target = np.array([52.0, 36.0, 0.0])  # the middle of the coding dots
    shift = np.array([4.0 * np.sin(i), 3.0 * np.cos(2 * i), away]) - turned @ target
    return np.ravel(cv2.Rodrigues(turned)[0]), shift


def projected(board_points: Array, at: tuple[Array, Array]) -> Array:
    pixels, _ = cv2.projectPoints(board_points, *at, TRUTH.matrix, TRUTH.distortion)
    return np.asarray(pixels[:, 0])


@pytest.mark.parametrize("drawn", [CODED, LargerDots()], ids=["rings", "larger"])
def test_a_part_of_a_coded_board_is_found_with_its_rows_and_columns(drawn: Any) -> None:
    for i in range(7):
        at = pose(CODED, i)
        seen = CODED.find(synthetic.board_image(TRUTH, drawn, at, seed=i))
        assert 50 < len(seen) < 140  # the picture cuts the board
        # perspective shifts ellipses; a step is 60 px
        assert np.abs(seen.pixels - projected(seen.points, at)).max() < 0.5
        inside = projected(CODED.points, at)
        margin = 26.0  # px, radius of a circle and more
        whole = np.all((inside > margin) & (inside < np.array(TRUTH.size) - margin), axis=1).sum()
        assert len(seen) >= 0.9 * whole


def test_without_all_coding_dots_nothing_is_found() -> None:
    picture = synthetic.board_image(TRUTH, CODED, pose(CODED, 0), seed=0)
    ring = projected(np.array([[32.0, 24.0, 0.0]]), pose(CODED, 0))[0]
    cv2.circle(picture, [round(v) for v in ring.tolist()], 16, (35.0,), -1)  # a ring filled in
    assert len(CODED.find(picture)) == 0


def test_coding_dots_that_do_not_tell_are_refused() -> None:
    with pytest.raises(ValueError, match=saying(r"coding = \[\[4, 3\]", r"\[20, 3\]", r"\[4, 6\]\]")):
        replace(CODED, coding=((4, 3), (20, 3), (4, 6)))
    with pytest.raises(ValueError, match=r"looks the same when the board is turned"):
        replace(CODED, coding=((2, 2), (4, 2), (6, 2)))


@pytest.mark.slow
def test_a_camera_and_a_rig_from_parts_of_a_coded_board(tmp_path: Path) -> None:
    paths: list[list[Path]] = [[], []]
    second = cv2.Rodrigues(np.array([0.0, 0.25, 0.0]))[0], np.array([-30.0, 1.0, 4.0])
    for i in range(8):
        rvec, tvec = pose(CODED, i, 150.0)
        turn = cv2.Rodrigues(rvec)[0]
        both = ((rvec, tvec), (np.ravel(cv2.Rodrigues(second[0] @ turn)[0]), second[0] @ tvec + second[1]))
        for c, at in enumerate(both):
            (tmp_path / str(c)).mkdir(exist_ok=True)
            paths[c].append(tmp_path / str(c) / f"b{i}.png")
            cv2.imwrite(str(paths[c][-1]), synthetic.board_image(TRUTH, CODED, at, seed=2 * i + c))
    cameras = [calibrate_camera(own, CODED) for own in paths]
    for camera in cameras:
        assert camera.images >= 6
        assert camera.rms_px < 0.06
        assert np.all(np.abs(camera.parameters - TRUTH.parameters)[:4] < 4.0 * camera.stdevs[:4])
    rig = calibrate_rig(paths, CODED, cameras)
    assert rig.shift[1] == pytest.approx(second[1], abs=0.3)
    assert rig.turn[1] == pytest.approx([0.0, 0.25, 0.0], abs=0.003)


def test_circles_of_a_rig_are_centred_on_the_board(tmp_path: Path) -> None:
    at = pose(CODED, 0)
    cv2.imwrite(str(tmp_path / "b.png"), synthetic.board_image(TRUTH, CODED, at, seed=0))
    (shot,) = _photographed([[tmp_path / "b.png"]], ["b.png"], CODED, (), [TRUTH])
    error = np.abs(shot.pixels - projected(shot.points, at))
    assert error.max() < 0.05  # perspective shifts the centres of these ellipses by up to 0.3 px


@pytest.mark.slow
@pytest.mark.parametrize(
    "board",
    [
        CircleBoard(columns=14, rows=10, square_mm=8.0),
        AsymmetricCircleBoard(columns=7, rows=14, square_mm=6.0),
    ],
    ids=["circles", "acircles"],
)
def test_a_part_of_a_plain_board_calibrates_one_camera(board: CircleBoard, tmp_path: Path) -> None:
    paths = []
    for i in range(7):
        at = pose(board, i, 105.0)
        paths.append(tmp_path / f"{i}.png")
        cv2.imwrite(str(paths[-1]), synthetic.board_image(TRUTH, board, at, seed=i))
    camera = calibrate_camera(paths, board)
    assert camera.images >= 6
    assert camera.rms_px < 0.06
    assert np.all(np.abs(camera.parameters - TRUTH.parameters)[:4] < 4.5 * camera.stdevs[:4])


def test_a_walk_knows_perspective_and_leaves_out_what_is_no_grid() -> None:
    column, row = np.meshgrid(np.arange(9.0), np.arange(7.0))
    x, y = column.ravel() - 3.0, row.ravel() - 2.0
    grid = (300.0, 200.0) + np.column_stack([30 * x + 4 * y, -3 * x + 25 * y]) / (1 + 0.04 * x[:, None])
    stray = np.array([[313.0, 214.0], [90.0, 30.0], [600.0, 400.0]])
    rows, step = walk(np.concatenate([grid, stray]))
    assert set(rows.tolist()) == set(range(63))
    step = step - step.min(axis=0)
    assert step.max(axis=0).tolist() in ([8, 6], [6, 8])
    assert len(walk(grid[:3])[0]) == 0
    assert len(walk(np.random.default_rng(0).uniform(0, 400, (30, 2)))[0]) < 12


def test_the_sheet_to_print_has_the_rings() -> None:
    art, scale = CODED.artwork(), 8
    sheet = np.full((round(art.height * scale), round(art.width * scale)), 255, dtype=np.uint8)
    for layer in art.layers:
        for x, y, radius in layer.circles * scale:
            at = (round(16 * (x - 0.5)), round(16 * (y - 0.5)))
            cv2.circle(sheet, at, round(16 * radius), 0 if layer.black else 255, -1, cv2.LINE_AA, 4)
    seen = CODED.find(sheet)
    assert len(seen) == 140
    np.testing.assert_allclose(seen.pixels, (seen.points[:, :2] + 8.0) * scale - 0.5, atol=0.05)


def test_a_walk_along_diagonals_is_understood() -> None:
    row, column = np.divmod(np.arange(140), 14)
    place, marked = np.column_stack([column, row]), np.zeros(140, dtype=bool)
    marked[[14 * r + c for c, r in CODED.coding]] = True
    for steps in ([[1, 0], [0, 1]], [[1, 1], [0, 1]], [[0, -1], [1, 1]]):
        found = CODED._placed((place - (5, 4)) @ np.array(steps), marked)
        assert found is not None
        np.testing.assert_array_equal(found, place)
    assert CODED._placed(place, marked | np.roll(marked, 1)) is None  # six that fit in two ways
    assert CODED._placed(place, np.roll(marked, 4)) is None  # four columns would lie beside the board
