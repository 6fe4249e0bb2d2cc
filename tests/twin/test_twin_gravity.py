"""Gravity over a recording: its course from the targets' blocks, and what it asks of a model."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Case, Path
from fe.mesh.mirror import symmetry_support
from twin.gravity import G, density, is_heavy, of_targets, pulls_across, pulls_of, under, unmoved, ways
from twin.targets import Array, Load, Targets

DOWN, UP, ACROSS = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
SILICONE = 1.07e-9  # tonne/mm3


def test_a_density_is_told_in_tonnes_a_cubic_millimetre() -> None:
    assert density(1070.0) == pytest.approx(SILICONE)


def test_gravity_turns_half_way_between_two_blocks(make_targets: Callable[..., Targets]) -> None:
    block = np.array([0, 0, 0, 0, 0, 1, 1, 1])  # steps at .. 3.5, 6.0 s: the finger is turned at 4.75 s
    t = make_targets(gravity=np.stack([DOWN, UP]), block=block)
    course = of_targets(t)
    assert course.shape == (len(t.log_time), 3)
    np.testing.assert_array_equal(course[t.log_time < 4.74], G * np.tile(DOWN, (int((t.log_time < 4.74).sum()), 1)))
    np.testing.assert_array_equal(course[t.log_time > 4.76][:, 2], G)
    np.testing.assert_array_equal(of_targets(make_targets()), np.zeros(3))


def test_a_block_that_is_released_has_no_weight_and_no_load_in_its_rest(make_targets: Callable[..., Targets]) -> None:
    block = np.array([0, 0, 0, 0, 0, 1, 1, 1])
    t = make_targets(gravity=np.stack([DOWN, DOWN]), block=block, reference=np.array([0, 5, 6]),
                     loads=(Load(0, (50.0, 0.0, 8.0), 20.0), Load(1, (50.0, 0.0, 8.0), 20.0)))  # fmt: skip
    free = replace(t, released=(1,))
    held = (t.log_time > 4.75) & (t.log_time <= t.time[6])
    assert held.any()
    np.testing.assert_array_equal(of_targets(free)[held], 0.0)
    np.testing.assert_array_equal(of_targets(free)[~held], of_targets(t)[~held])
    _, pulls = pulls_of(free, lambda label: np.zeros(3))
    np.testing.assert_array_equal(pulls[held], 0.0)
    np.testing.assert_allclose(pulls[~held][:, 0, 2], -2e-5 * G)
    with pytest.raises(ValueError, match="block 1 is released, but has no rest; wanted reference steps of its"):
        replace(make_targets(block=block), released=(1,))


def test_targets_that_nothing_moves_are_told(make_targets: Callable[..., Targets], short_case: Case) -> None:
    block, heavy = np.array([0, 0, 0, 0, 0, 1, 1, 1]), short_case.with_material(density=SILICONE)
    t = make_targets(gravity=np.stack([DOWN, DOWN]), block=block, reference=np.array([0, 5]))
    assert unmoved(t, short_case) == ""
    still = replace(t, pressure=0 * t.pressure, log_pressure=0 * t.log_pressure)
    assert unmoved(still, heavy).startswith("nothing moves the body: its pressure is 0 kPa in all steps")
    free = replace(still, released=(0, 1))
    assert unmoved(free, heavy) == ""
    assert unmoved(free, short_case)  # it has no weight
    hung = (Load(0, (50.0, 0.0, 8.0), 20.0), Load(1, (50.0, 0.0, 8.0), 20.0))
    assert unmoved(replace(still, loads=hung), short_case)
    assert unmoved(replace(still, loads=hung[:1]), short_case)  # each block is relative to its own rest
    assert unmoved(replace(still, loads=hung[:1], reference=np.array([0])), short_case) == ""
    assert unmoved(replace(free, loads=hung), short_case) == ""
    turned = replace(still, gravity=np.stack([DOWN, UP]), reference=np.array([0]))
    assert (unmoved(turned, heavy), bool(unmoved(turned, short_case))) == ("", True)


def test_the_ways_of_gravity_are_those_that_a_heavy_case_feels(short_case: Case) -> None:
    time = np.array([0.0, 1.0, 2.0, 3.0])
    gravity = G * np.stack([DOWN, DOWN, UP, UP])
    path, heavy = Path(time, 0.01 * time, time, gravity=gravity), short_case.with_material(density=SILICONE)
    found, of_step = ways(heavy, path)
    np.testing.assert_array_equal(found[of_step], gravity)
    assert len(found) == 2
    assert not ways(short_case, path)[0].any()  # nothing is heavy
    assert (is_heavy(heavy), is_heavy(short_case)) == (True, False)
    assert not pulls_across(path)
    assert pulls_across(Path(time, 0.01 * time, time, gravity=G * np.stack([DOWN, DOWN, ACROSS, ACROSS])))


def test_weight_across_the_finger_asks_for_the_whole(short_case: Case) -> None:
    heavy, across = short_case.with_material(density=SILICONE), G * ACROSS
    assert under(short_case, _rest(across)) is short_case
    assert under(heavy, _rest(G * DOWN)) is heavy
    whole = under(heavy, _rest(across))
    assert symmetry_support(whole) is None
    assert under(whole, _rest(across)) is whole
    np.testing.assert_array_equal(whole.nodes[: len(heavy.nodes)], heavy.nodes)  # the half comes first


def _rest(gravity: Array) -> Path:
    rest = np.zeros(1)
    return Path(rest, rest, rest, gravity=gravity)
