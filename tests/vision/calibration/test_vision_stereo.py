"""Cameras calibrated together: derivatives, pulls of rig and corners, lag of film, and a real recording."""

from dataclasses import replace
from pathlib import Path

from benchmarks.tracking import stereo as benchmark

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.pulls import band
from vision import Camera
from vision.boards.board import BoardView
from vision.boards.charuco import CharucoBoard
from vision.calibration.bundle import Shot, bundle_adjust
from vision.calibration.rejectedpictures import worst_pose
from vision.calibration.rig import OWN, Rig, project, triangulate
from vision.calibration.stereo import _fit_poses, synchronous_shots

Array = NDArray[np.float64]
BOARD = CharucoBoard(columns=5, rows=4, square_mm=36.0, marker_mm=26.0)
CORNERS = BOARD.points
SIZE = (1280, 720)
PINHOLE = ("k1",)


def rig_of(seed: int = 0) -> Rig:
    """Two cameras 300 mm apart that look at a point 700 mm away."""
    rng = np.random.default_rng(seed)
    cameras = tuple(
        Camera(
            np.array([[1200.0 + rng.normal(0, 20), 0, 640], [0, 1200.0, 360], [0, 0, 1.0]]),
            np.array([-0.1, 0.0, 0.0, 0.0, 0.0]),
            SIZE,
            model=PINHOLE,
        )
        for _ in range(2)
    )
    turn, shift = np.array([[0.0, 0, 0], [0.02, 0.41, -0.01]]), np.array([[0.0, 0, 0], [-285.0, 5.0, 60.0]])
    return Rig(cameras, turn, shift, np.zeros((2 * OWN, 2 * OWN)))


def poses(count: int, rng: np.random.Generator) -> Array:
    """Board poses (n,6) in front of the rig, tilted by some 20 degrees."""
    turn = rng.normal(0, 0.35, (count, 3))
    shift = rng.uniform([-90, -80, 600], [20, 20, 800], (count, 3))
    return np.hstack([turn, shift])


def shots_of(rig: Rig, pose: Array, rng: np.random.Generator, *, own: float, shared: float) -> list[Shot]:
    apart = np.linalg.norm(CORNERS[:, None] - CORNERS[None], axis=-1)
    root = np.linalg.cholesky(
        own**2 * np.eye(len(CORNERS)) + shared**2 * np.exp(-apart / (2 * BOARD.square_mm))
    )
    shots = []
    for c, theta in enumerate(rig.parameters):
        for i, p in enumerate(pose):
            pixels, _, _ = project(theta, p[:3], p[3:], CORNERS)
            still = np.zeros(pixels.shape)
            seen = pixels + root @ rng.standard_normal(pixels.shape)
            shots.append(
                Shot(camera=c, instant=i, points=CORNERS, pixels=seen, speed=still, acceleration=still)
            )
    return shots


def test_derivatives_of_the_projection_are_those_of_finite_differences() -> None:
    own, pose = rig_of().parameters[1], np.array([0.3, -0.2, 0.5, 10.0, 20.0, 700.0])
    own[4:9] = -0.1, 0.02, 1e-3, -1e-3, 0.01
    _, to_camera, to_pose = project(own, pose[:3], pose[3:], CORNERS)
    for k, slope in enumerate(np.hstack([to_camera, to_pose]).T):
        x = np.concatenate([own, pose])
        h = 1e-5 * max(1.0, abs(x[k]))
        both = [x + sign * h * np.eye(len(x))[k] for sign in (1, -1)]
        up, down = (project(y[:OWN], y[OWN : OWN + 3], y[OWN + 3 :], CORNERS)[0] for y in both)
        # central differences: relative error 1e-10 and rounding 1e-13 * 700 px / h
        assert np.allclose((up - down).ravel() / (2 * h), slope, rtol=1e-6, atol=1e-5)


def test_a_point_is_placed_by_two_cameras_as_well_as_its_covariance_says() -> None:
    rig, rng = rig_of(), np.random.default_rng(3)
    points = rng.uniform([-80, -60, 600], [60, 60, 800], (2000, 3))
    exact = np.array([(m[:, :3] @ points.T).T + m[:, 3] for m in rig.matrices])
    pixels = exact[..., :2] / exact[..., 2:]
    covariance = np.array([[0.04, 0.01], [0.01, 0.02]]) * np.ones((*pixels.shape, 1))
    noisy = pixels + rng.standard_normal(pixels.shape) @ np.linalg.cholesky(covariance[0, 0]).T
    place, spread = triangulate(rig.matrices, noisy, covariance)
    assert triangulate(rig.matrices, pixels, covariance)[0] == pytest.approx(points, abs=1e-6)
    error = place - points
    chi2 = np.einsum("ni,nij,nj->n", error, np.linalg.inv(spread), error)
    assert chi2.mean() == pytest.approx(3.0, abs=0.2)  # sd of the mean 0.055, nonlinearity below 0.01


def test_a_point_that_one_camera_lost_is_nan() -> None:
    rig = rig_of()
    pixels = np.full((2, 2, 2), 400.0)
    pixels[1, 0] = np.nan
    place, spread = triangulate(rig.matrices, pixels, np.ones((2, 2, 1, 1)) * np.eye(2))
    assert np.isfinite(place).all(axis=1).tolist() == [False, True]
    assert np.isnan(spread[0]).all()


@pytest.mark.parametrize("shared", [0.0, 0.15])
def test_pulls_of_the_rig_and_of_lengths_on_new_pictures_are_one(shared: float) -> None:
    """Corner errors alone for each corner, and correlated ones: the noise model must find out."""
    chi2, pulls = [], []
    for trial in range(9):
        rng, truth = np.random.default_rng([trial, 7]), rig_of(trial)
        shots = shots_of(truth, poses(18, rng), rng, own=0.15, shared=shared)
        rig, noise = bundle_adjust(shots, rig_of(trial).cameras, square_mm=BOARD.square_mm)
        assert np.sqrt(noise.own + noise.shared).mean() == pytest.approx(np.hypot(0.15, shared), rel=0.25)
        error = (rig.parameters - truth.parameters).ravel()
        free = np.flatnonzero(np.diag(rig.covariance) > 0)
        chi2.append(
            error[free] @ np.linalg.solve(rig.covariance[np.ix_(free, free)], error[free]) / len(free)
        )
        for pose in poses(4, rng):
            new = shots_of(truth, pose[None], rng, own=0.15, shared=shared)
            _, place, spread = benchmark.locate(rig, new, noise, square_mm=BOARD.square_mm)
            side = place[-1] - place[0]
            along = np.zeros(place.shape)
            along[-1], along[0] = side, -side
            along /= np.linalg.norm(side)
            length = np.linalg.norm(CORNERS[-1] - CORNERS[0])
            sd = np.sqrt(along.ravel() @ spread @ along.ravel())
            pulls.append((np.linalg.norm(side) - length) / sd)
    low, high = band(9 * 16)  # trials of parameters
    assert low < np.sqrt(np.mean(chi2)) < high
    low, high = band(9 * 2, 2.0)  # four lengths of one calibration share its error, which is half of theirs
    assert low < np.sqrt(np.mean(np.square(pulls))) < high


def test_a_camera_that_lags_is_found_out_from_the_boards_motion() -> None:
    rig, rate = rig_of(), 10.0
    time = np.arange(40) / rate

    def at(t: float) -> Array:
        turn = [0.3 * np.sin(1.1 * t), 0.3 * np.cos(1.7 * t), 0.1 * t]
        place = [-40 + 50 * np.sin(1.3 * t), -30 + 40 * np.cos(0.9 * t), 700 + 40 * np.sin(t)]
        return np.array([*turn, *place])

    found = []
    for c, late in enumerate((0.0, 0.05)):  # s, half a frame
        shown = [project(rig.parameters[c], at(t - late)[:3], at(t - late)[3:], CORNERS)[0] for t in time]
        found.append([BoardView(CORNERS, pixels) for pixels in shown])
    shots, lags = synchronous_shots(found, [time, time], rig.cameras)
    assert lags.tolist() == [0.0, 0.5]
    fitted, _ = bundle_adjust(shots, rig.cameras, square_mm=BOARD.square_mm)
    # what quadratic motion between frames leaves of it
    assert fitted.shift[1] == pytest.approx(rig.shift[1], abs=1.5)


def test_a_board_that_was_moved_between_two_pictures_is_told() -> None:
    rng, truth = np.random.default_rng(5), rig_of()
    pose = poses(9, rng)
    shots = shots_of(truth, pose, rng, own=0.1, shared=0.0)
    rig, _ = bundle_adjust(shots, rig_of().cameras, square_mm=BOARD.square_mm)
    assert worst_pose(rig, shots) is None
    moved = pose[4] + np.array([0.0, 0.0, 0.0, 2.0, 1.0, 0.0])  # mm
    late = [v for v in shots_of(truth, moved[None], rng, own=0.1, shared=0.0) if v.camera == 1]
    mixed = [v for v in shots if (v.camera, v.instant) != (1, 4)] + [replace(late[0], instant=4)]
    fitted = _fit_poses(mixed, rig_of().cameras, BOARD, [f"b{i}.png" for i in range(9)])
    (name,) = fitted.moved
    assert name.startswith("b4.png (")
    assert len({v.instant for v in fitted.shots}) == 8
    sd = np.sqrt(np.diag(fitted.rig.covariance).reshape(-1, OWN))[1, 12:]
    assert np.all(np.abs(fitted.rig.shift[1] - truth.shift[1]) < 5.0 * sd)  # three numbers
    few = [v for v in mixed if v.instant in (2, 3, 4, 5, 6)]
    kept = _fit_poses(few, rig_of().cameras, BOARD, [f"b{i}.png" for i in range(9)])
    assert not kept.moved  # five poses must be left
    assert kept.worst.startswith("b4.png (")


def test_cameras_that_share_no_picture_are_refused() -> None:
    rng = np.random.default_rng(0)
    shots = shots_of(rig_of(), poses(4, rng), rng, own=0.1, shared=0.0)
    alone = [v for v in shots if (v.instant < 2) == (v.camera == 0)]
    with pytest.raises(ValueError, match="camera 2 sees no board together with another camera"):
        bundle_adjust(alone, rig_of().cameras, square_mm=BOARD.square_mm)


@pytest.mark.parametrize("frames", [30, pytest.param(57, marks=pytest.mark.slow)])
def test_squares_of_a_real_board_on_frames_held_out(shared_data: Path, frames: int) -> None:
    found = benchmark.held_out(shared_data / "charuco_4cam", halves=(0,), most=frames)
    pulls = np.concatenate([error / sd for name, (error, sd) in found.items() if len(name) == 3])
    assert max(abs(error.mean()) for error, _ in found.values()) < 0.15
    assert 0.8 < np.sqrt(np.mean(pulls**2)) < 1.25
