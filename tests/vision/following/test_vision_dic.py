"""Registered subsets: known fields, pulls, occlusion, and a real picture pair with a commanded shift."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.pulls import band
from tests.vision.following import subsets as dic

Array = NDArray[np.float64]
SIZE = 240  # px
NOISE = 2.0  # grey levels


def speckled(
    place: Callable[[Array], Array], *, noise: float = NOISE, seed: int = 0, cover: float = 0.0
) -> NDArray[np.uint8]:
    """Picture of Gaussian blobs: the material point at pixel x is place(x); drawn in closed form, no warping."""
    rng = np.random.default_rng(5)
    blobs = rng.uniform(-40, SIZE + 40, (4200, 2))
    y, x = np.mgrid[0:SIZE, 0:SIZE].astype(np.float64)
    pixel = np.stack([x.ravel(), y.ravel()], axis=1)
    material = place(pixel)
    grey = np.zeros(len(pixel))
    order = np.argsort(material[:, 1], kind="stable")
    rows = material[order, 1]
    for bx, by in blobs:
        first, last = np.searchsorted(rows, [by - 9.0, by + 9.0])
        near = order[first:last]
        distance = (material[near, 0] - bx) ** 2 + (material[near, 1] - by) ** 2
        grey[near] += np.exp(-np.minimum(distance, 100.0) / (2 * 1.6**2))
    picture = (200.0 - 60.0 * np.minimum(grey, 2.5)).reshape(SIZE, SIZE)
    if cover:
        picture[:, : int(cover * SIZE)] = 120.0
    picture = picture + noise * np.random.default_rng([seed, 9]).standard_normal(picture.shape)
    return np.asarray(np.clip(np.rint(picture), 0, 255), dtype=np.uint8)


def measured(picture: NDArray[np.uint8], rough: tuple[float, float], *, subset: int = 25) -> dic.Field:
    return dic.field(speckled(lambda x: x), picture, subset=subset, step=18, rough=rough)


def affine(matrix: Array, shift: Array) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """Material point of a pixel, and displacement of a material point, for y = c + F (x - c) + shift."""
    middle = np.full(2, SIZE / 2)
    inverse = np.linalg.inv(matrix)

    def place(pixel: Array) -> Array:
        return np.asarray(middle + (pixel - middle - shift) @ inverse.T)

    def displacement(x: Array) -> Array:
        return np.asarray((x - middle) @ (matrix - np.eye(2)).T + shift)

    return place, displacement


def turned(angle: float) -> Array:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize(
    "matrix",
    [np.eye(2), np.array([[1.012, 0.004], [-0.003, 0.991]]), turned(0.15)],
    ids=["shift", "strain", "rotation"],
)
def test_a_known_field_is_measured_with_pulls_of_one(matrix: Array) -> None:
    place, displacement = affine(matrix, np.array([3.37, -2.81]))
    found = measured(speckled(place, seed=1), (3.0, -3.0))
    seen = np.isfinite(found.correlation)
    assert seen.sum() > 0.7 * len(seen)  # the others leave the picture
    error = found.displacement[seen] - displacement(found.centre[seen])
    chi2 = np.einsum("pi,pij,pj->p", error, np.linalg.inv(found.covariance[seen]), error) / 2
    # 100 subsets of 2 components that share a third of their pixels: sd of the mean about 0.1
    assert chi2.mean() == pytest.approx(1.0, abs=0.3)
    assert np.abs(error.mean(axis=0)).max() < 0.002
    assert found.gradient[seen].mean(axis=0) == pytest.approx(matrix - np.eye(2), abs=2e-4)


def test_what_is_covered_is_lost_and_nothing_is_invented() -> None:
    place, displacement = affine(np.eye(2), np.array([1.3, 0.4]))
    found = measured(speckled(place, seed=1, cover=0.45), (1.0, 0.0))
    hidden, shown = found.centre[:, 0] < 0.40 * SIZE, found.centre[:, 0] > 0.52 * SIZE
    lost = np.isnan(found.correlation)
    assert lost[hidden].all()
    assert np.isnan(found.displacement[lost]).all()
    assert np.isnan(found.covariance[lost]).all()
    assert (~lost[shown]).mean() > 0.85
    assert found.displacement[~lost] == pytest.approx(displacement(found.centre[~lost]), abs=0.05)


def test_shifts_of_real_pictures_are_the_commanded_ones(shared_data: Path) -> None:
    for shift, found in dic.trial(shared_data / "dic_challenge_5", 41):
        seen = np.isfinite(found.correlation)
        moved = found.displacement[seen]
        assert seen.sum() >= 120  # of 144; those at the picture's edge leave it
        assert np.abs(moved.mean(axis=0) - shift).max() <= 0.002
        assert moved.std(axis=0, ddof=1).max() <= 0.003
        stated = np.sqrt(found.covariance[seen][:, [0, 1], [0, 1]])
        pulls = (moved - moved.mean(axis=0)) / stated
        low, high = band(seen.sum())  # their two axes count as one: neighbours share pixels
        assert low < np.sqrt(np.mean(pulls**2)) < high


def bent(pixel: Array) -> Array:
    """Material points of pixels, of a field u_x = c x^2 / 2 round the middle: 0.055 px across a subset."""
    second, middle = 0.055 * 24.0 / 35.0**2, SIZE / 2
    out = pixel.copy()
    out[:, 0] = middle + (np.sqrt(1.0 + 2.0 * second * (pixel[:, 0] - middle)) - 1.0) / second
    return out


def test_a_strain_gradient_is_not_mistaken_for_a_shift() -> None:
    found = measured(speckled(bent, seed=2), (0.0, 0.0), subset=35)
    seen = np.isfinite(found.correlation)
    x = found.centre[seen, 0] - SIZE / 2
    error = found.displacement[seen] - np.stack([0.5 * 0.055 * 24.0 / 35.0**2 * x**2, 0 * x], axis=1)
    stated = np.sqrt(np.diagonal(found.covariance[seen], axis1=1, axis2=2))
    # An affine subset alone is 0.055 px off all over, and its pull is 4.5 and more.
    assert abs(np.median(error[:, 0])) < 0.005
    # 80 subsets that share half of their pixels; those at the picture's edge keep the error, and state it
    low, high = band(80)
    assert low < np.sqrt(np.mean((error / stated) ** 2)) < high
