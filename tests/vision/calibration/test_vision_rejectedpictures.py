"""Board pictures that do not fit the others: left out by a rule, said with the reason, or kept and told."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.messages import saying
from vision import Camera, calibrate_camera
from vision.boards.board import BoardView
from vision.boards.chessboard import Chessboard
from vision.calibration.rejectedpictures import area, empty_corners, without_outliers
from vision.drawing import synthetic
from vision.film.picturefaults import board_edge_sd

Array = NDArray[np.float64]
BOARD = Chessboard(columns=7, rows=5, square_mm=10.0)
TRUTH = Camera(
    np.array([[500.0, 0, 161.0], [0, 500.0, 119.0], [0, 0, 1.0]]), np.array([-0.1, 0, 0, 0, 0]), (320, 240)
)


def view(x: float, y: float, side: float = 60.0) -> BoardView:
    corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    return BoardView(np.column_stack([corner * 10.0, np.zeros(4)]), corner * side + (x, y))


def told(errors: Sequence[float], views: Sequence[BoardView]) -> tuple[tuple[int, ...], int | None]:
    """Which views are dropped, where a view's error is as given and does not change by refitting."""
    rows = {id(v): e for v, e in zip(views, errors, strict=True)}
    out = without_outliers(views, lambda some: np.array([rows[id(v)] for v in some]))
    assert sorted((*out.kept, *out.dropped)) == list(range(len(views)))
    return out.dropped, out.stays


def test_the_worst_goes_first_and_never_too_many() -> None:
    views = [view(10.0 * (i % 3), 10.0 * (i % 4)) for i in range(14)]
    good = [0.1 + 0.005 * i for i in range(14)]
    assert told(good, views) == ((), None)
    assert told([*good[:12], 0.6, 0.9], views) == ((13, 12), None)
    assert told([0.01] * 13 + [0.049], views) == ((), None)  # good, however good the others are
    dropped, stays = told([*good[:9], 0.5, 0.6, 0.7, 0.8, 0.9], views)
    assert (dropped, stays) == ((13, 12, 11, 10), 9)  # 10 must be left
    assert told([*good[:9], 0.9], views[:10]) == ((), 9)


def test_a_picture_that_alone_covers_a_part_stays() -> None:
    views = [*(view(10.0, 10.0) for _ in range(12)), view(400.0, 300.0)]
    assert told([0.1] * 12 + [0.9], views) == ((), 12)


def test_corners_without_boards_are_named() -> None:
    assert empty_corners([view(0.0, 0.0), view(250.0, 170.0)], (320, 240)) == ["top right", "bottom left"]
    assert area([view(0.0, 0.0)]) == pytest.approx(3600.0)


def photograph(path: Path, number: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng(number)
    rvec = np.deg2rad([*rng.uniform(-30.0, 30.0, 2), 7.0 * number])
    place = np.array([*rng.uniform(-9.0, 9.0, 2), 230.0])
    tvec = place - cv2.Rodrigues(rvec)[0] @ BOARD.points.mean(axis=0)
    picture = synthetic.board_image(TRUTH, BOARD, (rvec, tvec), seed=number)
    cv2.imwrite(str(path), picture)
    return picture


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("views")
    files = [folder / f"b{i:02d}.png" for i in range(12)]
    for i, path in enumerate(files):
        photograph(path, i)
    return files


def waved(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture of a board that is not flat: lines off by up to 1.2 px."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]].astype(np.float32)
    shift = (x + 1.2 * np.sin(y / 25), y + 1.2 * np.sin(x / 20))
    bent = cv2.remap(picture, *shift, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(bent, dtype=np.uint8)


def test_one_bent_board_does_not_refuse_the_camera(paths: list[Path], tmp_path: Path) -> None:
    bad = tmp_path / "bad.png"
    cv2.imwrite(str(bad), waved(photograph(bad, 40)))
    clean, found = calibrate_camera(paths, BOARD), calibrate_camera([*paths, bad], BOARD)
    assert found.images == 12
    np.testing.assert_allclose(found.parameters, clean.parameters, rtol=1e-9)
    assert not any("left out" in remark for remark in clean.remarks)
    (said,) = (remark for remark in found.remarks if "left out" in remark)
    assert said.startswith("bad.png was left out of 13 board pictures: its corners fit to ")
    assert "as sharp as the others, so the board was bent" in said


def test_with_too_few_others_it_is_said_what_to_photograph(paths: list[Path], tmp_path: Path) -> None:
    bad = tmp_path / "bad.png"
    cv2.imwrite(str(bad), waved(photograph(bad, 40)))
    with pytest.raises(ValueError, match=saying(r"bad\.png", "3")):
        calibrate_camera([*paths[:8], bad], BOARD)


def test_width_of_edges(paths: list[Path]) -> None:
    picture = np.asarray(cv2.imread(str(paths[0]), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    seen = BOARD.find(picture)
    sharp = board_edge_sd(picture, seen.points, seen.pixels)
    assert sharp == pytest.approx(0.85, abs=0.4)  # drawn with 0.8 px and the pixel's own 0.29
    motion = np.full((1, 9), 1.0 / 9.0)  # a box of 9 px has an sd of 2.6 px, along one direction alone
    for kernel in (motion, motion.T):
        smeared = np.asarray(cv2.filter2D(picture, -1, kernel), dtype=np.uint8)
        assert board_edge_sd(smeared, seen.points, seen.pixels) > 2.0 * sharp
