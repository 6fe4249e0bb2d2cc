"""A mark that is more blurred than at rest, or lit along a slope: its place and its sd; covers are left alone."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.pulls import band
from vision.errors.independenterrors import CLEARLY, misfit
from vision.errors.reencoding import SHIFT, _laid, _shifted
from vision.following import blurred, influence, registration
from vision.following.blurred import Adjusted
from vision.following.reference import Follower, prepare
from vision.following.tracking import centres, follow
from vision.following.tracks import Method
from vision.marks import px_per_unit

Array = NDArray[np.float64]
Lab = Any  # the fixture's class, see conftest.py
Paint = Callable[[Array, np.random.Generator], Array]
REST, DRAWS, NOISE = 12, 10, 1.5


class Frames:
    """Pictures that are read like a film."""

    def __init__(self, pictures: list[NDArray[np.uint8]]) -> None:
        self.pictures, self.path, self.width, self.height = pictures, "drawn", 640, 400
        self.time = np.arange(len(pictures)) / 10.0

    def frames(self) -> Any:
        yield from ((i, i / 10.0, picture) for i, picture in enumerate(self.pictures))


class Rest(NamedTuple):
    clean: Array  # (h,w) without noise
    follower: Follower
    place: Array  # (p,2) px, mean as registered at rest
    usual: Array  # (p,2,2) px2 stated there


def noisy(grey: Array, rng: np.random.Generator) -> NDArray[np.uint8]:
    return np.asarray(np.clip(np.rint(grey + rng.normal(0.0, NOISE, grey.shape)), 0, 255), dtype=np.uint8)


def registered(picture: Array | NDArray[np.uint8], follower: Follower) -> tuple[Array, Array, Array]:
    rows = np.arange(len(follower.coded))
    warp, match, _, grey = registration.register_quarters(
        np.asarray(picture, dtype=np.float32), registration.lens_of(follower.camera), follower.templates,
        follower.seed, px_per_unit(follower.seed), rows,
    )  # fmt: skip
    return warp, match, grey


@pytest.fixture(scope="module")
def rest(lab: Lab, tmp_path_factory: pytest.TempPathFactory) -> Rest:
    film = lab.film(tmp_path_factory.mktemp("clean") / "clean.mkv", np.zeros(1), noise=0.0)
    clean = next(iter(film.frames()))[2].astype(np.float64)
    rng = np.random.default_rng(0)
    pictures: Any = Frames([noisy(clean, rng) for _ in range(REST)])
    follower = prepare(pictures, lab.camera, lab.marks, dictionary="DICT_4X4_50", reference_s=1.15)
    own = follow(pictures, follower, reference_s=1.15, stage="film")
    assert (own.method == Method.REGISTERED).all()  # noise alone is adjusted for nothing
    return Rest(clean, follower, own.ideal.mean(axis=0), np.median(own.covariance, axis=0))


def defocus(grey: Array, rng: np.random.Generator) -> Array:
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), rng.uniform(0.7, 1.6)))


def motion(grey: Array, rng: np.random.Generator) -> Array:
    """3 or 5 px along a row or a column."""
    length = int(rng.choice([3, 5]))
    return np.asarray(cv2.blur(grey, (length, 1) if rng.random() < 0.5 else (1, length)))


def light(grey: Array, rng: np.random.Generator) -> Array:
    """5 to 15 % from one side of a mark of 31 px to the other, in the same way all over the picture."""
    x = np.arange(grey.shape[1]) if rng.random() < 0.5 else np.arange(grey.shape[0])[:, None]
    slope, period = rng.uniform(0.0015, 0.005), 200
    return np.asarray(grey * (0.75 + slope * (np.abs(x % (2 * period) - period) - period / 2)))


def adjusted(rest: Rest, paint: Paint) -> tuple[Array, Array, list[Adjusted | None]]:
    """Errors (n,2) px as registered, correlations (n,), and what became of the marks."""
    follower, rng = rest.follower, np.random.default_rng(3)
    error, match, found = [], [], []
    for _ in range(DRAWS):
        picture = noisy(paint(rest.clean, rng), rng)
        warp, alike, grey = registered(picture, follower)
        error.append(centres(warp, follower.centre) - rest.place)
        match.append(alike)
        found += blurred.adjust(
            picture, registration.lens_of(follower.camera), follower.templates, follower.spectra,
            np.arange(len(warp)), start=warp, usual=follower.usual, match=alike, grey=grey,
        )  # fmt: skip
    return np.concatenate(error), np.concatenate(match), found


@pytest.mark.parametrize("paint", [defocus, motion, light])
def test_blur_and_light_move_nothing_and_are_stated(rest: Rest, paint: Paint) -> None:
    plain, match, found = adjusted(rest, paint)
    tried = 1.0 - match**2 > blurred.EXCESS * np.tile(rest.follower.usual, DRAWS)
    kept = np.array([own is not None for own in found]) & tried
    assert kept.sum() > (0.9 if paint is not light else 0.5) * len(found)
    rows = np.tile(np.arange(len(rest.place)), DRAWS)[kept]
    own = [f for f, k in zip(found, kept, strict=True) if k and f is not None]
    error = np.array([
        centres(f.warp[None], rest.follower.centre[[p]])[0] - rest.place[p] for f, p in zip(own, rows, strict=True)
    ])  # fmt: skip
    stated = np.array([np.diagonal(f.covariance) for f in own])
    reference = np.diagonal(rest.usual, axis1=1, axis2=2)[rows] / REST
    # 13 marks at one place each: what the blur leaves unexplained repeats, so that 26 values count; two sds
    low, high = band(26, 2.0)
    assert low < np.sqrt(np.mean(error**2 / (stated + reference))) < high
    assert np.sqrt(np.mean(plain[kept] ** 2)) > 1.3 * np.sqrt(np.mean(error**2))
    growth = np.array([f.growth for f in own])
    assert (growth > (1.1 if paint is not light else 0.95)).mean() > 0.95


def test_a_cover_is_no_blur(rest: Rest, lab: Lab) -> None:
    at = lab.camera.distort(rest.place)

    def strip(grey: Array, rng: np.random.Generator) -> Array:
        """Paper over 8 % of each mark, from its left edge."""
        out = grey.copy()
        for x, y in at:
            out[round(y) - 22 : round(y) + 22, round(x) - 20 : round(x) - 13] = 210.0
        return out

    _, match, found = adjusted(rest, strip)
    assert (1.0 - match**2 > 10.0 * np.tile(rest.follower.usual, DRAWS)).all()
    assert all(own is None for own in found)


def test_what_no_blur_explains_is_dropped_at_the_first_step(
    rest: Rest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Coding leaves much in most marks of a film: none of them goes into the fit."""

    def fitted(*_: object) -> None:
        raise AssertionError("a mark with noise alone went into the fit")

    monkeypatch.setattr(blurred, "_adjust", fitted)
    _, match, found = adjusted(rest, lambda grey, rng: grey + rng.normal(0.0, 6.0, grey.shape))
    assert (1.0 - match**2 > blurred.EXCESS * np.tile(rest.follower.usual, DRAWS)).all()
    assert found == [None] * len(match)


def test_the_design_is_that_of_a_blurred_patch(rest: Rest) -> None:
    """Columns of blur and place against differences of patches that OpenCV has blurred."""
    known = rest.follower.spectra
    side, inside = known.side, np.s_[8:-8, 8:-8]

    def grey(variance: float) -> Array:
        patch = np.pad(rest.follower.templates.grey[2].reshape(side, side), blurred.PAD, mode="edge")
        wide = cv2.GaussianBlur(patch, (0, 0), np.sqrt(variance))
        return np.asarray(wide[blurred.PAD : -blurred.PAD, blurred.PAD : -blurred.PAD])

    design = blurred._design(known, 2, np.array([1.5, 0.0, 1.5])).T.reshape(-1, side, side)
    size = np.abs(design[blurred.CONTRAST]).max()
    # OpenCV's kernel is sampled and cut at 4 sd.
    np.testing.assert_allclose(design[blurred.CONTRAST][inside], grey(1.5)[inside], atol=0.01 * size)
    wider = (grey(1.6) - grey(1.4)) / 0.2
    np.testing.assert_allclose(
        (design[8] + design[10])[inside], wider[inside], atol=0.05 * np.abs(wider).max()
    )
    slope = np.gradient(grey(1.5), known.pitch, axis=1)
    np.testing.assert_allclose(design[2][inside], slope[inside], atol=0.1 * np.abs(slope).max())


def test_the_growth_by_a_blur_counts_however_little(rest: Rest) -> None:
    rng = np.random.default_rng(1)
    soft = [noisy(cv2.GaussianBlur(rest.clean, (0, 0), 0.9), rng) for _ in range(4)]
    pictures: Any = Frames([*[noisy(rest.clean, rng) for _ in range(REST)], *soft])
    found = follow(pictures, rest.follower, reference_s=1.15, stage="film")
    assert (found.method[REST:] == Method.ADJUSTED).all()
    worse = misfit(found)
    assert (worse[:REST] == 1.0).all()
    assert ((worse[REST:] > 1.1) & (worse[REST:] < CLEARLY)).mean() > 0.9
    # The same marks without their own sd for blur would be taken as usual.
    assert (misfit(replace(found, growth=np.ones(found.method.shape)))[REST:] == 1.0).mean() > 0.5


def test_a_blurred_mark_that_is_coded_again_is_adjusted_again(rest: Rest) -> None:
    rng = np.random.default_rng(2)
    soft: Any = cv2.GaussianBlur(rest.clean, (0, 0), 1.2)
    pictures: Any = Frames([*[noisy(rest.clean, rng) for _ in range(REST)], noisy(soft, rng)])
    found = follow(pictures, rest.follower, reference_s=1.15, stage="film")
    adjusted = found.method[-1] == Method.ADJUSTED
    assert adjusted.all()
    # Coding that errs by nothing: another noise on the shifted picture.
    again, plain = (
        centres(_laid(_shifted(noisy(soft, rng)), rest.follower, found.warp[-1], which), rest.follower.centre)
        for which in (adjusted, ~adjusted)
    )
    noise = np.sqrt(2.0 * np.mean(np.diagonal(found.covariance[-1], axis1=1, axis2=2)))
    assert np.sqrt(np.mean((again - found.ideal[-1]) ** 2)) < 1.4 * noise  # 26 values
    assert np.sqrt(np.mean((plain - found.ideal[-1]) ** 2)) > 1.8 * noise
    assert np.hypot(*SHIFT) > 1.0


def test_of_two_estimates_far_apart_the_larger_is_stated() -> None:
    """Moves of 0.05 px without a quarter, 0.005 px by its residual; and, where they are large, none is."""
    without = np.zeros((2, 4, 2, 1))
    without[:, 0, 0, 0] = 0.05, 2.0
    weight, linear = np.tile(np.eye(2), (2, 4, 1, 1)), np.tile(np.eye(2), (2, 1, 1))
    small, large = influence._leaning(without, 0.1 * without, weight, linear)[:, 1]
    assert small == pytest.approx(0.5 * 0.05**2)
    assert np.isinf(large)
    alike = influence._leaning(without, 0.5 * without, weight, linear)[:, 1]
    np.testing.assert_allclose(alike, 0.5 * 0.5 * np.array([0.05, 2.0]) ** 2)
