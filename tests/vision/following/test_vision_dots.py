"""Dots: centre, stated covariance, eccentricity, and which is which."""

from collections.abc import Sequence

from benchmarks.tracking.printeddots import look, photograph, rim, trial

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tests.pulls import band
from vision.camera import Camera
from vision.following.dots import eccentricity, find_dots, unknown_dots
from vision.following.identity import DotMemory, assign, follow_dots, start
from vision.following.tracking import _unknown

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
SIZE = (160, 90)
CAMERA = Camera(np.diag([1000.0, 1000.0, 1.0]), np.zeros(5), SIZE)
FINE = 8  # samples along a pixel


def picture(
    centres: Sequence[Sequence[float]] | Array,
    radius: float,
    rng: np.random.Generator,
    *,
    dark: bool = True,
    bar: tuple[int, int] | None = None,
    noise: float = 2.0,
) -> Image:
    """Discs by 64 samples a pixel, blurred by 0.8 px, with noise; a bar covers columns."""
    y, x = (np.mgrid[: SIZE[1] * FINE, : SIZE[0] * FINE] + 0.5) / FINE - 0.5
    cover = np.zeros(x.shape)
    for a, b in centres:
        cover[np.hypot(x - a, y - b) < radius] = 1.0
    cover = cover.reshape(SIZE[1], FINE, SIZE[0], FINE).mean(axis=(1, 3))
    grey = gaussian_filter(200.0 - 160.0 * cover, 0.8)
    if bar:
        grey[:, bar[0] : bar[1]] = 120.0
    grey = grey if dark else 255.0 - grey
    return np.clip(np.rint(grey + noise * rng.standard_normal(grey.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("diameter", "dark"), [(8.0, True), (12.0, False), (20.0, True)])
def test_centre_and_its_stated_covariance(diameter: float, dark: bool) -> None:
    rng = np.random.default_rng(int(diameter))
    errors, variances, spreads = [], [], []
    for _ in range(12):
        centres = np.array([[25.0 + 40 * i, 25.0 + 40 * j] for i in range(4) for j in range(2)])
        centres[:, 1] = np.minimum(centres[:, 1], 64.0)
        centres += rng.uniform(-1, 1, centres.shape)
        image = picture(centres, 0.5 * diameter, rng, dark=dark)
        for centre in centres:
            guess = np.round(centre)
            (dot,) = find_dots(image, CAMERA, guess, np.full(2, 0.5 * diameter), search=4.0, dark=dark)
            errors.append(dot.centre - centre)
            variances.append(dot.variance)
            spreads.append(np.diag(dot.spread))
            assert dot.radius == pytest.approx(0.5 * diameter, rel=0.06)
    sd = np.sqrt(np.array(spreads) * np.mean(variances))
    assert np.sqrt(np.mean(np.square(errors))) < {8.0: 0.008, 12.0: 0.0065, 20.0: 0.005}[diameter]
    low, high = band(192)
    assert low < np.sqrt(np.mean(np.square(np.array(errors) / sd))) < high


@pytest.mark.parametrize("dark", [True, False])
def test_dots_of_which_nothing_is_known_are_found(dark: bool) -> None:
    centres = np.array([(30.3, 40.1), (70.8, 30.2), (120.4, 60.7)])
    found = unknown_dots(picture(centres, 4.3, np.random.default_rng(2), dark=dark))
    assert [dot.dark for dot in found] == [dark] * 3
    np.testing.assert_allclose(sorted(dot.centre.tolist() for dot in found), centres, atol=0.1)
    assert [dot.radius for dot in found] == pytest.approx([4.3] * 3, abs=0.3)
    assert not unknown_dots(picture(centres[:0], 4.3, np.random.default_rng(2), bar=(60, 70)))


@pytest.mark.parametrize("radius", [2.5, 4.0, 9.0, 20.0, 49.0, 60.0])
def test_a_printed_dot_of_any_size_is_found(radius: float) -> None:
    seen, shifts = trial(radius, 8 if radius < 20.0 else 3, seed=int(radius))
    assert seen == (8 if radius < 20.0 else 3)
    assert np.abs(shifts).max() < 0.12  # most of a rough rim's pull is the same in both pictures


@pytest.mark.parametrize("radius", [18.0, 49.0])
def test_a_covered_dot_is_no_dot(radius: float) -> None:
    rng, side = np.random.default_rng(4), 2 * int(1.7 * radius + 8.0)
    edge, centre = rim(radius, rng), np.full(2, 0.5 * side)
    assert look(photograph(edge, centre, side, rng), radius, centre) is not None
    assert look(photograph(edge, centre, side, rng, covered=0.4), radius, centre) is None


def test_no_dot_is_no_dot() -> None:
    rng = np.random.default_rng(1)
    image = picture([(60.0, 40.0)], 15.0, rng)
    assert (
        find_dots(image, CAMERA, np.array([60.0, 40.0]), np.full(2, 6.0), search=6.0, dark=True) == []
    )  # not that size
    assert (
        find_dots(image, CAMERA, np.array([60.0, 40.0]), np.full(2, 15.0), search=6.0, dark=False) == []
    )  # not light
    assert find_dots(image, CAMERA, np.array([-300.0, 40.0]), np.full(2, 6.0), search=6.0, dark=True) == []
    flat = np.full((90, 160), 120, dtype=np.uint8)
    assert find_dots(flat, CAMERA, np.array([60.0, 40.0]), np.full(2, 6.0), search=6.0, dark=True) == []


def test_eccentricity_of_a_projected_circle() -> None:
    homography = np.array([[3.1, 0.2, 400.0], [-0.1, 2.9, 300.0], [8e-4, -5e-4, 1.0]])
    place, radius = np.array([[12.0, -7.0], [40.0, 20.0]]), np.array([6.0, 3.0])
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    for at, r, off in zip(place, radius, eccentricity(homography, place, radius), strict=True):
        rim = at + r * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        u = np.column_stack([rim, np.ones(len(rim))]) @ homography.T
        x, y = (u[:, :2] / u[:, 2:]).T
        middle = np.array([x.mean(), y.mean()])
        a = np.column_stack(
            [(x - middle[0]) ** 2, (x - middle[0]) * (y - middle[1]), (y - middle[1]) ** 2, x, y]
        )
        a[:, 3:] -= middle
        p = np.linalg.lstsq(a, np.ones(len(a)), rcond=None)[0]
        ellipse = middle + np.linalg.solve([[2 * p[0], p[1]], [p[1], 2 * p[2]]], -p[3:])
        c = homography @ [*at, 1.0]
        np.testing.assert_allclose(off, ellipse - c[:2] / c[2], atol=1e-7)
        assert np.hypot(*off) > 0.005  # else nothing was compared


def test_assignment_is_of_least_distance_or_none() -> None:
    guess = np.array([[10.0, 10.0], [30.0, 10.0]])
    gate = np.full(2, 8.0)
    chosen, doubt = assign(guess, np.array([[31.0, 10.0], [11.0, 10.0]]), gate)
    assert (list(chosen), list(doubt)) == ([1, 0], [0, 0])
    chosen, doubt = assign(guess, np.array([[12.0, 10.0], [13.0, 12.0]]), gate)  # two places for the first
    assert (list(chosen), list(doubt)) == ([-1, -1], [1, 0])
    near = np.array([[10.0, 10.0], [14.0, 10.0]])
    chosen, doubt = assign(near, np.array([[12.0, 9.0], [12.0, 11.0]]), gate)  # which is which?
    assert (list(chosen), list(doubt)) == ([-1, -1], [2, 2])
    chosen, doubt = assign(near, np.array([[12.0, 10.0]]), gate)  # one place for two
    assert (list(chosen), list(doubt)) == ([-1, -1], [2, 2])
    chosen, _ = assign(guess, np.empty((0, 2)), gate)
    assert list(chosen) == [-1, -1]
    assert list(assign(guess, np.array([[10.0, 20.0]]), gate)[0]) == [-1, -1]  # beyond the gate


def followed(paths: Array, radius: float, bars: dict[int, tuple[int, int]]) -> tuple[Array, DotMemory]:
    """Errors (t,q) px of dots on paths (t,q,2), NaN where lost, and the last memory."""
    rng, count = np.random.default_rng(3), paths.shape[1]
    memory = start(
        paths[0],
        rows=np.arange(count),
        body=np.ones(count, dtype=bool),
        axes=np.full((count, 2), radius),
        dark=np.ones(count, dtype=bool),
    )
    errors = []
    for t, places in enumerate(paths):
        image = picture(places, radius, rng, bar=bars.get(t))
        memory, dots = follow_dots(image, CAMERA, memory, np.full((count, 2), np.nan))
        errors.append(
            [np.nan if d is None else np.hypot(*(d.centre - c)) for d, c in zip(dots, places, strict=True)]
        )
    return np.array(errors), memory


def row(count: int) -> Array:
    return np.stack([20.0 + 26.0 * np.arange(count), np.full(count, 30.0)], axis=-1)


def test_dots_under_a_bar_come_back_under_their_own_names() -> None:
    t = np.arange(26)[:, None]
    bend = 0.0006 * (row(5)[:, 0] - 20.0) ** 2
    paths = np.repeat(row(5)[None], 26, axis=0)
    paths[..., 1] += bend * np.minimum(t, 20) / 5.0
    paths[..., 0] += np.where(t > 4, 1.6 * (t - 4), 0.0).clip(0, 24)  # nearly to the neighbour's place
    bars = dict.fromkeys(range(6, 18), (60, 112))  # hides two neighbours at a time
    errors, _ = followed(paths, 5.0, bars)
    assert np.isnan(errors[8:16]).any(axis=1).all()
    assert not np.isnan(errors[20:]).any()
    assert np.nanmax(errors) < 0.2  # of 26 px to the neighbour; a bar's edge may cut a rim


@pytest.mark.parametrize("turns_back", [False, True])
def test_dots_that_touch_are_lost_not_swapped(turns_back: bool) -> None:
    shift = np.arange(24) * 2.0
    shift = np.minimum(shift, 46.0 - shift) if turns_back else shift
    paths = np.zeros((24, 3, 2))
    paths[:, 0] = np.stack([40.0 + shift, np.full(24, 40.0)], axis=-1)
    paths[:, 1] = np.stack([80.0 - shift, np.full(24, 42.0)], axis=-1)
    paths[:, 2] = (120.0, 20.0)
    errors, memory = followed(paths, 6.0, {})
    assert np.nanmax(errors) < 0.2
    assert np.isnan(errors[-6:, :2]).all()
    assert list(memory.open) == [True, True, False]
    assert not np.isnan(errors[:, 2]).any()


def test_a_dot_that_was_never_seen_stays_lost() -> None:
    paths = np.repeat(row(3)[None], 3, axis=0)
    rng = np.random.default_rng(0)
    seed = paths[0].copy()
    seed[1] = np.nan
    memory = start(
        seed,
        rows=np.arange(3),
        body=np.ones(3, dtype=bool),
        axes=np.full((3, 2), 5.0),
        dark=np.ones(3, dtype=bool),
    )
    memory, dots = follow_dots(picture(paths[0], 5.0, rng), CAMERA, memory, np.full((3, 2), np.nan))
    assert [dot is None for dot in dots] == [False, True, False]
    assert list(memory.open) == [False, False, False]


def test_a_lost_name_is_said() -> None:
    unknown = np.zeros((4, 2), dtype=bool)
    unknown[2:, 1] = True
    (said,) = _unknown(["a", "b"], unknown, np.array([0.0, 0.1, 0.2, 0.3]))
    assert said.startswith("Dot 'b' came too near to another dot at 0.200 s")
