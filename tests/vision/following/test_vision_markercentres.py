"""Markers of every dictionary, black on white and white on black, in one picture."""

from pathlib import Path
from typing import Any

from benchmarks.tracking.photos import photograph

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.pulls import band
from vision import Video, locate
from vision.dictionaries import dictionary_of
from vision.film.video import Writer
from vision.following.markercentres import Located
from vision.following.printedpattern import print_covariance
from vision.following.reference import prepare
from vision.following.registration import project
from vision.plane import fit_homography

Array = NDArray[np.float64]
NAMES = sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))
FINE = 8  # texels per pixel of what is drawn here


def sheet(dictionary: str, ids: list[int], *, side: float = 42.3) -> tuple[NDArray[np.uint8], Array]:
    """A picture with a row of markers, blurred by 0.9 px, and their centres (n,2) px."""
    words = dictionary_of(dictionary)
    cells = words.markerSize + 2
    paper = np.full((96 * FINE, (16 + 80 * len(ids)) * FINE), 255, dtype=np.uint8)
    size = cells * round(side * FINE / cells)  # whole texels to a cell
    centre = []
    for i, marker in enumerate(ids):
        bits = words.generateImageMarker(marker, cells)
        drawn = cv2.resize(bits, (size, size), interpolation=cv2.INTER_NEAREST)
        x, y = (20 + 80 * i) * FINE + 3 * i, 25 * FINE + 2 * i
        paper[y : y + size, x : x + size] = drawn
        centre.append([(x + 0.5 * size) / FINE - 0.5, (y + 0.5 * size) / FINE - 0.5])
    soft = cv2.GaussianBlur(40.0 + 0.7 * paper.astype(np.float64), (0, 0), 0.85 * FINE)
    picture = soft.reshape(96, FINE, -1, FINE).mean(axis=(1, 3))
    noisy = picture + np.random.default_rng(0).normal(0.0, 1.0, picture.shape)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), dtype=np.uint8), np.array(centre)


def check(found: Located, ids: list[int], centre: Array, *, inverted: bool) -> None:
    assert found.ids.tolist() == sorted(ids)
    error = found.centre - centre[np.argsort(ids)]
    assert np.abs(error).max() < 0.015  # Cramer-Rao for one grey level and 42 px: 0.001 to 0.002 px
    assert np.all(found.inverted == inverted)
    assert np.all(found.correlation > 0.995)
    pull = error / np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    assert np.abs(pull).max() < 6.0  # the stated sd is of the right size


@pytest.mark.parametrize("name", NAMES)
def test_every_predefined_dictionary(name: str) -> None:
    last = len(dictionary_of(name).bytesList) - 1
    ids = [last, 0, last // 3, 7]
    picture, centre = sheet(name, ids)
    check(locate(picture, dictionary=name), ids, centre, inverted=False)
    check(locate(np.asarray(255 - picture), dictionary=name), ids, centre, inverted=True)


def test_all_apriltag_families_are_there() -> None:
    families = {name.rsplit("_", 1)[1] for name in NAMES if "APRILTAG" in name}
    assert {"16h5", "25h9", "36h10", "36h11"} <= families


def test_own_dictionary_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "own.yml"
    words = [f"{(9277 * (i + 3)) % 2**25:025b}" for i in range(5)]
    lines = ["%YAML:1.0", "nmarkers: 5", "markersize: 5", "maxCorrectionBits: 1"]
    path.write_text("\n".join([*lines, *(f'marker_{i}: "{word}"' for i, word in enumerate(words))]) + "\n")
    picture, centre = sheet(str(path), [4, 1, 0, 3])
    check(locate(picture, dictionary=str(path)), [4, 1, 0, 3], centre, inverted=False)
    assert not len(locate(picture, dictionary="DICT_5X5_50").ids)


def test_a_dictionary_file_without_its_corrections_corrects_none(tmp_path: Path) -> None:
    path = tmp_path / "own.yml"
    path.write_text('%YAML:1.0\nnmarkers: 1\nmarkersize: 3\nmarker_0: "101110001"\n')
    read = cv2.aruco.Dictionary()
    assert read.readDictionary(cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ).root())
    assert dictionary_of(str(path)).maxCorrectionBits == read.maxCorrectionBits == 0


def test_bad_dictionary_files(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"absent\.yml does not exist"):
        dictionary_of(str(tmp_path / "absent.yml"))
    for text, fault in (("no yaml at all", "as YAML, XML or JSON"), ("%YAML:1.0\nnmarkers: 2\n", "wanted 3 to 16"), ("", "")):
        (tmp_path / "bad.yml").write_text(text)
        with pytest.raises(ValueError, match=rf"bad\.yml.*{fault}"):
            dictionary_of(str(tmp_path / "bad.yml"))


def test_an_empty_picture_holds_nothing() -> None:
    found = locate(np.full((90, 120), 128, dtype=np.uint8), dictionary="DICT_4X4_50")
    assert found.ids.shape == (0,)
    assert found.centre.shape == (0, 2)


def test_real_board_of_own_markers(shared_data: Path) -> None:
    folder = shared_data / "opencv_boards"
    picture = np.asarray(cv2.imread(str(folder / "gboriginal.png"), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    dictionary = str(folder / "tutorial_dict.yml")
    for image in (picture, np.asarray(255 - picture)):
        found = locate(image, dictionary=dictionary)
        assert found.ids.tolist() == list(range(35))
        plane = np.stack([found.ids % 5, found.ids // 5], axis=1) * 50.0
        homography = fit_homography(plane, found.centre)
        error = found.centre - project(homography, np.concatenate([plane.T, np.ones((1, 35))]))
        assert np.sqrt(np.mean(error**2)) <= 0.09  # of each coordinate; OpenCV's corners give 0.14 to 0.33


def test_stated_covariance_on_a_real_photograph(shared_data: Path) -> None:
    value, degrees, error, sd = photograph(shared_data / "opencv_boards")
    assert 0.08 < error < 0.09  # px: the paper is not flat and the camera sharpens
    low, high = band(degrees, 2.0)
    assert low < np.sqrt(value / degrees) < high  # 5.0 where the residual counts as white noise
    assert sd < 0.15


def test_a_print_off_its_plane_shows_only_at_an_angle() -> None:
    frontal = 20.0 * np.eye(2)  # px by local unit: a side of 40 px
    angle = np.deg2rad(50.0)
    tilted = frontal @ np.diag([1.0, np.cos(angle)])
    np.testing.assert_allclose(print_covariance(np.array([frontal])), 0.0, atol=1e-12)
    expected = np.diag([0.0, (0.003 * 40.0 * np.sin(angle)) ** 2])
    np.testing.assert_allclose(print_covariance(np.array([tilted]))[0], expected, atol=1e-12)


def test_a_film_of_inverted_markers(lab: Any, tmp_path: Path) -> None:
    film = lab.film(tmp_path / "rest.mkv", np.zeros(12), seed=3)
    with Writer(
        tmp_path / "white.mkv", (film.width, film.height), fps=10.0, codec="rawvideo", crf=0
    ) as writer:
        for _, _, grey in film.frames():
            writer.add(np.asarray(255 - grey, dtype=np.uint8))
    both = [
        prepare(Video(path), lab.camera, lab.marks, dictionary="DICT_4X4_50", reference_s=1.15)
        for path in (film.path, tmp_path / "white.mkv")
    ]
    # What is white is black: the same places to the rounding of the search for the blur.
    np.testing.assert_allclose(both[1].seed[:, :2, 2], both[0].seed[:, :2, 2], atol=0.05)
    place = [
        f.seed @ np.concatenate([f.centre, np.ones((len(f.centre), 1))], axis=1)[..., None] for f in both
    ]
    flat = [p[:, :2, 0] / p[:, 2:, 0] for p in place]
    np.testing.assert_allclose(flat[1], flat[0], atol=0.005)


def test_of_several_markers_of_one_id_the_one_in_its_place_is_followed(lab: Any, tmp_path: Path) -> None:
    film = lab.film(tmp_path / "rest.mkv", np.zeros(12), seed=3)
    (_, _, first), told = next(iter(film.frames())), {"dictionary": "DICT_4X4_50", "reference_s": 1.15}
    plain = prepare(film, lab.camera, lab.marks, **told)
    row = lab.rows("finger")[1]
    x, y = (round(float(v)) for v in lab.camera.distort(plain.seed[row, :2, 2]))
    box = first[y - 24 : y + 25, x - 24 : x + 25]

    def again(left: int, top: int) -> Video:
        path = tmp_path / f"copy{left}.mkv"
        with Writer(path, (film.width, film.height), fps=10.0, codec="rawvideo", crf=0) as writer:
            for _, _, grey in film.frames():
                shown = grey.copy()
                shown[top : top + 49, left : left + 49] = box
                writer.add(shown)
        return Video(path)

    far = prepare(again(x + 60, y + 75), lab.camera, lab.marks, **told)
    np.testing.assert_array_equal(far.seed[row], plain.seed[row])
    with pytest.raises(ValueError, match=f"shows marker {lab.marks[row].kind.code} more than once"):
        prepare(again(x - 80, y - 24), lab.camera, lab.marks, **told)  # which of the two cannot be told
