"""Places in space -> pixels, against OpenCV's projection through a pose that the code does not know."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vision import Camera, Mark
from vision.kinds import CodedMarker
from vision.perspective import Projection
from vision.plane import homographies

Array = NDArray[np.float64]
Y = 11.5  # mm, the frame marks' plane
SPOTS = ((-37, 29), (55, 31), (147, 29), (-37, -67), (55, -64), (147, -67))
MARKS = tuple(
    Mark(f"f{k}", CodedMarker(k, 5.5), (float(x), Y, float(z)), "frame") for k, (x, z) in enumerate(SPOTS)
)
CAMERA = Camera(
    np.array([[3780.0, 0, 652.0], [0, 3775.0, 349.0], [0, 0, 1]]), np.array([-0.2, 0.1, 1e-3, -1e-3, 0.0]), (1280, 720)
)  # fmt: skip
# a lens that is not long: 600 mm away, so that 20 mm of depth are 3 % of the picture
FACING = np.array([[-1.0, 0, 0], [0, 0, -1], [0, -1, 0]])
POSES = [  # looks along -y, z up, each time a little otherwise: a shaken tripod
    (np.deg2rad([2.0, -3.0, 1.0]), np.array([52.0, 11.0, -19.0])),
    (np.deg2rad([2.1, -2.9, 1.2]), np.array([52.5, 11.0, -19.4])),
]


def seen(places: Array, frame: int) -> Array:
    """Raw pixels (n,2) of places (n,3) mm, by OpenCV."""
    tilt, at = POSES[frame]
    turn = np.asarray(cv2.Rodrigues(tilt)[0]) @ FACING
    shift = np.array([0.0, 0.0, 600.0]) - turn @ at
    rvec = np.asarray(cv2.Rodrigues(turn)[0])
    found, _ = cv2.projectPoints(places, rvec, shift, CAMERA.matrix, CAMERA.distortion)
    return np.asarray(found[:, 0], np.float64)


def projection() -> Projection:
    places = np.array([mark.position for mark in MARKS])
    ideal = np.array([CAMERA.undistort(seen(places, k)) for k in range(len(POSES))])
    return Projection.of(CAMERA, homographies(places[:, [0, 2]], ideal), MARKS)


PLACES = np.array([[x, y, z] for x in (0.0, 60.0, 110.0) for y in (-11.5, 0.0, 11.5, 14.0) for z in (-50.0, 0.0, 20.0)])


@pytest.mark.parametrize("frame", range(len(POSES)))
def test_places_in_space_are_seen_where_opencv_sees_them(frame: int) -> None:
    found = projection().pixels(PLACES, frame)
    # The viewpoint is the median of two frames', which stand 0.7 mm apart: 25 mm of depth make that 0.2 px.
    np.testing.assert_allclose(found, seen(PLACES, frame), atol=0.3)
    on_plane = PLACES[:, 1] == Y
    np.testing.assert_allclose(found[on_plane], seen(PLACES, frame)[on_plane], atol=1e-6)
    # 23 mm behind the plane a place moves by far more than that: depth is not ignored
    flat = PLACES * [1, 0, 1] + [0, Y, 0]
    assert np.abs(projection().pixels(flat, frame) - found)[PLACES[:, 1] < 0].max() > 5.0


def test_pixels_are_taken_back_to_their_places() -> None:
    own = projection()
    np.testing.assert_allclose(own.places(own.pixels(PLACES, 1), 1, y_mm=PLACES[:, 1]), PLACES, atol=1e-6)


def test_a_frame_without_its_marks_gives_nan() -> None:
    own = projection()
    own.homography[0] = np.nan
    assert np.isnan(own.pixels(PLACES, 0)).all()
    assert np.isfinite(own.pixels(PLACES, 1)).all()
