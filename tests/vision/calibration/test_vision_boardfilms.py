"""Cameras from films of a board that is moved: which frames are taken, and what they give."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.messages import saying
from vision import Camera, Video
from vision.boards.board import BoardView
from vision.boards.charuco import CharucoBoard
from vision.calibration.boardfilms import BoardFilm, _frames, camera_of_film, chosen
from vision.drawing import synthetic
from vision.film.video import Writer

Array = NDArray[np.float64]
BOARD = CharucoBoard(columns=7, rows=5, square_mm=12.0, marker_mm=9.0, dictionary="DICT_5X5_50")
TRUTH = Camera(
    np.array([[450.0, 0, 161.0], [0, 451.0, 119.0], [0, 0, 1.0]]), np.array([-0.12, 0, 0, 0, 0]), (320, 240)
)


def pose(t: float) -> tuple[Array, Array]:
    """The board at time t: it turns and wanders, and rests twice a second."""
    slow = t + np.sin(4.0 * np.pi * t) / (4.0 * np.pi)
    rvec = np.array([0.5 * np.sin(2.1 * slow), 0.5 * np.cos(1.7 * slow), 0.2 * slow])
    place = np.array([12.0 * np.sin(1.3 * slow), 9.0 * np.cos(2.3 * slow), 150.0 + 12.0 * np.sin(slow)])
    return rvec, place - cv2.Rodrigues(rvec)[0] @ np.array([42.0, 30.0, 0.0])


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Video:
    path = tmp_path_factory.mktemp("boards") / "boards.mkv"
    with Writer(path, TRUTH.size, fps=8.0, codec="rawvideo") as writer:
        for i in range(40):
            picture = synthetic.board_image(TRUTH, BOARD, pose(i / 8.0), seed=i)
            if i % 5 == 3:  # moved while it was exposed
                picture = np.asarray(cv2.blur(picture, (7, 1)), dtype=np.uint8)
            writer.add(picture)
    return Video(path)


def test_a_film_of_a_moving_board_gives_the_camera(film: Video) -> None:
    camera = camera_of_film(film, BOARD)
    assert camera.rms_px < 0.1
    found = camera.parameters[:4] - TRUTH.parameters[:4]
    assert np.all(np.abs(found / camera.stdevs[:4]) < 4.0)
    assert camera.stdevs[0] < 4.0
    taken = camera.notes[0]
    assert "frames of boards.mkv that show the board were taken, sharp and in poses" in taken
    assert "40 of 40 frames were looked at" in taken


def test_a_film_without_the_board_says_what_it_shows(film: Video) -> None:
    other = CharucoBoard(columns=7, rows=5, square_mm=12.0, marker_mm=9.0, dictionary="DICT_4X4_50")
    with pytest.raises(ValueError, match=saying("0", "40", r"boards\.mkv", "DICT_5X5_50")):
        camera_of_film(film, other)


def shown(x: Array, blur: Array) -> BoardFilm:
    """A film of a flat board of 9 points, shifted by x (t) px and as blurred as told."""
    grid = np.stack(np.meshgrid([0.0, 1, 2], [0.0, 1, 2]), axis=-1).reshape(-1, 2)
    board = np.column_stack([10.0 * grid, np.zeros(9)])
    views = tuple(BoardView(board, 100.0 + 20.0 * grid + (shift, 0.0)) for shift in x)
    return BoardFilm(Path("drawn"), np.arange(len(x)) / 10.0, (640, 480), views, blur, len(x))


def test_frames_are_sharp_slow_and_unlike() -> None:
    x = np.repeat(np.linspace(0.0, 400.0, 60), 3)  # three alike at each of sixty places
    blur = np.ones(180)
    blur[::3] = 2.0
    rows = chosen(shown(x, blur))
    assert len(rows) == 30
    assert not any(row % 3 == 0 for row in rows)  # blurred
    places = np.sort(x[rows])
    assert places[0] == 0.0
    assert places[-1] == 400.0
    assert np.diff(places).max() < 30.0  # spread over all of the picture
    fast = np.where(np.arange(60) % 2, 0.0, 60.0)
    fast[30:] = np.linspace(200.0, 210.0, 30)
    assert min(chosen(shown(fast, np.ones(60)))) >= 30  # the first half jumps by 60 px a frame


def test_of_long_films_the_same_moments_are_looked_at() -> None:
    times = [np.arange(3000) / 30.0, 0.4 + np.arange(3000) / 30.0 + 0.01]
    rows = _frames(times)
    assert all(300 < len(r) < 700 for r in rows)
    seen = [t[r] for t, r in zip(times, rows, strict=True)]
    near = np.abs(seen[0][:, None] - seen[1]).min(axis=1)
    assert np.mean(near < 1.0 / 30.0) > 0.9
    assert [len(r) for r in _frames([t[:400] for t in times])] == [400, 400]
