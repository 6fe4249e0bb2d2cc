"""A real silicone beam under hung weights: one load predicts the others, as docs/records/real-data.md tells."""

from typing import Any

import numpy as np
import pytest

from tests.fe import hungbeam as real

PAPER = 0.263824  # MPa, Young's modulus fitted to the same recordings (arXiv 2201.12560)


@pytest.mark.slow
def test_a_beam_fitted_to_one_weight_falls_as_far_as_measured_under_the_others(shared_data: Any) -> None:
    data, case = real.measured(shared_data / "real_beam"), real.beam((6, 1, 2))
    found = real.one(data, case, 1)
    assert abs(found["young_MPa"] - PAPER) < 3 * found["young_sd"]
    falls = np.array(found["residual_sd"])[:, 0]
    assert np.abs(falls).max() < 2
    everything = real.fitted(data, case, [0, 1, 2], (real.SILICONE,))
    assert 6 * everything.theta[0] == pytest.approx(PAPER, rel=0.05)
    assert real.chance(everything) > 0.05  # nothing is missing that these data could show


def test_a_motion_is_told_back_whatever_the_clamp_does() -> None:
    """Markers of a beam that falls, comes back and turns, on a base that is itself moved and turned."""
    rng = np.random.default_rng(1)
    held = rng.uniform(-20, 20, (6, 3)) + np.repeat([[95.0, 0, 0], [0.0, 0, 0]], 3, axis=0)
    middle = held[:3].mean(axis=0)
    tip = (held[:3] - middle) @ turned(12.0).T + middle + [-3.0, 0.0, -25.0]
    rest = np.concatenate([tip, held[3:]]) @ turned(1.5).T + [0.3, -0.1, 0.2]
    np.testing.assert_allclose(real.motion(held, real.settled(rest, held)), [25.0, 3.0, 12.0], atol=1e-9)


def turned(degrees: float) -> Any:
    """The rotation by which a beam along x turns its end down, -z."""
    a = np.radians(degrees)
    return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
