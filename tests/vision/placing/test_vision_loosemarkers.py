"""Loose markers beside a board: places and their stated errors, by simulated and by drawn pictures."""

import cv2
import numpy as np
import pytest

from vision import Board, Camera, Mark
from vision.boards.board import BoardView
from vision.drawing import synthetic
from vision.kinds import CodedMarker
from vision.placing.loosemarkers import RigPicture, adjusted, loose_markers

BOARD = Board.of(columns=8, rows=6, square_mm=12.0, marker_mm=9.0, kind="charuco")
MATRIX = np.array([[2400.0, 0, 634], [0, 2405.0, 484], [0, 0, 1]])
CAMERA = Camera(MATRIX, np.array([-0.12, 0.05, 0.0, 0.0, 0.0]), (1280, 960), model=("k1", "k2"))
CODES = np.array([30, 31, 32, 33, 34, 35, 36, 37, 38, 39])
# around the board, in its axes: x right, y down, z away; not all in one plane
PLACES = np.array([
    (-45, -50, 0), (45, -52, 1), (140, -50, 0), (-48, 30, 3), (145, 35, -4), (-45, 115, 0), (10, 118, 0),
    (60, 120, 2), (100, 117, 0), (141, 115, 0),
], dtype=float)  # fmt: skip


def poses(count, rng):
    """Looks from all sides on the middle of the board, (turn, shift) from its axes to the camera's."""
    for k in range(count):
        lean = np.deg2rad(rng.uniform(20, 40)) * np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0.0])
        turn = cv2.Rodrigues(lean)[0] @ cv2.Rodrigues(np.array([0, 0, rng.uniform(-0.4, 0.4)]))[0]
        middle = np.array([rng.uniform(-25, 25), rng.uniform(-18, 18), rng.uniform(620, 700)])
        yield turn, middle - turn @ np.array([48.0, 36.0, 0.0])


def seen(points, turn, shift):
    pixels, _ = cv2.projectPoints(points, cv2.Rodrigues(turn)[0], shift, MATRIX, CAMERA.distortion)
    return np.asarray(pixels).reshape(-1, 2)


def pulls(found):
    """Errors of the places over their sds, whitened by the whole covariance."""
    off = (found.place - PLACES[np.searchsorted(CODES, found.codes)]).ravel()
    return np.linalg.solve(np.linalg.cholesky(found.covariance), off)


def simulated(seed, *, stated=0.02, true=0.02):
    rng = np.random.default_rng(seed)
    points, sights = BOARD.points, []
    for turn, shift in poses(10, rng):
        corners = seen(points, turn, shift) + rng.normal(0, 0.05, (len(points), 2))
        centres = seen(PLACES, turn, shift) + rng.normal(0, true, (len(CODES), 2))
        cov = np.tile(stated**2 * np.eye(2), (len(CODES), 1, 1))
        sights.append(RigPicture(BoardView(points, corners), CODES, centres, cov))
    start = CAMERA.moved(np.array([15.0, 12.0, -4.0, 3.0, 0.02, 0.0, 0.0, 0.0, 0.0]))
    return sights, start


def test_places_have_the_errors_that_are_stated():
    found = [adjusted(*simulated(seed, stated=0.05)) for seed in range(12)]  # a stated sd 2.5 times too large
    size = np.sqrt(np.mean(np.square([pulls(f) for f in found])))
    assert 0.8 < size < 1.05  # 360 values: 1 sd is 4 %; the factor of shared errors is 1 at least
    sd = np.sqrt(np.diag(found[0].covariance)).reshape(-1, 3)
    assert sd[:, :2].max() < 0.05  # mm in the plane


def test_a_marker_taken_for_another_is_left_out():
    sights, start = simulated(3)
    clean = adjusted(sights, start)
    sights[4].centre[2] += 6.0  # px
    found = adjusted(sights, start)
    assert "1 sights" in found.remarks[0]
    np.testing.assert_allclose(found.place, clean.place, atol=0.03)


def test_what_is_seen_too_seldom_is_said():
    sights, start = simulated(4)
    few = [s if k < 2 else s.without({35}) for k, s in enumerate(sights)]
    found = adjusted(few, start)
    assert 35 not in found.codes
    assert "Markers 35" in found.remarks[0]
    with pytest.raises(ValueError, match="2 pictures show the board, and 0 markers"):
        adjusted(sights[:2], start)


def drawn(turn, shift, seed):
    """A picture of board and markers. Marks face +y of a world whose z is up."""
    world = np.array([[-1.0, 0, 0], [0, 0, -1.0], [0, -1.0, 0]])  # to the board's axes
    marks = [Mark(f"m{c}", CodedMarker(int(c), 12.0), tuple(world.T @ p), "frame") for c, p in zip(CODES, PLACES)]
    pose = cv2.Rodrigues(turn)[0].ravel(), shift
    glued = (cv2.Rodrigues(turn @ world)[0].ravel(), shift)
    return synthetic.board_image(CAMERA, BOARD, pose, seed=seed, marks=marks, marks_pose=glued)


def test_drawn_pictures():
    pictures = [drawn(turn, shift, k) for k, (turn, shift) in enumerate(poses(10, np.random.default_rng(8)))]
    found = loose_markers(pictures, [f"p{k}" for k in range(10)], BOARD, dictionary="DICT_4X4_50")
    assert found.codes == tuple(CODES)  # those of the board itself are none
    off = found.place - PLACES
    assert np.abs(off[:, :2]).max() < 0.05
    assert np.sqrt(np.mean(off[:, :2] ** 2)) < 0.02
    assert 0.6 < np.sqrt(np.mean(pulls(found) ** 2)) < 1.4  # of 30 values
