"""Free vibrations of known frequency and damping in noise, drift and few frames; and those of a real beam."""

from typing import Any

from benchmarks.diagnosis.ringing_beam import foretold

import numpy as np
import pytest

from twin.ringing.dampedsine import damped_sine
from twin.ringing.freevibration import Ringing, ringing
from twin.targets import Array

HZ, RATIO = 4.3, 0.06
WAY = np.array([[0.2, 0.05, 1.0], [0.18, 0.04, 0.9], [0.1, 0.0, 0.5]])  # of three markers


def record(
    seed: int, *, noise: float = 0.02, rate: float = 100.0, hz: float = HZ, ratio: Any = RATIO, uneven: float = 0.0
) -> tuple[Array, Array]:
    """Times (t,) s and markers (t, 3, 3) mm: held at 12 mm for half a second, let go, creeping by half a mm."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(5 * rate)) / rate + uneven * rng.uniform(-0.5, 0.5, int(5 * rate)) / rate
    late = np.maximum(t - 0.5, 0.0)
    w = 2 * np.pi * hz
    swing = np.exp(-ratio * w / np.sqrt(1 - ratio**2) * late) * np.cos(w * late)
    moved = 12 * swing + 0.5 * (1 - np.exp(-late / 1.5))
    y = moved[:, None, None] * WAY
    return t, y + noise * rng.standard_normal(y.shape)


def test_frequency_and_damping_are_known_as_well_as_is_said() -> None:
    found = [ringing(*record(seed, noise=(0.02, 0.2)[seed % 2])) for seed in range(40)]
    pieces = [p for r in found for p in r.pieces]
    assert len(pieces) > 100
    for values in (
        [(p.frequency - HZ) / p.sd[0] for p in pieces],
        [(p.damping - RATIO) / p.sd[1] for p in pieces],
        [(r.frequency - HZ) / r.frequency_sd for r in found],
        [(r.damping - RATIO) / r.damping_sd for r in found],
    ):
        assert 0.75 < np.std(values) < 1.25
        assert abs(np.mean(values)) < 0.4
    assert max(r.frequency_sd for r in found[::2]) < 0.01
    assert max(r.damping_sd for r in found[::2]) < 0.002


def test_uneven_frames_and_lost_markers_are_no_harm() -> None:
    t, y = record(1, uneven=0.6)
    y[60:90:3, 1] = np.nan
    found = ringing(t, y)
    assert found.frequency == pytest.approx(HZ, abs=4 * found.frequency_sd)
    assert found.damping == pytest.approx(RATIO, abs=4 * found.damping_sd)


def test_what_lasts_for_several_frames_counts_as_fewer_values() -> None:
    """Noise that keeps its sign makes the sd grow as much as the scatter does."""
    errors = []
    for seed in range(40):
        rng, t = np.random.default_rng(seed), np.arange(60) / 100
        e = rng.standard_normal((60, 2))
        for k in range(1, 60):
            e[k] = 0.7 * e[k - 1] + np.sqrt(1 - 0.7**2) * e[k]
        y = (np.exp(-t) * np.cos(2 * np.pi * HZ * t))[:, None] + 0.05 * e
        piece = damped_sine(t, y, near=HZ)
        errors.append((piece.frequency - HZ) / piece.sd[0])
    assert 0.8 < np.std(errors) < 1.35  # 2.3 if every frame counted


def test_damping_that_grows_with_amplitude_is_told() -> None:
    """Cubic damping: the ratio is RATIO plus 0.005 a mm of amplitude."""
    rate, dt, w = 100.0, 1e-4, 2 * np.pi * HZ
    x, v, out, size = 12.0, 0.0, [], 12.0
    for k in range(int(4 / dt)):
        if k % 100 == 0:
            out.append(x)
        size = float(np.hypot(x, v / w))
        v += dt * (-(w**2) * x - 2 * (RATIO + 0.005 * size) * w * v)
        x += dt * v
    held = np.full(50, 12.0)
    y = np.concatenate([held, out])[:, None, None] * np.array([[0.0, 0.0, 1.0]])
    y = y + 0.005 * np.random.default_rng(1).standard_normal(y.shape)
    found = ringing(np.arange(len(y)) / rate, y)
    assert found.damping_slope == pytest.approx(0.005, rel=0.25)
    assert found.damping - found.damping_slope * found.amplitude == pytest.approx(RATIO, abs=0.006)


def test_what_swings_on_when_the_vibration_is_gone_is_not_taken_for_it() -> None:
    t, y = record(1, noise=0.003)
    thread = 0.1 * np.sin(2 * np.pi * 4.9 * np.maximum(t - 0.5, 0.0))
    found = ringing(t, y + thread[:, None, None] * WAY)
    assert found.pieces[-1].frequency == pytest.approx(4.9, abs=0.1)
    assert found.frequency == pytest.approx(HZ, abs=0.01)
    assert abs(found.frequency_slope) < 0.005
    assert found.damping == pytest.approx(RATIO, abs=0.006)


def test_too_few_frames_a_period_are_told() -> None:
    assert ringing(*record(1)).doubt == ""
    # at 6 frames a second 4.3 Hz look like 1.7
    slow: Ringing = ringing(*record(1, rate=6.0, ratio=0.005))
    assert slow.frequency == pytest.approx(6 - HZ, abs=0.05)
    assert f"a vibration of {6 - slow.frequency:.4g} Hz would look the same" in slow.doubt
    assert "film with 43 frames a second" in slow.doubt


def test_what_does_not_ring_is_refused() -> None:
    t = np.arange(300) / 100
    y = (1 - np.exp(-t))[:, None, None] * WAY + 1e-3 * np.random.default_rng(1).standard_normal((300, 3, 3))
    with pytest.raises(ValueError, match="no free vibration"):
        ringing(t, y)
    with pytest.raises(ValueError, match="wanted 20 or more"):
        ringing(t[:10], y[:10])
    with pytest.raises(ValueError, match="too few"):
        damped_sine(t[:4], y[:4, 0], near=HZ)


@pytest.mark.slow
def test_the_falls_of_a_real_beam_foretell_how_it_rings(shared_data: Any) -> None:
    young, rows = foretold(shared_data / "real_beam", (6, 1, 2))
    assert [round(r.seen.frequency, 1) for r in rows] == [7.7, 4.4, 3.4]
    assert max(abs(r.apart[0]) for r in rows) < 0.06
    assert [0.04 < r.seen.damping < 0.09 for r in rows] == [True] * 3
    assert young == pytest.approx(0.262, abs=0.005)
