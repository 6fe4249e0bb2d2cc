"""Why a picture shows no marker, in one clause; a good picture has none."""

import re

import cv2
import numpy as np
import pytest

from vision import locate
from vision.film.picturefaults import combed, edge_sd, picture_trouble


def sheet(noise: float = 1.0) -> np.ndarray:
    """Nine markers on grey, 40 px each."""
    picture = np.full((400, 640), 120.0)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for k in range(9):
        y, x = 30 + 120 * (k // 3), 60 + 200 * (k % 3)
        picture[y - 8 : y + 48, x - 8 : x + 48] = 210
        picture[y : y + 40, x : x + 40] = 35 + 175 * (cv2.aruco.generateImageMarker(dictionary, k, 40) / 255.0)
    smooth = cv2.GaussianBlur(picture, (0, 0), 0.8)
    return np.clip(smooth + noise * np.random.default_rng(0).standard_normal(picture.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("axis", [0, 1])
def test_rows_of_two_moments_are_told_from_patterns_and_noise(axis: int) -> None:
    still, moved = sheet(), np.roll(sheet(), 3, axis=axis)
    torn = still.copy()
    torn[1::2] = moved[1::2]
    assert combed(torn) > 4e-3
    assert combed(still) < 1e-4
    assert combed(sheet(noise=8.0)) < 1e-3
    fine = np.random.default_rng(1).integers(0, 255, still.shape).astype(np.uint8)
    assert combed(fine) < 0.0
    assert combed(np.ascontiguousarray(torn.T)) < 0.0


@pytest.mark.parametrize(
    ("change", "clause"),
    [
        (lambda p: p / 10, "the picture is dark"),
        (lambda p: p * 2.2, "the picture is overexposed: 9"),
        (lambda p: 120 + (p - 120) / 8, "hardly any contrast"),
        (lambda p: cv2.GaussianBlur(p, (0, 0), 5.0), "the picture is blurred: its sharpest edges are [6-9] px wide"),
        (lambda p: cv2.filter2D(p, -1, np.ones((1, 25)) / 25), ""),  # edges along the motion stay sharp
        (lambda p: p, ""),
        (lambda p: 40 + p / 3, ""),
        (lambda p: cv2.GaussianBlur(p, (0, 0), 1.8), ""),
    ],
)
def test_what_is_wrong_with_a_picture(change, clause):
    picture = np.clip(change(sheet().astype(np.float64)), 0, 255).astype(np.uint8)
    assert bool(picture_trouble(picture)) == bool(clause)
    if clause:
        assert re.search(clause, picture_trouble(picture))


@pytest.mark.parametrize("sd", [0.5, 1.5, 2.5])
def test_the_blur_is_told(sd):
    blurred = cv2.GaussianBlur(sheet(0.0), (0, 0), sd)
    # Cells of 7 px: of a blur of half that and more, neighbouring edges hide a part.
    assert edge_sd(blurred) == pytest.approx(np.hypot(sd, 0.8), rel=0.25)


def test_locate_says_what_is_there_twice_and_why_there_is_nothing():
    picture = sheet()
    assert locate(picture, dictionary="DICT_4X4_50").repeated == ()
    assert locate(picture, dictionary="DICT_4X4_50").reason == ""
    picture[22:78, 452:508] = picture[22:78, 52:108]  # marker 0 in the place of marker 2
    found = locate(picture, dictionary="DICT_4X4_50")
    assert (found.ids.tolist(), found.repeated) == ([1, 3, 4, 5, 6, 7, 8], (0,))
    other = locate(sheet(), dictionary="DICT_6X6_50")
    assert other.reason == "No marker of DICT_6X6_50 is seen; DICT_4X4_50 finds 9: give that dictionary."
    assert "the picture is dark" in locate(sheet() // 40, dictionary="DICT_4X4_50").reason
    only = np.full((200, 400), 210, dtype=np.uint8)
    only[60:100, 60:100] = only[60:100, 260:300] = sheet()[30:70, 60:100]
    found = locate(only, dictionary="DICT_4X4_50")
    assert not len(found.ids)
    assert found.repeated == (0,)
    assert "are there more than once: ids 0" in found.reason
