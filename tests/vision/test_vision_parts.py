"""The parts by themselves: renderer, dots, homography, noise."""

from functools import partial
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from vision import Mark
from vision.drawing import synthetic
from vision.errors.staticnoise import (
    CREEP,
    FAST,
    PASSING,
    REST,
    SHAKEN,
    hidden_in_static,
    states,
    static_noise,
)
from vision.kinds import CodedMarker, FacePoint, PlainDot
from vision.marks import codes_of, dots_of
from vision.plane import fit_homography, homographies, plane_of, to_plane

Array = NDArray[np.float64]
Lab = Any


def brute_force(lab: Lab, mark: Mark, centre: Array, angle: float, corner: Array, size: int) -> Array:
    """Block of pixels by 20 x 20 samples each of the sharp printed marker, blurred on the fine grid."""
    fine = 20
    offset = (np.arange(size * fine) + 0.5) / fine - 0.5
    raw = np.stack(np.meshgrid(corner[0] + offset, corner[1] + offset), axis=-1).reshape(-1, 2)
    ideal = (lab.camera.undistort(raw) - lab.camera.matrix[:2, 2]) / np.diag(lab.camera.matrix)[:2]
    turn, _ = cv2.Rodrigues(lab.pose[0])
    ray = np.column_stack([ideal, np.ones(len(ideal))]) @ turn  # in world axes
    eye = -turn.T @ lab.pose[1]
    hit = eye + ray * ((centre[1] - eye[1]) / ray[:, 1])[:, None] - centre
    right = -hit[:, 0] * np.cos(angle) - hit[:, 2] * np.sin(angle)
    down = hit[:, 0] * np.sin(angle) - hit[:, 2] * np.cos(angle)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    bits = np.pad(dictionary.generateImageMarker(mark.kind.code, 6) / 255.0, 1, constant_values=1.0)
    cell = np.floor(np.column_stack([down, right]) / mark.size_mm * 6 + 4).astype(int)
    inside = ((cell >= 0) & (cell < 8)).all(axis=1)
    grey = np.full(len(cell), synthetic.BACKGROUND)
    paper = bits[tuple(np.clip(cell, 0, 7).T)]
    grey[inside] = (synthetic.INK + (synthetic.PAPER - synthetic.INK) * paper)[inside]
    blurred = gaussian_filter(grey.reshape(size * fine, size * fine), 0.8 * fine)
    return blurred.reshape(size, fine, size, fine).mean(axis=(1, 3))


def test_renderer_against_brute_force(lab: Lab) -> None:
    mark, angle = lab.marks[0], 0.4
    centre = np.array(mark.position)
    scene = synthetic._Scene(lab.camera, synthetic.Pose(*lab.pose), [mark], 0.8, "DICT_4X4_50")
    drawn = np.full((400, 640), synthetic.BACKGROUND, dtype=np.float32)
    scene.draw(drawn, centre[None], np.array([angle]), np.array([0]))
    corner = np.round(lab.pixels(centre)) - 34
    exact = brute_force(lab, mark, centre, angle, corner, 68)
    x, y = corner.astype(int)
    block = drawn[y : y + 68, x : x + 68].astype(np.float64)
    inner = (slice(6, -6), slice(6, -6))
    down, right = (g[inner].ravel() for g in np.gradient(exact))
    difference = (block - exact)[inner].ravel()
    shift, *_ = np.linalg.lstsq(np.column_stack([right, down]), difference, rcond=None)
    assert np.max(np.abs(shift)) < 0.002  # px, the renderer's own error of place
    assert np.max(np.abs(difference)) < 2.5  # of 175 grey levels; 20 samples leave some at sharp edges


def test_homography_is_exact_and_follows_the_camera(lab: Lab) -> None:
    frame = np.array([mark.position for mark in lab.marks if mark.role == "frame"])
    finger = np.array([[20.0, 12.0, -30.0], [80.0, 12.0, 10.0]])
    seen = []
    for shake in (0.0, 0.002, -0.004):
        points = np.concatenate([frame, finger])
        pixels, _ = cv2.projectPoints(
            points, lab.pose[0] + shake, lab.pose[1] - 30 * shake, lab.camera.matrix, None
        )
        seen.append(pixels[:, 0])
    ideal = np.array(seen)
    plane = homographies(frame[:, [0, 2]], ideal[:, :6])
    np.testing.assert_allclose(
        to_plane(plane, ideal[:, 6:]), np.tile(finger[:, [0, 2]], (3, 1, 1)), atol=1e-8
    )


def test_homography_needs_four_points() -> None:
    plane = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0], [5.0, 9.0]])
    ideal = np.stack([plane * 3.0 + 7.0] * 2)
    ideal[1, :2] = np.nan
    found = homographies(plane, ideal)
    np.testing.assert_allclose(found[0], [[3, 0, 7], [0, 3, 7], [0, 0, 1]], atol=1e-9)
    assert np.isnan(found[1]).all()
    np.testing.assert_allclose(fit_homography(plane, ideal[0]), found[0], atol=1e-12)


@pytest.mark.parametrize("seen", [[0, 4, 6, 8], [0, 4, 6, 1], [0, 1, 2, 3], [0, 4, 6]])
def test_marks_that_tell_no_homography_give_none(seen: list[int]) -> None:
    """Three on one line and a fourth, as the demo's marks lie; four within 2 mm of one line; three."""
    rng = np.random.default_rng(0)
    plane = np.array(
        [[-37.0, 29], [24, 31], [86, 31], [147, 29], [-37, -20], [147, -18], [-37, -67], [20, -67], [147, -67]]
    )
    ideal = 3.4 * plane + 300 + rng.normal(0.0, 0.03, (300, *plane.shape))  # one in a hundred was singular
    few = np.full(ideal.shape, np.nan)
    few[:, seen] = ideal[:, seen]
    few[0] = ideal[0]
    found = plane_of(plane, few)
    assert np.isfinite(found.homography[0]).all()
    assert np.isfinite(found.spread[0]).all()
    assert np.isnan(found.homography[1:]).all()
    assert np.isnan(to_plane(found.homography, ideal)[1:]).all()


def test_pixels_that_fit_no_homography_take_nothing_from_other_frames() -> None:
    plane = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0]])
    ideal = np.stack([3.0 * plane + 7.0, np.full((4, 2), 7.0), 2.0 * plane])
    found = homographies(plane, ideal)
    np.testing.assert_allclose(found[0], [[3, 0, 7], [0, 3, 7], [0, 0, 1]], atol=1e-9)
    np.testing.assert_allclose(found[2], np.diag([2.0, 2.0, 1.0]), atol=1e-9)
    assert np.isnan(found[1]).all()


def test_noise_model_recovers_sd_rho_and_correlation() -> None:
    rng = np.random.default_rng(4)
    shocks = rng.standard_normal((3000, 2, 2)) + rng.standard_normal(
        (3000, 1, 1)
    )  # half the variance is shared
    place = np.empty_like(shocks)
    place[0] = shocks[0]
    for t in range(1, 3000):
        place[t] = 0.4 * place[t - 1] + np.sqrt(1 - 0.4**2) * shocks[t]
    model = static_noise(5.0 + 0.01 * place, ["a", "b"], "still.mp4")
    seen = [0, 2]
    np.testing.assert_allclose(model.sd[:, seen], 0.01 * np.sqrt(2.0), rtol=0.06)
    np.testing.assert_allclose(model.rho[:, seen], 0.4, atol=0.06)  # 3 sd at 3000 frames
    np.testing.assert_allclose(model.correlation[0, [2, 3, 5]], 0.5, atol=0.06)
    np.testing.assert_array_equal(model.correlation[1], np.eye(6)[1])
    assert np.isnan(model.sd[:, 1]).all()
    assert model.frames == 3000


def test_a_mark_hidden_in_the_static_film_takes_the_largest_noise_of_the_others() -> None:
    place = np.array([0.01, 0.03, 0.02])[:, None] * np.random.default_rng(5).standard_normal((400, 3, 2))
    place[:300, 2] = np.nan
    model = static_noise(place, ["a", "b", "c"], "still.mp4")
    np.testing.assert_allclose(model.sd[:, 0], [0.01, 0.03, 0.03], rtol=0.12)  # 3 sd at 400 frames
    np.testing.assert_array_equal(model.sd[2], model.sd[1])
    np.testing.assert_array_equal(model.correlation[6:], np.eye(9)[6:])
    (said,) = hidden_in_static(place, ["a", "b", "c"], "still.mp4")
    assert "static film still.mp4 shows 'c' in fewer than 120 frames" in said
    with pytest.raises(
        ValueError, match=r"still\.mp4 shows marker 'a' in 110 frames and none in more, wanted"
    ):
        static_noise(place[:110], ["a", "b", "c"], "still.mp4")


def test_what_a_patch_does() -> None:
    x = np.concatenate(
        [np.zeros(20), 5.0 * np.arange(1, 11), 50 + 0.01 * np.arange(1, 31), np.full(25, 50.3)]
    )
    state = states(np.stack([x, 0 * x], axis=-1)[:, None])[:, 0]
    assert set(state[10:14]) == set(state[62:]) == {REST}
    assert set(state[:10]) == {SHAKEN}  # coding still refines the film's first picture
    assert set(state[20:30]) == {FAST}
    assert set(state[42:55]) == {CREEP}  # 0.01 px a frame, yet it goes on


def test_what_a_regulator_shakes_does_not_rest() -> None:
    x = np.concatenate([np.zeros(30), 0.05 * (np.arange(60) // 4 % 2), np.full(30, 0.05)])
    state = states(np.stack([x, 0 * x], axis=-1)[:, None])[:, 0]
    assert set(state[10:20]) == set(state[100:]) == {REST}
    assert set(state[30:90]) == {SHAKEN}


def test_a_patch_that_goes_slowly_to_another_place_passes() -> None:
    x = np.concatenate([np.zeros(30), 0.25 * np.arange(1, 21), np.full(30, 5.0)])
    state = states(np.stack([x, 0 * x], axis=-1)[:, None])[:, 0]
    assert set(state[10:20]) == set(state[60:]) == {REST}
    assert set(state[33:47]) == {PASSING}


def test_a_drift_goes_on_to_the_film_s_end_and_what_never_moves_rests() -> None:
    x = np.stack([0.01 * np.arange(60), np.zeros(60)], axis=1)
    state = states(np.stack([x, 0 * x], axis=-1))
    assert set(state[10:, 0]) == {CREEP}
    assert set(state[:, 1]) == {REST}


def test_a_mark_tells_its_size_its_turn_and_whether_it_stretches() -> None:
    kinds = [CodedMarker(3, 9.0), PlainDot(3.5), FacePoint(6.0)]
    assert [kind.size_mm for kind in kinds] == [9.0, 3.5, 6.0]
    assert [kind.shows_turn for kind in kinds] == [True, False, True]
    assert [kind.stretches for kind in kinds] == [False, False, True]
    for draw in (kinds[2].artwork, partial(kinds[2].texture, 8.0)):
        with pytest.raises(ValueError, match="a point of the speckled face is not"):
            draw("DICT_4X4_50")
    marks = [Mark(str(k), kind, (0.0, 0.0, 0.0), "fixed") for k, kind in enumerate(kinds)]
    assert (codes_of(marks), dots_of(marks)) == ({0: 3}, [1])
