"""A film at a glance: how its pixels and its light change from frame to frame."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from vision.camera import Image
from vision.following.preview import _changes


class Film:
    """Frames of one noisy picture under a light of so many shares of its grey level."""

    def __init__(self, light: list[float]) -> None:
        rng = np.random.default_rng(3)
        picture = 100.0 + 50.0 * rng.random((240, 320))
        self.pictures = [(f * picture + rng.standard_normal(picture.shape)).round().astype(np.uint8) for f in light]

    def frames(self, begin: int, end: int) -> Iterator[tuple[int, float, Image]]:
        yield from ((k, 0.1 * k, image) for k, image in enumerate(self.pictures[begin:end]))


@pytest.mark.parametrize(("light", "change"), [([1.0] * 8, 0.0), ([1.0, 0.96] * 4, 0.04), ([0.9, 1.0, 1.1, 1.0] * 2, 0.1)])
def test_a_light_that_flickers_changes_the_mean_grey_level(light: list[float], change: float) -> None:
    film: Any = Film(light)
    pixels, share = _changes(film, len(light))
    assert share == pytest.approx(change, rel=0.05, abs=1e-3)
    assert pixels == pytest.approx(1.13 if not change else 125 * change, rel=0.2)  # 2 / sqrt(pi) of white noise


def test_one_frame_changes_by_nothing_known() -> None:
    film: Any = Film([1.0])
    assert np.isnan(_changes(film, 1)).all()
