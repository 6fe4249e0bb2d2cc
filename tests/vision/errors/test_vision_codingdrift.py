"""What coding leaves in marks at rest and how it changes, told by frame marks in a film in which others move."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from vision.errors.codingdrift import FRESH, CodingDrift, coding_drift, courses, stretches
from vision.errors.independenterrors import Rest
from vision.errors.staticnoise import NoiseModel
from vision.plane import Plane, plane_of

Array = NDArray[np.float64]
NOMINAL = np.array([(x, z) for x in (0.0, 50.0, 100.0) for z in (0.0, 60.0)])
FRAMES, KEYS = 480, stretches(np.array([0, 240]), 480)
NOISE = 1e-4  # mm, white


def seen(error: Array) -> Plane:
    """Frame marks of errors (t,f,2) mm, 1 px/mm."""
    return plane_of(NOMINAL, NOMINAL + error)


def rest(points: int = 4) -> Rest:
    noise = NoiseModel(
        sd=np.full((points, 3), NOISE), rho=np.zeros((points, 3)), correlation=np.eye(3 * points),
        frames=300, codec_sd=np.zeros((points, 3)),
    )  # fmt: skip
    return Rest(noise, NOISE**2, NOISE**2, np.full((points, 2), 0.3 * NOISE**2), np.zeros(2))


def drawn(rng: np.random.Generator, frames: int, marks: int = len(NOMINAL), white: float = NOISE) -> Array:
    return white * rng.standard_normal((frames, marks, 2))


def told(film: Plane, rng: np.random.Generator, frozen: float) -> CodingDrift:
    quiet = seen(drawn(rng, 300))
    return coding_drift(film, quiet, drawn(rng, 300, 4), rest(), frozen, KEYS, [slice(0, 300)])


def test_what_a_key_frame_draws_anew_is_told_by_coding_and_by_frame_marks() -> None:
    found = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        error = drawn(rng, FRAMES)
        error[240:] += drawn(rng, 1, white=np.sqrt(2.0) * 1e-3)  # two draws of 0.001 mm
        found.append(told(seen(error), rng, 1e-6 / FRESH * 1.3).covariance[-1, -1])
    # 10 degrees of freedom a film, 4 of them random: 0.28 of a variance, 0.05 in the mean of 40
    assert np.mean(found) == pytest.approx(1e-6, rel=0.15)


def test_a_film_that_changes_between_key_frames_forgets() -> None:
    rng = np.random.default_rng(1)
    still, wanders = drawn(rng, FRAMES), drawn(rng, FRAMES)
    wanders += 6e-5 * np.cumsum(rng.standard_normal(wanders.shape), axis=0)
    quiet, stirred = (told(seen(error), rng, 1e-6) for error in (still, wanders))
    kept = [found.covariance[0, 5] / found.covariance[0, 0] for found in (quiet, stirred)]
    assert kept[0] > 0.9
    assert kept[1] < 0.7
    assert stirred.covariance[5, 6] == 0.0  # across the key frame
    jumps = still.copy()
    jumps[120:] += drawn(rng, 1, white=5e-4)
    jumped = told(seen(jumps), rng, 1e-6).covariance
    assert jumped[2, 3] < 0.9 * jumped[1, 2]  # most between the blocks where it happens


def test_flicker_is_what_the_film_has_and_the_static_film_has_not() -> None:
    rng = np.random.default_rng(2)
    found = told(seen(drawn(rng, FRAMES, white=3.0 * NOISE)), rng, 0.0)
    assert found.flicker == pytest.approx(8.0 * NOISE**2, rel=0.15)  # 4 * 480 differences
    assert told(seen(drawn(rng, FRAMES)), rng, 0.0).flicker < 0.2 * NOISE**2


def test_without_spare_frame_marks_what_coding_leaves_is_all_that_is_known() -> None:
    rng = np.random.default_rng(3)
    error = drawn(rng, FRAMES)
    error[:, 4:] = np.nan
    found = coding_drift(
        seen(error), seen(error[:300]), drawn(rng, 300, 4), replace(rest(), frame_variance=0.0), 1e-6, KEYS,
        [slice(0, 300)],
    )  # fmt: skip
    assert found.covariance[0, 0] == pytest.approx(FRESH * 1e-6, rel=0.05)
    assert 0.0 < found.covariance[0, 5] < found.covariance[0, 0]
    assert found.flicker < 1e-6 * NOISE**2


def test_courses_hold_the_covariance_relative_to_the_reference() -> None:
    rng = np.random.default_rng(4)
    found = told(seen(drawn(rng, FRAMES)), rng, 1e-6)
    steps = np.arange(FRAMES)
    course = courses(found, steps, np.arange(40))
    of = np.repeat(np.arange(len(found.blocks)), [b.stop - b.start for b in found.blocks])
    whole = found.covariance[np.ix_(of, of)]
    less = np.eye(FRAMES) - np.where(steps < 40, 1.0 / 40, 0.0)
    wanted = less @ whole @ less.T
    # what is left out is below a tenth of the noise in every course
    assert np.abs(course.T @ course - wanted).max() < 0.1 * NOISE**2 + 1e-3 * wanted.max()
    assert np.abs(course[:, :40]).max() < 1e-12
