"""The fixed markers are tested for themselves: which one moves, when, how much, and whether it matters."""

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Path
from twin import virtual
from twin.diagnosis.procedure import diagnose
from twin.files import plain
from twin.judging.frame import frame_test
from twin.targets import Array, Targets

BENCH = virtual.Bench(film_hz=5.0, sd=0.002)
POINTS = np.array([[60.0, 11.5, 0.0], [110.0, 11.5, 0.0]])
SLOPE = np.array([[-100.0, 0.0, -300.0], [-200.0, 0.0, -700.0]])  # mm per MPa


@pytest.fixture(scope="module")
def course() -> Path:
    return virtual.path(BENCH)


def drawn(course: Path, seed: int) -> Targets:
    u = course.at_output()[:, None, None] * SLOPE
    points = virtual.at_nodes(("middle", "tip"), (1, 2), POINTS)
    return virtual.noisy_targets(u, 0 * u + SLOPE, course, points=points, bench=BENCH, seed=seed, fixed=3)


def moved(t: Targets, shift: Array | float, *, name: str, axis: int = 0) -> Targets:
    value = t.value.copy()
    value[:, t.names.index(name), axis] += shift
    return replace(t, value=value)


@pytest.mark.parametrize("draws", [8, pytest.param(200, marks=pytest.mark.slow)])
def test_a_still_frame_is_called_still_at_the_stated_rate(course: Path, draws: int) -> None:
    found = [frame_test(drawn(course, seed)) for seed in range(draws)]
    p = np.array([f.p_value for f in found])
    # 0.01 is 2 of 200; 8 and more have a chance of 1e-3
    assert (p < 0.01).mean() < 0.04 if draws >= 200 else (p < 0.01).sum() <= 1
    assert not any(f.moves for f in found)
    assert found[0].sentence == "The fixed markers stay in place within their noise of 0.0021 mm."
    assert found[0].count == 3 * 2 * len(course.output)


def test_a_marker_that_slips_is_found_with_time_and_size(course: Path) -> None:
    t = drawn(course, 1)
    found = frame_test(moved(t, 0.02 * (t.time > 21.0), name="fixed1"))
    assert found.moves
    assert found.p_value < 1e-12
    assert found.sentence.startswith("The frame moves: marker fixed1 by +0.0")
    assert "mm in U1 from " in found.sentence
    assert found.place in found.sentence
    assert "leave this marker out" in found.sentence
    size, begin = float(found.sentence.split(" by ")[1].split()[0]), float(found.sentence.split(" from ")[1].split()[0])
    assert size == pytest.approx(0.02, rel=0.15)  # the error of the reference's mean takes a little of it
    assert begin >= 21.0 - 42.4 / 8


def test_a_frame_that_moves_is_diagnosed_as_such_before_any_solve(course: Path) -> None:
    t = drawn(course, 1)
    slipped = moved(t, 0.02 * (t.time > 21.0), name="fixed1")
    found = diagnose(None, (), slipped, seed=0, start=np.zeros(0))  # type: ignore[arg-type]
    assert found.verdict.startswith("cannot test: the frame moves: marker fixed1 by +0.0")
    assert found.named == ()


def test_a_sway_with_the_pressure_is_found(course: Path) -> None:
    t = drawn(course, 2)
    found = frame_test(moved(t, -0.3 * t.pressure, name="fixed2", axis=2))
    assert found.moves
    assert "marker fixed2 by -0.00" in found.sentence
    assert "in U3" in found.sentence
    assert "held" in found.sentence


def test_what_is_significant_and_small_is_said_and_no_refusal(course: Path) -> None:
    t = drawn(course, 3)
    found = frame_test(moved(t, 0.003 * (t.time > 21.0), name="fixed1"))
    assert found.p_value < 1e-3
    assert not found.moves
    assert 0 < found.misfit < 0.3
    assert "too little to change a verdict" in found.sentence
    assert json.loads(json.dumps(plain(found)))["moves"] is False


def test_what_moves_the_finger_is_not_the_frames(course: Path) -> None:
    t = drawn(course, 4)
    assert frame_test(moved(t, 5.0, name="tip")) == frame_test(t)


def test_without_fixed_markers_or_noise_it_says_so(make_targets: Callable[..., Targets]) -> None:
    t = make_targets()
    found = frame_test(t)
    assert found.sentence == "Whether the frame moves cannot be tested: there is no noise model."
    assert found.p_value is None
    alone = frame_test(make_targets(valid=t.valid & ~t.fixed[:, None]))
    assert "no fixed marker was measured" in alone.sentence
    assert not alone.moves
