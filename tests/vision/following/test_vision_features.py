"""Places whose texture can be followed: their stated sd against shifts of drawn texture, and what is refused."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from vision.following.features import find_textures, taken


def wall(rng: np.random.Generator) -> np.ndarray:
    """A smooth grey texture (240,320), drawn finely enough to be shifted."""
    return 120.0 + 40.0 * gaussian_filter(rng.standard_normal((240, 320)), 2.5) * 2.5 * np.sqrt(4 * np.pi)


def picture(scene: np.ndarray, shift: tuple[float, float], noise: float, rng: np.random.Generator) -> np.ndarray:
    y, x = np.mgrid[: scene.shape[0], : scene.shape[1]]
    seen = map_coordinates(scene, [y - shift[1], x - shift[0]], order=3, mode="nearest")
    return np.clip(np.rint(seen + noise * rng.standard_normal(scene.shape)), 0, 255).astype(np.uint8)


def test_the_stated_sd_is_that_of_a_least_squares_shift() -> None:
    """One Gauss-Newton step from the known place, in the worse direction; 200 values tell an sd to 5 %."""
    rng = np.random.default_rng(3)
    scene, side, noise = 120.0 + (wall(rng) - 120.0) * 0.5, 21, 4.0
    (best, *_) = find_textures(picture(scene, (0, 0), noise, rng), side_px=side, allowed=np.ones(scene.shape, bool))
    x, y = (int(v) for v in best.centre)
    cut = np.s_[y - side // 2 : y + side // 2 + 1, x - side // 2 : x + side // 2 + 1]
    down, right = np.gradient(scene)
    slopes = np.stack([right[cut].ravel(), down[cut].ravel()], axis=1)
    errors = []
    for _ in range(200):
        seen = picture(scene, (0, 0), noise, rng)[cut].ravel() - scene[cut].ravel()
        errors.append(np.linalg.lstsq(slopes, seen, rcond=None)[0])
    worse = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(errors).T)).max())
    assert best.sd_px == pytest.approx(worse, rel=0.3)  # it blurs by 1 px before it looks for slopes


def test_what_is_plain_an_edge_or_like_its_neighbours_is_none() -> None:
    rng, every = np.random.default_rng(0), np.ones((240, 320), bool)
    plain = np.full((240, 320), 120.0)
    assert find_textures(picture(plain, (0, 0), 2.0, rng), side_px=25, allowed=every) == ()
    edge = np.where(np.arange(320) > 160, 200.0, 60.0) * np.ones((240, 1))
    assert find_textures(picture(edge, (0, 0), 1.0, rng), side_px=25, allowed=every) == ()
    y, x = np.mgrid[:240, :320]
    lattice = 120.0 + 50.0 * np.sin(2 * np.pi * x / 16.0) * np.sin(2 * np.pi * y / 16.0)
    assert find_textures(picture(lattice, (0, 0), 1.0, rng), side_px=25, allowed=every) == ()


def test_features_lie_where_they_may_best_first_and_apart() -> None:
    rng = np.random.default_rng(1)
    busy = taken((240, 320), np.array([[80.0, 120.0]]), np.array([60.0]))
    found = find_textures(picture(wall(rng), (0, 0), 1.0, rng), side_px=25, allowed=~busy, most=12)
    centre, sd = np.array([f.centre for f in found]), [f.sd_px for f in found]
    assert len(found) == 12
    assert sd == sorted(sd)
    assert (np.hypot(*(centre - (80.0, 120.0)).T) >= 60.0).all()
    apart = np.abs(centre[:, None] - centre[None]).max(axis=2) + np.diag([np.inf] * 12)
    assert apart.min() >= 12
