"""What a virtual truth may hide: nothing at size 0, and something at every other."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from fe import Case, Finger, solve
from twin.effects.library import all_effects
from twin.effects.protocol import Test
from twin.virtual.hidden import KINDS
from twin.virtual.protocols import PROTOCOLS, TOP, places
from twin.virtual.truthsolves import DENSITY, SILICONE

COURSE = PROTOCOLS["P3"].course


def plain(case: Case, finger: Finger) -> Test:
    points = np.array([places(finger)["tip"], places(finger)["off1"]])
    return Test(case.with_material(C10=SILICONE.C10, C01=SILICONE.C01), COURSE, points, np.ones(2, bool))


@pytest.mark.parametrize("name", sorted(k for k, kind in KINDS.items() if kind.part != "motion"))
def test_a_kind_hides_nothing_at_size_0_and_something_at_others(
    name: str, short_case: Case, short: Finger
) -> None:
    kind, test = KINDS[name], plain(short_case, short)
    u = np.random.default_rng(1).standard_normal((len(COURSE.output), 2, 3))
    assert np.array_equal(kind.after(u, test, 0.0), u)
    size = kind.sizes[-1]
    changed = kind.before(test, size)
    if kind.part == "picture":
        assert np.abs(kind.after(u, test, size) - u).max() > 1e-3
        assert changed is test
    elif kind.part == "path":
        assert changed.case is test.case
        same = replace(changed.path, pressure=test.path.pressure, stiffness=None)
        moved = np.abs(changed.path.pressure - test.path.pressure).max() / TOP
        assert moved > 0.005 or changed.path.stiffness is not None
        assert np.array_equal(same.time, test.path.time)
        still = kind.before(test, 0.0).path
        np.testing.assert_allclose(still.pressure, test.path.pressure, atol=1e-12)
    else:
        assert changed.case is not test.case
        assert changed.path is test.path


def test_inertia_adds_a_swing_that_dies_after_each_fast_step(short_case: Case, short: Finger) -> None:
    fast = PROTOCOLS["fast"].course
    slower = short_case.with_material(density=36 * DENSITY)  # as slow as a finger of nine bellows
    test, u = replace(plain(slower, short), path=fast), np.zeros((len(fast.output), 2, 3))
    assert KINDS["inertia"].after(u, test, 0.0) is u
    swing = np.abs(KINDS["inertia"].after(u, test, 1.0)[:, 0]).max(axis=1)
    t = fast.output
    slow, up, later, down = (swing[(a < t) & (t < b)].max() for a, b in ((0, 4), (4.4, 4.9), (5.6, 5.9), (5.9, 6.4)))
    assert min(up, down) > 15 * slow
    assert min(up, down) > 3 * later
    moved = solve(short_case, replace(fast, gravity=np.zeros(3))).at(test.points)[:, 0]
    assert 0.2 < up / np.ptp(moved[(t > 4.3) & (t < 5.9)], axis=0).max() < 1.0  # a step within half a period


def test_every_known_kind_names_an_effect_of_the_library() -> None:
    known = {e.name for e in all_effects()}
    for kind in KINDS.values():
        assert (kind.law == "unknown") == (kind.physics == "")
        assert not kind.physics or kind.physics in known
    unknown = [k for k in KINDS.values() if k.law == "unknown"]
    assert len(unknown) >= 7


def test_protocols_are_parts_of_each_other() -> None:
    steps = [PROTOCOLS[f"P{k}"].steps for k in range(1, 6)]
    for fewer, more in itertools.pairwise(steps):
        assert np.isin(fewer, more).all()
    five = PROTOCOLS["P5"]
    assert five.held_out == 2
    assert (five.course.outside_at(five.steps)[five.block == 2][:, 0] > 0).all()
    one = PROTOCOLS["P3"]
    assert np.abs(one.course.gravity).max() == 0.0  # nothing is weighed
    assert one.course.at_output().max() == pytest.approx(TOP)


def test_gravity_turns_where_a_model_of_the_targets_turns_it() -> None:
    """`gravity.of_targets` turns half way between the last step of a recording and the first of the next."""
    five = PROTOCOLS["P5"]
    last = np.flatnonzero(np.diff(five.block))
    switch = (five.steps[last] + five.steps[last + 1]) / 2
    turned = five.course.time[five.course.turns + 1]
    assert np.abs(turned - switch).max() <= 0.2  # one entry of the log
