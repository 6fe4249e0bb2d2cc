"""Tracks mended by hand: lost, exchanged and placed marks, and what names no mark or no frame."""

import numpy as np
import pytest

from vision import Camera
from vision.following.corrections import Correction, corrected
from vision.following.tracks import Followed, Method

CAMERA = Camera(
    np.array([[900.0, 0, 320], [0, 900, 200], [0, 0, 1]]), np.array([-0.2, 0, 0, 0, 0]), (640, 400)
)
NAMES = ("a", "b", "tip")


def film() -> Followed:
    """Ten frames; a and b lie apart, tip moves and is lost in frames 4 to 6 while it turns by 0.1 rad a frame."""
    warp = np.tile(np.eye(3), (10, 3, 1, 1))
    turn = 0.1 * np.arange(10)
    warp[:, 2, :2, :2] = 8.0 * np.stack(
        [np.stack([np.cos(turn), -np.sin(turn)], 1), np.stack([np.sin(turn), np.cos(turn)], 1)], 1
    )
    warp[:, :, :2, 2] = [[100, 100], [200, 100], [300, 200]]
    warp[:, 2, 0, 2] += 5.0 * np.arange(10)
    method = np.full((10, 3), Method.REGISTERED, dtype=np.int8)
    warp[4:7, 2], method[4:7, 2] = np.nan, Method.LOST
    covariance = np.tile(1e-4 * np.eye(2), (10, 3, 1, 1))
    covariance[4:7, 2] = np.nan
    return Followed(time=np.arange(10) / 10.0, warp=warp, ideal=warp[:, :, :2, 2].copy(), covariance=covariance,
                    method=method, growth=np.ones((10, 3)), reference=np.arange(2))  # fmt: skip


def test_nothing_to_mend_changes_nothing() -> None:
    own = film()
    assert corrected(own, NAMES, (), CAMERA) is own


def test_a_placed_mark_is_where_it_was_seen_with_its_sd_and_turns_as_its_neighbours_in_time() -> None:
    own = film()
    before = own.ideal.copy()
    raw = CAMERA.distort(np.array([324.0, 200.0]))
    mended = corrected(own, NAMES, (Correction("tip", "place", 0.52, 0.52, "", tuple(raw), 0.7),), CAMERA)
    np.testing.assert_allclose(mended.ideal[5, 2], [324.0, 200.0], atol=1e-6)
    np.testing.assert_allclose(mended.covariance[5, 2], 0.49 * np.eye(2))
    assert mended.method[5, 2] == Method.BY_HAND
    turn = np.arctan2(mended.warp[5, 2, 1, 0], mended.warp[5, 2, 0, 0])
    assert turn == pytest.approx(0.5, abs=1e-6)
    assert np.isnan(mended.ideal[4, 2]).all()
    np.testing.assert_array_equal(own.ideal, before)  # the tracks that came in are as they were
    assert "1 corrections by hand" in mended.noted[0]


def test_exchanged_marks_come_back_and_a_wrong_track_is_lost_in_the_order_of_the_lines() -> None:
    own = film()
    lines = (Correction("a", "swap", 0.3, 0.9, "b"), Correction("a", "lost", 0.5, 0.6))
    mended = corrected(own, NAMES, lines, CAMERA)
    np.testing.assert_array_equal(mended.ideal[:3], own.ideal[:3])
    np.testing.assert_array_equal(mended.ideal[3, :2], own.ideal[3, [1, 0]])
    np.testing.assert_array_equal(mended.warp[9, :2], own.warp[9, [1, 0]])
    assert np.isnan(mended.ideal[5:7, 0]).all()
    assert (mended.method[5:7, 0] == Method.LOST).all()
    np.testing.assert_array_equal(mended.ideal[5:7, 1], own.ideal[5:7, 0])


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (Correction("tpi", "lost", 0.1, 0.2), r"correction of marker 'tpi': wanted one of a, b, tip"),
        (Correction("a", "swap", 0.1, 0.2, "c"), r"correction of marker 'c': wanted one of"),
        (Correction("a", "lost", 2.0, 3.0), r"no frame there; wanted times of the film, 0.000 to 0.900 s"),
        (Correction("a", "place", 1.1, 1.1, "", (1.0, 2.0)), r"no frame there"),
    ],
)
def test_what_names_no_mark_or_no_frame_is_refused(line: Correction, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        corrected(film(), NAMES, (line,), CAMERA)
