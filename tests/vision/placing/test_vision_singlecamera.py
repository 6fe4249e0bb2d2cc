"""What one camera cannot see: heights, motion towards it and its calibration, against exact projection."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.messages import says
from tests.pulls import band
from vision import Camera, Mark, Video, View, measure
from vision.drawing import synthetic
from vision.errors.staticnoise import with_y
from vision.kinds import CodedMarker
from vision.perspective import Viewpoint, to_own_plane, viewpoint
from vision.placing import planeerrors
from vision.plane import homographies, to_plane

Array = NDArray[np.float64]
Lab = Any  # the fixture's class, see conftest.py
Y = 12.0  # mm, the frame marks' plane
FILMS = 150
REFERENCE = np.arange(3)
SHARE = np.sqrt(np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, 9)]))
FRAME = [(-30, 30), (45, 34), (120, 30), (-30, -60), (45, -64), (120, -60)]
FINGER = [(30, 0), (60, 0), (90, 0)]
MARKS = tuple(
    Mark(f"{role}{i}", CodedMarker(i, 9.0), (float(x), Y, float(z)), role)
    for role, spots in (("frame", FRAME), ("finger", FINGER))
    for i, (x, z) in enumerate(spots)
)
PLANE = np.array(FRAME, dtype=np.float64)
HEAD, TAIL = range(6), range(6, 9)
STATED = np.zeros((len(SHARE), 3, 2, 2))  # no place is measured


@dataclass(frozen=True)
class Bench:
    """A random camera over the plane, and what it shows of a bending finger."""

    camera: Camera
    rvec: Array
    tvec: Array

    def ideal(self, true: Camera, place: Array) -> Array:
        """Ideal px (t,9,2), by the nominal camera, of places (t,9,3) mm that the true camera has filmed."""
        flat = np.ascontiguousarray(place.reshape(-1, 3))
        raw, _ = cv2.projectPoints(flat, self.rvec, self.tvec, true.matrix, true.distortion)
        return self.camera.undistort(np.asarray(raw, dtype=np.float64).reshape(*place.shape[:2], 2))

    def measured(self, true: Camera, place: Array, height: Array) -> tuple[Array, Array, Array, Any]:
        """Values (t,3,3) and places (t,3,2) mm of the finger marks, homographies and viewpoint."""
        ideal = self.ideal(true, place)
        homography = homographies(PLANE, ideal[:, HEAD])
        view = viewpoint(self.camera, homography)
        seen = to_own_plane(to_plane(homography, ideal[:, TAIL]), height, view)
        return with_y(seen - seen[REFERENCE].mean(axis=0)), seen, homography, view


def bench(rng: np.random.Generator) -> Bench:
    """A camera 300 to 800 mm away, tilted by some degrees, that sees about 200 mm."""
    distance = rng.uniform(300.0, 800.0)
    focal = 3.4 * distance
    matrix = np.array(
        [[focal, 0.0, 320 + rng.normal(0, 9)], [0.0, focal * 1.001, 200 + rng.normal(0, 9)], [0, 0, 1]]
    )
    camera = Camera(matrix, np.array([-0.12, 0.03, 0.0008, -0.0005, 0.0]), (640, 400))
    facing = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])
    turned = cv2.Rodrigues(np.deg2rad(rng.normal(0, 4, 3)))[0] @ facing
    centre = np.array([45.0, Y, -15.0]) + rng.normal(0, 5, 3) * (1, 0, 1)
    return Bench(camera, cv2.Rodrigues(turned)[0].ravel(), np.array([0.0, 0.0, distance]) - turned @ centre)


def motion(rng: np.random.Generator) -> Array:
    """Places (t,9,3) mm of a finger that bends towards -z, in the plane."""
    place = np.tile([mark.position for mark in MARKS], (len(SHARE), 1, 1))
    top = rng.uniform(5.0, 50.0, (3, 2)) * [[-0.3, -1.0]] * np.array(FINGER)[:, :1] / 90.0
    place[:, 6:, ::2] += top * (SHARE**2)[:, None, None]
    return place


def value_of(place: Array) -> Array:
    """True values (t,3,3) mm in x and z."""
    moved = place - place[REFERENCE].mean(axis=0)
    return np.asarray(moved[:, 6:] * (1.0, np.nan, 1.0))


def amplitudes(error: Array, modes: list[Array]) -> tuple[Array, float]:
    """Amplitudes (k,) of the modes in an error (t,3,3), and the share of its square that they leave."""
    matrix = np.array(modes)[..., ::2].reshape(len(modes), -1).T
    target = error[..., ::2].ravel()
    found, *_ = np.linalg.lstsq(matrix, target, rcond=None)
    left = target - matrix @ found
    return found, float(left @ left / (target @ target))


def test_viewpoint_is_where_the_camera_stands() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        lab = bench(rng)
        *_, view = lab.measured(lab.camera, motion(rng), np.zeros(3))
        centre = -cv2.Rodrigues(lab.rvec)[0].T @ lab.tvec
        np.testing.assert_allclose([*view.foot, view.distance], centre[[0, 2, 1]] - [0, 0, Y], atol=1e-4)


def test_marks_off_the_plane_are_put_right_for_any_tilt() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        lab, place = bench(rng), motion(rng)
        height = np.array([6.0, -4.0, 11.0])
        place[:, 6:, 1] += height
        value, seen, *_ = lab.measured(lab.camera, place, height)
        np.testing.assert_allclose(seen, place[:, 6:, ::2], atol=1e-5)
        flat, *_ = lab.measured(lab.camera, place, np.zeros(3))
        # Without the correction a displacement of up to 50 mm is 1 to 4 % wrong.
        assert np.abs(flat - value_of(place))[..., ::2].max() > 0.1
        np.testing.assert_allclose(value[..., ::2], value_of(place)[..., ::2], atol=1e-5)


def pulls_of_heights(rng: np.random.Generator, sd: float) -> tuple[Array, float]:
    lab, place, drawn = bench(rng), motion(rng), rng.normal(0, sd, 3)
    place[:, 6:, 1] += drawn
    value, _, _, view = lab.measured(lab.camera, place, np.zeros(3))
    modes = planeerrors.height_modes(value, np.zeros((3, 2)), STATED, MARKS[6:], view, sd_mm=sd)
    assert list(modes) == ["height:finger0", "height:finger1", "height:finger2"]
    return amplitudes(value - value_of(place), list(modes.values()))


def pulls_out_of_plane(rng: np.random.Generator, sd: float) -> tuple[Array, float]:
    lab, place, drawn = bench(rng), motion(rng), rng.normal(0, sd, 3)
    place[:, 6:, 1] += drawn * SHARE[:, None]
    value, seen, _, view = lab.measured(lab.camera, place, np.zeros(3))
    modes = planeerrors.out_of_plane_modes(value, seen, MARKS[6:], view, sd_mm=sd)
    assert list(modes) == ["out_of_plane:finger0", "out_of_plane:finger1", "out_of_plane:finger2"]
    return amplitudes(value - value_of(place), list(modes.values()))


def lens() -> Array:
    """A covariance (9,9) as board pictures leave it: fx with fy, k1 with k2 go together."""
    sd = np.array([2.0, 2.0, 3.0, 3.0, 8e-3, 5e-2, 3e-4, 3e-4, 0.0])
    correlation = np.eye(9)
    correlation[0, 1] = correlation[1, 0] = 0.98
    correlation[4, 5] = correlation[5, 4] = -0.9
    return np.outer(sd, sd) * correlation


def pulls_of_calibration(rng: np.random.Generator, sd: float) -> tuple[Array, float]:
    lab, place = bench(rng), motion(rng)
    camera = replace(lab.camera, covariance=lens() * sd**2)
    height = np.array([0.0, 3.0, 6.0])
    place[:, 6:, 1] += height
    true = camera.moved(rng.multivariate_normal(np.zeros(9), camera.covariance, method="eigh"))
    value, _, homography, _ = lab.measured(true, place, height)
    modes = planeerrors.calibration_modes(
        camera,
        lab.ideal(true, place),
        homography,
        plane=PLANE,
        frame=HEAD,
        points=TAIL,
        height=height,
        reference=REFERENCE,
        slope=STATED,
    )
    assert list(modes) == [f"calibration:{k + 1}" for k in range(len(modes))]
    return amplitudes(value - value_of(place), list(modes.values())[:2])


@pytest.mark.parametrize("pulls", [pulls_of_heights, pulls_out_of_plane, pulls_of_calibration])
def test_pulls_over_random_cameras(pulls: Any) -> None:
    rng = np.random.default_rng(2)
    drawn = [pulls(rng, 0.3) for _ in range(FILMS)]
    # The amplitude of each mode in the error is a standard normal number, and the modes are all there is.
    amplitude = np.array([found for found, _ in drawn])
    low, high = band(amplitude.size)
    assert low < np.sqrt(np.mean(amplitude**2)) < high
    assert np.median([left for _, left in drawn]) < 0.02


def test_principal_directions_are_the_covariance() -> None:
    covariance = lens()
    steps = planeerrors.principal(covariance)
    np.testing.assert_allclose(steps.T @ steps, covariance, rtol=1e-9, atol=1e-18)
    assert planeerrors.principal(np.zeros((9, 9))).shape == (0, 9)


def test_a_mark_that_twists_out_of_the_plane_is_reported(lab: Lab, still: Video, tmp_path: Path) -> None:
    bend = np.concatenate([np.zeros(12), np.linspace(0.0, 0.008, 14)])
    place, turn = lab.motion(bend)
    place[12:, -1, 1] += np.linspace(0.0, 4.0, 14)  # mm towards the camera, which is 380 mm away
    marks = [*lab.marks[:-2], replace(lab.marks[-2], position=(60.0, 15.0, 0.0)), lab.marks[-1]]
    place[:, -2, 1] = 15.0  # 3 mm in front of the plane, and said so
    synthetic.film(
        tmp_path / "twist.mkv",
        camera=lab.camera,
        pose=lab.pose,
        marks=marks,
        positions=place,
        rotations=turn,
        seed=5,
        codec="rawvideo",
    )
    camera = replace(lab.camera, covariance=lens())
    result = measure([View(Video(tmp_path / "twist.mkv"), still, camera)], marks, reference=1.05)
    told = "\n".join(result.notes)
    says(told, "1", "'finger11'", "3.0 mm")
    said = [sentence for sentence in result.remarks if "looks" in sentence]
    assert len(said) == 1
    says(said[0], "'finger12'", "2.500 s")
    size = float(said[0].split("moved ")[1].split(" +-")[0])
    assert size == pytest.approx(4.0, abs=0.8)  # 31 px tags: 0.03 px in the side is 0.4 mm
    error = (result.value - (place - place[0])[:, lab.rows("fixed", "finger")])[..., ::2]
    assert np.abs(error[:, :-1]).max() < 0.01  # 0.03 px; uncorrected the mark in front is 0.4 mm off
    modes = dict(zip(result.mode_names, result.modes, strict=True))
    assert 0.002 < np.abs(modes["calibration:1"]).max() < 0.1
    shift = modes["out_of_plane:finger12"][-1, -1, ::2] * 4.0 / 0.3
    np.testing.assert_allclose(error[-1, -1], shift, atol=0.02)


def test_marks_beyond_the_boards_are_named() -> None:
    camera = bench(np.random.default_rng(3)).camera
    hull = np.array([[100.0, 50.0], [500.0, 50.0], [500.0, 350.0], [100.0, 350.0]])
    raw = np.array(
        [[[300.0, 200.0], [495.0, 60.0], [np.nan, np.nan]], [[90.0, 200.0], [560.0, 60.0], [1.0, 1.0]]]
    )
    ideal = camera.undistort(raw)
    covered = replace(camera, covered=hull)
    (said,) = planeerrors.extrapolated(covered, ideal, ["a", "b", "c"])
    assert (
        "2 markers move to where no board was photographed, 'c' by 110 px" in said
    )  # 10 px are less than a square
    assert planeerrors.extrapolated(covered, ideal[:1], ["a", "b", "c"]) == ()
    assert planeerrors.extrapolated(camera, ideal, ["a", "b", "c"]) == ()


def test_markers_of_the_rig_that_look_smaller_are_told_as_light_or_camera(lab: Lab) -> None:
    marks = [lab.marks[p] for p in lab.rows("fixed", "finger")]
    view, sd = Viewpoint(np.zeros(2), 400.0), np.full((2, len(marks)), 1e-5)
    size = np.ones((2, len(marks)))
    size[1, 1:6] = 400.0 / 412.0
    (said,) = planeerrors.alarms(np.array([0.0, 1.0]), size, sd, marks, view, sd_mm=0.3)
    assert "5 markers look smaller than at rest, as at 1.000 s, and 3 of them are fixed to the rig" in said
    assert "light or the camera changed" in said
    size[1, 2:4] = 1.0  # one marker of the rig may be loose
    each = planeerrors.alarms(np.array([0.0, 1.0]), size, sd, marks, view, sd_mm=0.3)
    assert len(each) == 3
    assert all("away from the camera" in one for one in each)


def test_an_alarm_says_towards_on_either_side(lab: Lab) -> None:
    """A mark 4 mm nearer looks larger, whether the camera stands at +y or at -y; no sd is negative."""
    size, sd = np.array([[1.0], [400.0 / 396.0]]), np.full((2, 1), 1e-5)
    for distance in (400.0, -400.0):
        view = Viewpoint(np.zeros(2), distance)
        (said,) = planeerrors.alarms(np.array([0.0, 1.0]), size, sd, [lab.marks[-1]], view, sd_mm=0.3)
        assert "looks larger at 1.000 s than at rest, as if it moved 4.0 +- 0.1 mm towards the camera" in said
