"""Free vibrations of known frequency and damping in noise, drift and few frames; and those of a real beam."""

from typing import Any

from benchmarks.diagnosis.ringing_beam import foretold

import numpy as np
import pytest

from twin.formats.motionfile import read_motion
from twin.ringing.dampedsine import damped_sine
from twin.ringing.freevibration import Ringing, ringing, ringings
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


def test_a_step_that_creeps_by_more_than_it_rings_is_seen() -> None:
    """As the arm at 40 kPa: it fills within 0.15 s and creeps on by ten times what it rings."""
    t = np.arange(150) / 100
    late = np.maximum(t - 0.1, 0.0)
    w = 2 * np.pi * 8.0
    y = 20 * (1 - np.exp(-late / 0.12)) + 8 * (1 - np.exp(-late / 0.8)) - 2 * np.exp(-0.07 * w * late) * np.cos(w * late)
    y = np.where(t < 0.1, -2.0, y)[:, None, None] * WAY + 0.02 * np.random.default_rng(1).standard_normal((150, 3, 3))
    found = ringing(t, y)
    assert found.frequency == pytest.approx(8.0, abs=max(0.1, 4 * found.frequency_sd))
    assert found.damping == pytest.approx(0.07, abs=0.02)


def test_every_ringing_of_a_record_is_found_and_a_jump_is_none() -> None:
    lifted = np.linspace(0.5, 12, 100)[:, None, None] * WAY
    parts = [record(seed, hz=hz)[1] for seed, hz in ((1, 4.3), (2, 6.0), (3, 3.1))]
    y = np.concatenate([part for one in parts for part in (lifted, one)])
    y[1775:1778, 1] += 30.0  # a marker jumps while nothing moves
    found = ringings(np.arange(len(y)) / 100, y)
    assert [round(one.frequency, 1) for one in found] == [4.3, 6.0, 3.1]
    assert [1.5 < one.start - 6 * k < 2.2 for k, one in enumerate(found)] == [True] * 3
    t = np.arange(400) / 100
    quiet = np.clip(t - 1, 0, 1)[:, None, None] * WAY + 0.01 * np.random.default_rng(4).standard_normal((400, 3, 3))
    assert ringings(t, quiet) == ()


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


def test_a_real_arm_rings_after_its_steps_while_it_creeps(shared_data: Any) -> None:
    found = {}
    for mbar in (75, 200, 300, 350, 400):
        moved = read_motion(shared_data / "pneumatic_arm" / f"arm_{mbar:03d}mbar.csv", fps=100.0)
        assert moved.base == ("m1", "m2", "m3", "m4")
        (found[mbar],) = ringings(moved.time, moved.position)
    assert [round(one.frequency, 1) for one in found.values()] == [8.2, 8.3, 8.3, 8.3, 7.8]
    assert all(0.04 < one.damping < 0.09 for one in found.values())


@pytest.mark.slow
def test_the_falls_of_a_real_beam_foretell_how_it_rings(shared_data: Any) -> None:
    young, rows = foretold(shared_data / "real_beam", (6, 1, 2))
    assert [round(r.seen.frequency, 1) for r in rows] == [7.7, 4.4, 3.4]
    assert max(abs(r.apart[0]) for r in rows) < 0.06
    assert [0.04 < r.seen.damping < 0.09 for r in rows] == [True] * 3
    assert young == pytest.approx(0.262, abs=0.005)
