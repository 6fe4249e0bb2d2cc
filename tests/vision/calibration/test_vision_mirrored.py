"""Boards and films that are mirrored: found as stated, told where not."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from vision import Camera, Video, calibrate_camera
from vision.boards.board import Board, flipped
from vision.boards.charuco import CharucoBoard
from vision.drawing import synthetic
from vision.film.series import Pictures
from vision.film.video import Writer
from vision.following.reference import prepare

BOARD = CharucoBoard(columns=7, rows=5, square_mm=12.0, marker_mm=9.0, dictionary="DICT_5X5_50")
MIRRORED = replace(BOARD, mirrored=True)
TRUTH = Camera(
    np.array([[460.0, 0, 166.0], [0, 460.0, 117.0], [0, 0, 1.0]]), np.array([-0.1, 0, 0, 0, 0]), (320, 240)
)
TILTS = [(25, 0), (-25, 5), (0, 28), (5, -28), (20, 20), (-20, 18), (18, -22)]


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder, files = tmp_path_factory.mktemp("mirror"), []
    for i, tilt in enumerate(TILTS):
        rvec = np.deg2rad([*tilt, 5.0 * i])
        place = np.array([3.0 * np.sin(i), 3.0 * np.cos(2 * i), 165.0])
        tvec = place - cv2.Rodrigues(rvec)[0] @ np.array([42.0, 30.0, 0.0])
        files.append(folder / f"{i}.png")
        cv2.imwrite(str(files[-1]), flipped(synthetic.board_image(TRUTH, BOARD, (rvec, tvec), seed=i)))
    return files


def test_a_mirrored_board_is_told(paths: list[Path]) -> None:
    with pytest.raises(
        ValueError, match=r"and \d+ in the mirrored pictures: set mirrored = true \(false where it is"
    ):
        calibrate_camera(paths, BOARD)
    with pytest.raises(ValueError, match=r"in the inverted and mirrored pictures: set inverted = true"):
        calibrate_camera(paths, replace(BOARD, inverted=True))


def test_a_camera_that_looks_into_a_mirror(paths: list[Path]) -> None:
    camera = calibrate_camera(paths, BOARD, mirrored=True)
    assert camera.images == len(TILTS)
    assert np.all(np.abs(camera.parameters - TRUTH.parameters)[:4] < 4.0 * camera.stdevs[:4])


def test_a_board_that_is_printed_mirrored(paths: list[Path]) -> None:
    camera = calibrate_camera(paths, MIRRORED)  # the camera is not: its centre is that of the files
    assert camera.images == len(TILTS)
    expected = [460.0, 460.0, 319.0 - 166.0, 117.0]
    assert np.all(np.abs(camera.parameters[:4] - expected) < 4.0 * camera.stdevs[:4])
    assert camera.matrix[0, 2] < 159.0


def test_points_of_a_mirrored_board_keep_their_hand(paths: list[Path]) -> None:
    picture = np.asarray(cv2.imread(str(paths[0]), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    seen, plain = MIRRORED.find(picture), BOARD.find(flipped(picture))
    np.testing.assert_allclose(seen.pixels[:, 0], 319.0 - plain.pixels[:, 0])
    np.testing.assert_allclose(seen.points[:, 0], -plain.points[:, 0])
    assert Board.of("charuco", mirrored=True, columns=7, rows=5, square_mm=12.0, marker_mm=9.0).mirrored


def test_a_mirrored_film_is_told_and_read(lab: Any, tmp_path: Path) -> None:
    film = lab.film(tmp_path / "rest.mkv", np.zeros(12), seed=3)
    with Writer(
        tmp_path / "mirror.mkv", (film.width, film.height), fps=10.0, codec="rawvideo", crf=0
    ) as writer:
        for i, _, grey in film.frames():
            writer.add(flipped(grey))
            cv2.imwrite(str(tmp_path / f"f{i:03d}.png"), flipped(grey))
    told = {"dictionary": "DICT_4X4_50", "reference_s": 1.15}
    with pytest.raises(
        ValueError, match=r"but 1\d when its pictures .* set mirrored = true in \[\[cameras\]\]"
    ):
        prepare(Video(tmp_path / "mirror.mkv"), lab.camera, lab.marks, **told)
    plain = prepare(film, lab.camera, lab.marks, **told)
    for again in (
        Video(tmp_path / "mirror.mkv", mirrored=True),
        Pictures(tmp_path / "f*.png", fps=10.0, mirrored=True),
    ):
        np.testing.assert_array_equal(prepare(again, lab.camera, lab.marks, **told).seed, plain.seed)
