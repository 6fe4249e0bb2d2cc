"""Registration by itself: places, the covariance that it states, what it refuses; markers in 4K film."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tests.pulls import band
from vision import Camera, Mark
from vision.dictionaries import dictionary_of
from vision.following import registration
from vision.following.reference import prepare
from vision.following.tracking import follow
from vision.following.tracks import FIRM
from vision.kinds import CodedMarker

Array = NDArray[np.float64]
HALF, SIDE = 1.2, 40  # of the patch: local units, points


def drawn(warp: Array, size: int, lens: Array | None = None) -> Array:
    """A smooth pattern of cosines under a warp, one value a pixel: known everywhere, no sampling."""
    y, x = np.mgrid[:size, :size].astype(np.float64)
    if lens is not None:
        flat = cv2.undistortPoints(
            np.stack([x.ravel(), y.ravel()], axis=-1)[:, None] - lens[9:],
            np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1.0]]),
            lens[4:9],
        )[:, 0]
        x, y = (flat * lens[:2] + lens[2:4]).T.reshape(2, size, size)
    local = np.linalg.inv(warp) @ np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
    u, v = local[:2] / local[2]
    grey = 120 + 50 * np.cos(4 * u + 1) * np.cos(5 * v) + 30 * np.sin(7 * u - 3 * v)
    return np.asarray(grey.reshape(size, size))


def at(x: float, y: float, angle: float = 0.0, tilt: float = 0.0) -> Array:
    c, s = 16.0 * np.cos(angle), 16.0 * np.sin(angle)
    return np.array([[c, -s, x], [s, c, y], [tilt, -tilt, 1.0]]) + np.outer([x, y, 0], [tilt, -tilt, 0])


def fitted(
    first: Array, second: Array, near: Array, lens: Array, seed: int = 0
) -> tuple[Array, Array, Array]:
    """Centre, its stated covariance and correlation of the second picture on the first (at 32, 32)."""
    grid = registration.local_grid(SIDE, HALF)
    start = at(32.0, 32.0)[None]
    reference = registration.templates(
        registration.patches(first.astype(np.float32), lens, start, grid), grid
    )
    warp, match = registration.register(
        second.astype(np.float32), lens, reference, near[None], np.array([16.0]), np.zeros(1, int)
    )
    linear = warp[:, :2, :2] - warp[:, :2, 2:] * warp[:, 2:, :2]
    return warp[0], registration.centre_covariance(reference, linear, match)[0], match[0]


@pytest.mark.parametrize("angle", [0.0, 0.6, 1.5])
def test_a_turned_shifted_tilted_patch(angle: float) -> None:
    true = at(35.37, 30.81, angle, 0.01)
    near = true + np.array([[0.5, 0.4, 1.0], [-0.5, 0.3, -1.2], [0, 0, 0]])
    warp, _, match = fitted(drawn(at(32.0, 32.0), 64), drawn(true, 64), near, registration.NO_LENS)
    np.testing.assert_allclose(warp[:2, 2], true[:2, 2], atol=2e-3)  # the spline's own error
    assert match > 0.9999


def test_the_lens_is_taken_out() -> None:
    lens = np.array([90.0, 88.0, 30.0, 33.0, -0.2, 0.05, 0.003, -0.002, 0.01, 0.4, -0.3])
    true = at(35.0, 31.0, 0.2)
    warp, _, _ = fitted(drawn(at(32.0, 32.0), 64, lens), drawn(true, 64, lens), true + 0.01, lens)
    np.testing.assert_allclose(warp[:2, 2], true[:2, 2], atol=2e-3)


def test_stated_covariance_is_that_of_the_errors() -> None:
    rng = np.random.default_rng(5)
    pulls = []
    for _ in range(150):
        true = at(*(32 + rng.uniform(-2, 2, 2)), rng.uniform(-1.5, 1.5))
        noisy = drawn(true, 64) + rng.normal(0, 3.0, (64, 64))
        warp, covariance, _ = fitted(drawn(at(32.0, 32.0), 64), noisy, true, registration.NO_LENS)
        pulls.append(np.linalg.solve(np.linalg.cholesky(covariance), warp[:2, 2] - true[:2, 2]))
    low, high = band(300)
    assert low < np.std(pulls) < high


def test_brightness_and_contrast_do_no_harm() -> None:
    first, true = drawn(at(32.0, 32.0), 64), at(33.3, 31.2, 0.3)
    warp, _, match = fitted(first, 0.5 * drawn(true, 64) + 60, true + 0.01, registration.NO_LENS)
    np.testing.assert_allclose(warp[:2, 2], true[:2, 2], atol=2e-3)
    assert match > 0.9999


def test_what_cannot_be_laid_is_refused() -> None:
    first = drawn(at(32.0, 32.0), 64)
    for near in (at(5.0, 32.0), at(-500.0, 32.0), np.full((3, 3), np.nan), at(32.0, 32.0, 0.0, 0.9)):
        assert fitted(first, first, near, registration.NO_LENS)[2] == 0.0
    assert fitted(first, 240.0 - first, at(32.0, 32.0), registration.NO_LENS)[2] == 0.0  # a negative
    assert fitted(first, np.full((64, 64), 90.0), at(32.0, 32.0), registration.NO_LENS)[2] == 0.0


@dataclass(frozen=True)
class Drawn:
    """Pictures that are read like a film."""

    pictures: list[NDArray[np.uint8]]
    path: Path = Path("drawn")
    width: int = 3840
    height: int = 2160

    @property
    def time(self) -> Array:
        return np.arange(len(self.pictures)) / 10.0

    def frames(self) -> Iterator[tuple[int, float, NDArray[np.uint8]]]:
        yield from ((i, i / 10.0, picture) for i, picture in enumerate(self.pictures))


def small(marker: int, shift: int) -> Array:
    """A marker of 22 px on white, 24 texels a pixel, blurred by 0.8 px, some texels to the right."""
    bits = np.pad(dictionary_of("DICT_4X4_50").generateImageMarker(marker, 6) / 255.0, 2, constant_values=1.0)
    large = np.roll(gaussian_filter(np.kron(bits, np.ones((88, 88))), 0.8 * 24), shift, axis=1)
    large = np.pad(large, ((0, -len(large) % 24), (0, -len(large) % 24)), constant_values=1.0)
    return 40.0 + 160.0 * large.reshape(len(large) // 24, 24, -1, 24).mean(axis=(1, 3))


def test_small_markers_of_a_4k_film_are_found_and_followed() -> None:
    camera = Camera(np.diag([4000.0, 4000.0, 1.0]), np.zeros(5), (3840, 2160))
    spots = [(x, y) for y in (300, 1800) for x in (300, 1500, 2600, 3600)]
    shifts = [7] * 12 + [27, 47]  # of 24 texels a pixel
    rng, blocks = np.random.default_rng(0), {s: [small(i, s) for i in range(8)] for s in set(shifts)}
    pictures = []
    for shift in shifts:
        picture = np.full((2160, 3840), 200, dtype=np.uint8)
        for (x, y), block in zip(spots, blocks[shift], strict=True):
            noisy = block + rng.normal(0, 1.0, block.shape)
            picture[y : y + len(block), x : x + len(block)] = np.rint(noisy)
        pictures.append(picture)
    marks = [
        Mark(f"m{i}", CodedMarker(i, 5.0), (float(x), 0.0, float(y)), "frame")
        for i, (x, y) in enumerate(spots)
    ]
    film: Any = Drawn(pictures)
    follower = prepare(film, camera, marks, dictionary="DICT_4X4_50", reference_s=1.15)
    followed = follow(film, follower, reference_s=1.15, stage="film")
    assert np.isin(followed.method, FIRM).all()
    moved = followed.ideal[13] - followed.ideal[:12].mean(axis=0)
    np.testing.assert_allclose(moved, np.tile([40 / 24, 0.0], (8, 1)), atol=0.02)
