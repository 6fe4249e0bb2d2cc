"""Whether a camera still fits a rig: it does from another place, and not with another zoom or a moved marker."""

from dataclasses import replace

import numpy as np
import pytest

from vision.calibration.lens import view_misfit
from vision.camera import Camera

CAMERA = Camera(
    np.array([[2400.0, 0, 640], [0, 2400.0, 360], [0, 0, 1]]), np.array([-0.25, 0.1, 0.0, 0.0, 0.0]), (1280, 720)
)
RIG = np.array([(x, 0.0, z) for z in (12.0, -75.0) for x in (-20.0, 15.0, 50.0, 85.0, 120.0)])
DEFINES = np.array([i % 5 not in (1, 3) for i in range(10)])


def seen(camera: Camera, *, turn: float = 0.0, distance: float = 400.0) -> np.ndarray:
    """Centres of the rig's markers (10,2) raw px, of a camera in front of it, turned about z."""
    c, s = np.cos(turn), np.sin(turn)
    p = RIG - np.array([50.0, 0.0, -30.0])
    p = np.stack([c * p[:, 0], -p[:, 2], distance + s * p[:, 0]], axis=1)
    ideal = p @ camera.matrix.T
    return camera.distort(ideal[:, :2] / ideal[:, 2:])


def test_a_camera_that_was_moved_still_fits():
    misfit = view_misfit(CAMERA, seen(CAMERA), seen(CAMERA, turn=0.15, distance=460.0), defines=DEFINES)
    assert misfit < 1e-6


def test_another_zoom_or_focus_shows():
    zoomed = replace(CAMERA, matrix=CAMERA.matrix * [[1.15, 1, 1], [1, 1.15, 1], [1, 1, 1]])
    assert view_misfit(CAMERA, seen(CAMERA), seen(zoomed), defines=DEFINES) > 0.3


def test_a_marker_that_was_moved_shows():
    now = seen(CAMERA)
    now[1] += 1.0  # a fixed one
    assert view_misfit(CAMERA, seen(CAMERA), now, defines=DEFINES) == pytest.approx(np.sqrt(2 / 4), rel=1e-6)


def test_too_few_markers_are_refused():
    with pytest.raises(ValueError, match="3 of 10 markers define the view; wanted 4 or more"):
        view_misfit(CAMERA, seen(CAMERA), seen(CAMERA), defines=np.arange(10) < 3)
