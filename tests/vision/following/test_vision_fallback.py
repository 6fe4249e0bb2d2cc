"""Frames in which no mark registers but shows its place: how far off it is, what is stated, what is refused."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.pulls import band
from vision import Displacements, View, measure
from vision.film.video import Writer
from vision.following import fallback
from vision.following.reference import prepare
from vision.following.tracking import follow
from vision.following.tracks import FIRM, Followed, Method
from vision.marks import corner_warp

Array = NDArray[np.float64]
Lab = Any  # the fixture's class, see conftest.py
REST, SPOILT = 12, 14  # frames of the reference; where the film is spoilt from
BEND = np.concatenate([np.zeros(SPOILT), np.linspace(0.0, 0.008, 16)])
ROWS, COLUMNS = np.mgrid[:400, :640]


@dataclass(frozen=True)
class Drawn:
    """Pictures that are read like a film."""

    pictures: list[NDArray[np.uint8]]
    path: Path = Path("drawn")
    width: int = 640
    height: int = 400

    @property
    def time(self) -> Array:
        return np.arange(len(self.pictures)) / 10.0

    def frames(self) -> Iterator[tuple[int, float, NDArray[np.uint8]]]:
        yield from ((i, i / 10.0, picture) for i, picture in enumerate(self.pictures))


def noisy(grey: Array, sd: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    return np.asarray(np.clip(np.rint(grey + rng.normal(0.0, sd, grey.shape)), 0, 255), dtype=np.uint8)


@pytest.fixture(scope="module")
def clean(lab: Lab, tmp_path_factory: pytest.TempPathFactory) -> list[Array]:
    film = lab.film(tmp_path_factory.mktemp("clean") / "clean.mkv", BEND, noise=0.0)
    return [grey.astype(np.float64) for _, _, grey in film.frames()]


def followed(lab: Lab, clean: list[Array], spoil: Callable[[int, Array], Array], sd: float) -> Followed:
    """The film followed, with every second frame from SPOILT on spoilt, then noise of that sd."""
    rng = np.random.default_rng(11)
    bad = [t >= SPOILT and t % 2 == 0 for t in range(len(clean))]
    pictures = [
        noisy(spoil(t, grey), sd, rng) if b else noisy(grey, 1.0, rng)
        for t, (grey, b) in enumerate(zip(clean, bad, strict=True))
    ]
    film: Any = Drawn(pictures)
    follower = prepare(film, lab.camera, lab.marks, dictionary="DICT_4X4_50", reference_s=1.15)
    return follow(film, follower, reference_s=1.15, stage="film")


def pulls(found: Followed, lab: Lab, code: int) -> Array:
    """Errors (n,2) of the places that one method gives, over their stated sd."""
    error = found.ideal - lab.camera.undistort(lab.pixels(lab.motion(BEND)[0]))
    chosen = found.method == code
    root = np.linalg.cholesky(found.covariance[chosen])
    return np.asarray(np.linalg.solve(root, error[chosen][..., None])[..., 0])


def test_ecc_in_weak_light(lab: Lab, clean: list[Array]) -> None:
    found = followed(lab, clean, lambda _, grey: 0.2 * grey, 6.0)
    bad = np.arange(SPOILT, len(BEND), 2)
    assert np.mean(found.method[bad] == Method.ECC) > 0.95
    good = np.setdiff1d(np.arange(len(BEND)), bad)
    assert np.isin(found.method[good], FIRM).all()
    low, high = band(208)  # as a plain fit states it, the pull is 1.25 times as large
    assert low < np.sqrt(np.mean(pulls(found, lab, Method.ECC) ** 2)) < high


def test_corners_in_stripes_of_shadow(lab: Lab, clean: list[Array]) -> None:
    def shadow(t: int, grey: Array) -> Array:
        return grey * np.where((ROWS + COLUMNS + 5 * t) % 46 < 23, 0.6, 1.0)

    found = followed(lab, clean, shadow, 1.0)
    pull = pulls(found, lab, Method.CORNERS)
    assert len(pull) > 15
    low, high = band(pull.size / 2, 2.0)  # of heavy tails: the sd of both axes comes from one misfit; two sds
    assert low < np.sqrt(np.mean(pull**2)) < high
    assert np.abs(pull).max() < 4.0


@pytest.mark.parametrize("grey", [35, 120, 210])
def test_a_covered_mark_is_not_placed(lab: Lab, clean: list[Array], grey: int) -> None:
    seen = lab.pixels(lab.motion(BEND)[0])

    def cover(t: int, picture: Array) -> Array:
        picture = picture.copy()
        for k, (x, y) in enumerate(np.round(seen[t]).astype(int)):
            edge = 15 - round(31 * (0.10, 0.15, 0.22, 0.30)[(t // 2 + k) % 4])
            hidden = picture[y - 22 : y + 23, x - 22 : x + 23]
            np.rot90(hidden, k)[:, 22 + edge :] = grey
        return picture

    found = followed(lab, clean, cover, 1.0)
    bad = found.method[SPOILT::2]
    assert not np.any(bad == Method.ECC)
    # One that shows its four corners well is placed by them, and not far off what it states.
    assert np.mean(bad == Method.LOST) > 0.6
    assert np.sum(bad == Method.CORNERS) <= 2
    assert np.all(np.abs(pulls(found, lab, Method.CORNERS)) < 4.0)


def test_a_wrong_edge_leaves_twice_the_error_of_the_centre() -> None:
    square = np.array([[10.0, 10.0], [40.0, 10.0], [40.0, 40.0], [10.0, 40.0]])
    last = corner_warp(square)
    wrong = square + np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 0.0], [0.0, 0.0]])
    warp, misfit = fallback.quad(wrong, last)
    np.testing.assert_allclose(warp[:2, 2] / warp[2, 2], [26.5, 25.0], atol=1e-5)
    np.testing.assert_allclose(misfit, 1.5, atol=1e-5)
    c, s = np.cos(0.7), np.sin(0.7)
    turned = (square - 25.0) @ np.array([[c, s], [-s, c]]) + (300.0, 200.0)
    warp, misfit = fallback.quad(turned, last)
    np.testing.assert_allclose(misfit, 0.0, atol=1e-5)
    np.testing.assert_allclose(warp, corner_warp(turned), atol=1e-4)


@pytest.fixture(scope="module")
def measured(
    lab: Lab, clean: list[Array], still: Any, tmp_path_factory: pytest.TempPathFactory
) -> Displacements:
    """One finger mark in weak light in six frames."""
    rng, tip = np.random.default_rng(3), lab.rows("finger")[2]
    path, seen = tmp_path_factory.mktemp("weak") / "weak.mkv", lab.pixels(lab.motion(BEND)[0])
    with Writer(path, (640, 400), fps=10.0, codec="rawvideo", crf=0) as writer:
        for t, grey in enumerate(clean):
            picture = noisy(grey, 1.0, rng)
            if 20 <= t < 26:
                x, y = np.round(seen[t, tip]).astype(int)
                spot = np.s_[y - 40 : y + 41, x - 40 : x + 41]
                picture[spot] = noisy(0.2 * grey[spot], 6.0, rng)
            writer.add(picture)
    from vision import Video

    return measure([View(Video(path), still, lab.camera)], lab.marks, reference=1.15)


def test_a_fallback_grows_the_covariance_and_is_said(lab: Lab, measured: Displacements) -> None:
    p = measured.names.index(lab.marks[lab.rows("finger")[2]].name)
    assert (measured.tracks.method[20:26, lab.rows("finger")[2]] == Method.ECC).all()
    true = lab.motion(BEND)[0][:, lab.rows("fixed", "finger")]
    error = (measured.value - (true - true[0]))[20:26, p][:, [0, 2]]
    sd = np.sqrt(np.diagonal(measured.covariance[:, p], axis1=1, axis2=2)[:, [0, 2]])
    assert np.all(sd[20:26] > 8.0 * sd[14:20].mean())  # 0.04 to 0.05 px beside some 0.002
    low, high = band(12, 2.0)
    assert low < np.sqrt(np.mean((error / sd[20:26]) ** 2)) < high
    said = [s for s in measured.notes if lab.marks[lab.rows("finger")[2]].name in s]
    assert said == [
        f"Marker {measured.names[p]!r} does not match its reference picture in 6 of 30 frames, first at "
        "2.000 s. It is placed by smoothed correlation (ECC) there, with a larger sd."
    ]
