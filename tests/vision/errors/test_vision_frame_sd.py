"""How far frame marks are off their places, from what a homography or a rigid fit leaves of it."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vision.errors.sharederrors import frame_sd
from vision.placing.triangulation import rigid_fit
from vision.plane import plane_of

Array = NDArray[np.float64]
NOMINAL = np.array(
    [
        (-30.0, 30.0),
        (45.0, 34.0),
        (120.0, 30.0),
        (-30.0, -60.0),
        (45.0, -64.0),
        (120.0, -60.0),
        (-32.0, -15.0),
    ]
)
NAMES = [f"f{k}" for k in range(len(NOMINAL))]
SD, DRAWS = 0.2, 300  # mm


def left_by_homography(rng: np.random.Generator) -> tuple[Array, int, float]:
    """Residuals (f,2) mm of marks that one tilted camera sees, its 8 numbers, their noise mm2."""
    turn, _ = cv2.Rodrigues(rng.normal(0, 0.15, 3))
    matrix = np.array([[1300.0, 0, 320], [0, 1300.0, 200], [0, 0, 1]])
    homography = matrix @ np.column_stack([turn[:, :2], (-45.0, 15.0, 400.0)])
    true = NOMINAL + rng.normal(0, SD, NOMINAL.shape)
    mapped = np.column_stack([true, np.ones(len(true))]) @ homography.T
    return plane_of(NOMINAL, (mapped[:, :2] / mapped[:, 2:])[None]).residual[0], 8, 0.0


def left_by_rigid_fit(rng: np.random.Generator) -> tuple[Array, int, float]:
    """Residuals (f,3) mm of marks that two cameras place in their own frame, its 6 numbers."""
    nominal = np.insert(NOMINAL, 1, 12.0, axis=1)
    turn, _ = cv2.Rodrigues(rng.normal(0, 1.0, 3))
    held = (nominal + rng.normal(0, SD, nominal.shape)) @ turn.T + rng.normal(0, 300, 3)
    back, shift = rigid_fit(held, nominal)
    return held @ back.T + shift - nominal, 6, 0.0


def with_noise(rng: np.random.Generator) -> tuple[Array, int, float]:
    """As the homography leaves them, and as much noise of the pictures."""
    left, fitted, _ = left_by_homography(rng)
    again, _, _ = left_by_homography(rng)
    return left + again, fitted, SD**2


@pytest.mark.parametrize("left", [left_by_homography, left_by_rigid_fit, with_noise])
def test_what_a_fit_leaves_tells_the_sd_of_the_places(
    left: Callable[[np.random.Generator], tuple[Array, int, float]],
) -> None:
    rng, found, said, free = np.random.default_rng(5), [], 0, 0
    for _ in range(DRAWS):
        misfit, fitted, noise = left(rng)
        free = misfit.size - fitted
        # What is stated is so small that what is seen is always taken, here with the noise left in.
        found.append(frame_sd(misfit, NAMES, 1e-9, fitted=fitted)[0] ** 2 - noise)
        said += bool(frame_sd(misfit, NAMES, SD, fitted=fitted, noise=noise)[1])
    # chi2 with `free` degrees of freedom, 300 times, of SD**2 and the noise; 4 sds of the mean
    spread = 4.0 * np.sqrt(2.0 / (free * DRAWS)) * (1.0 + noise / SD**2)
    assert np.mean(found) / SD**2 == pytest.approx(1.0, abs=spread)
    assert said <= 3  # one in a thousand


def test_noise_is_taken_off_what_is_found() -> None:
    rng = np.random.default_rng(0)
    misfit = rng.normal(0, 0.5, (40, 2))
    plain, remark = frame_sd(misfit, ["a"] * 40, 0.1, fitted=8)
    less, _ = frame_sd(misfit, ["a"] * 40, 0.1, fitted=8, noise=0.09)
    assert less**2 == pytest.approx(plain**2 - 0.09)
    assert f"{plain:.3f} mm off" in remark[0]
    misfit[3] = np.nan  # a mark that is never seen tells nothing
    assert frame_sd(misfit, ["a"] * 40, 0.6, fitted=8) == (0.6, ())
