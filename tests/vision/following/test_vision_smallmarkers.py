"""Small markers that the first look does not see are found by a closer one."""

from benchmarks.films import coding

import cv2
import numpy as np
import pytest

from vision import Video
from vision.camera import Image
from vision.drawing import synthetic
from vision.following.firstpictures import first_seen
from vision.marks import detect, detect_wanted

WORDS, SEED = "DICT_4X4_50", 48


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Image:
    """14 drawn markers of 19 px."""
    camera, pose, marks = coding.laboratory(SEED, 0.8)
    path, place = tmp_path_factory.mktemp("small") / "film.mkv", np.array([[m.position for m in marks]])
    synthetic.film(path, camera=camera, pose=pose, marks=marks, positions=place, rotations=np.zeros((1, 14)),
                   codec="ffv1", seed=SEED, blur_px=0.9, noise_grey=2.0, fps=30.0)  # fmt: skip
    return next(iter(Video(path).frames()))[2]


def test_a_closer_look_sees_what_the_first_misses(picture: Image) -> None:
    first, _ = detect(picture, WORDS)
    assert set(range(14)) - set(first) == {0, 1, 4, 6}  # else this film tests nothing
    found, several = detect_wanted(picture, WORDS, range(14))
    assert set(found) == set(range(14))
    assert not several
    assert all(np.array_equal(found[code], first[code]) for code in first)  # as they were


def test_only_what_is_wanted_is_looked_for_again(picture: Image) -> None:
    first, _ = detect(picture, WORDS)
    assert set(detect_wanted(picture, WORDS, [0])[0]) == {*first, 0}
    assert set(detect_wanted(picture, WORDS, list(first))[0]) == set(first)
    assert set(detect_wanted(picture, WORDS, [40])[0]) == set(first)


def test_a_film_begins_with_all_of_them(picture: Image) -> None:
    camera, pose, marks = coding.laboratory(SEED, 0.8)
    warps = first_seen([picture], camera, marks, WORDS)
    assert np.isfinite(warps).all()
    seen = camera.distort(warps[:, :2, 2] / warps[:, 2:, 2])
    places = np.array([m.position for m in marks])
    true = cv2.projectPoints(places, *pose, camera.matrix, camera.distortion)[0].reshape(-1, 2)
    assert np.abs(seen - true).max() < 1.5  # px: corners, where registration starts
