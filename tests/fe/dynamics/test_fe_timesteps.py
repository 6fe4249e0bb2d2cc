"""Motions in time against closed forms, statics and the vibrations about rest."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as Folder

from benchmarks.kernel.convergence import SILICONE
from benchmarks.kernel.freemotions import (
    BEAM,
    CELLS,
    against_calculix,
    bent,
    energy,
    let_go,
    off_a_cosine,
    tip_of,
)

import numpy as np
import pytest

from fe import Case, Finger, Lattice, finger_case
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.timesteps import Scheme, inertia_of, transient
from fe.dynamics.vibration import modes
from fe.path import Path
from tests.fe.dynamics.test_fe_vibration import DENSITY


def beam(prony: tuple[tuple[float, float], ...] = ()) -> Case:
    case = BEAM.case(CELLS)
    return replace(case, materials={k: replace(m, prony=prony) for k, m in case.materials.items()})


@pytest.mark.parametrize("radius", [1.0, 0.8])
def test_a_small_free_vibration_is_a_cosine_to_second_order_in_the_step(radius: float) -> None:
    coarse, fine = (off_a_cosine(beam(), steps=n, radius=radius) for n in (40, 80))
    assert fine < 0.01  # a phase of (omega dt)^2 / 12 a radian, and that of a radius below 1
    assert coarse > 3.4 * fine  # 4 but for higher vibrations in the start


def test_creep_damps_as_the_loss_at_its_frequency_says() -> None:
    case = beam(((0.1, 0.2),))
    ratio = modes(at_rest(case, HeldLoad()), count=1).damping[0]
    found, _ = let_go(case, bent(case, 2e-5), periods=4.0, steps=100)
    z = found.u[:, tip_of(case), 2]
    lows = [k for k in range(1, len(z) - 1) if z[k] < min(z[k - 1], z[k + 1])]
    fall = np.log(z[lows[0]] / z[lows[-1]]) / (2 * np.pi * (len(lows) - 1))
    assert fall == pytest.approx(ratio, rel=0.03)  # a ratio of 0.026 lowers the frequency by 3e-4


def test_a_large_free_vibration_keeps_its_energy() -> None:
    """The tip of a beam of 200 mm moves by 23 mm to either side."""
    case = beam()
    found, _ = let_go(case, bent(case, 1e-2), periods=2.0, steps=80, radius=1.0)
    total = energy(case, found)
    assert np.abs(found.u[0, tip_of(case), 2]) > 15
    np.testing.assert_allclose(total[5:], total[0], rtol=0.01)  # of one step of the scheme, and of volume
    lost = energy(case, let_go(case, bent(case, 1e-2), periods=2.0, steps=20, radius=0.5)[0])
    assert lost[-1] < 0.99 * total[0]  # by its own damping


def test_a_large_free_vibration_is_that_of_calculix(tmp_path: Folder, require: Callable[[str], None]) -> None:
    require("ccx")
    apart = against_calculix(2e-3, tmp_path, periods=0.6, steps=300)
    assert apart < 0.01  # its method damps by itself: -0.05 of alpha


def test_steps_are_halved_until_each_is_within_its_tolerance() -> None:
    case = beam()
    path = Path(np.array([0.0, 1.0]), np.zeros(2), np.linspace(0.0, 1.0, 51))
    loose, tight = (transient(case, path, held=bent(case, 1e-2), tolerance=t, longest=0.1) for t in (0.5, 0.02))
    assert loose.error.max() <= 0.5
    assert tight.error.max() <= 0.02
    assert len(tight.steps) > 2 * len(loose.steps)
    assert tight.steps.sum() == pytest.approx(1.0)
    assert np.abs(tight.u - loose.u)[:, tip_of(case), 2].max() < 0.1 * np.abs(tight.u[0, tip_of(case), 2])


def test_a_slow_course_is_that_of_statics_and_a_fast_one_overshoots() -> None:
    x = 10 + 100 / 9
    stub = Finger(length=x, bellows=1, tip_node=(x, 11.5, 0.0), middle_node=(x / 2, 11.5, 0.0))
    lattice = Lattice(per_bellow=2, ring=False, centred=False)
    case = finger_case(replace(SILICONE, density=DENSITY), finger=stub, lattice=lattice)
    frequency = modes(at_rest(case, HeldLoad()), count=1).frequency[0]
    slow = Path(np.array([0.0, 200 / frequency]), np.array([0.0, 0.003]), np.array([100.0, 200.0]) / frequency)
    still = np.array([at_rest(case, HeldLoad(p)).state.u for p in (0.0015, 0.003)])
    moved = transient(case, slow, longest=5 / frequency).u
    size = np.abs(still[-1]).max()
    assert np.abs(moved - still).max() < 2e-3 * size
    end = 0.8 / frequency
    fast = Path(np.array([0.0, 1e-3 * end, end]), np.array([0.0, 0.003, 0.003]), np.linspace(0.1, 1.0, 40) * end)
    jumped = transient(case, fast, tolerance=1e9, longest=end / 80)
    row = np.unravel_index(np.abs(still[-1]).argmax(), still[-1].shape)
    over = (jumped.u[:, *row] / still[-1][row]).max()
    assert 1.6 < over < 2.2  # 2 of one vibration; others take and add a little


def test_the_tangent_of_inertia_is_the_derivative_of_its_force() -> None:
    case, rng = beam(), np.random.default_rng(0)
    forces = inertia_of(case).of_step(40.0, rng.normal(size=case.nodes.shape))
    change = rng.normal(size=case.nodes.shape)
    dofs, K = forces.tangent(case.nodes)
    along = np.zeros(case.nodes.size)
    np.add.at(along, dofs, (K @ change.ravel()[dofs][..., None])[..., 0])
    difference = forces.force(case.nodes) - forces.force(case.nodes + change)
    np.testing.assert_allclose(along.reshape(-1, 3), difference, rtol=0, atol=1e-12 * np.abs(difference).max())


def test_a_scheme_tells_its_own_damping() -> None:
    assert Scheme.of(1.0).damping(0.5) == pytest.approx(0.0, abs=1e-12)
    # of second order: what it damps falls with the cube of the step
    small, large = (Scheme.of(0.5).damping(x) for x in (0.05, 0.1))
    assert large == pytest.approx(8 * small, rel=0.02)


def test_what_time_steps_cannot_follow_is_refused() -> None:
    case, path = beam(), Path(np.array([0.0, 1.0]), np.zeros(2), np.array([1.0]))
    with pytest.raises(ValueError, match=r"radius 1.5 of the time steps: wanted 0 to 1"):
        transient(case, path, radius=1.5)
    with pytest.raises(ValueError, match=r"turned, or whose pulls change: wanted one recording"):
        transient(case, replace(path, gravity=np.zeros((2, 3))))
    with pytest.raises(ValueError, match=r"density of .*: wanted a positive one"):
        transient(case.with_material(density=0.0), path)


def test_what_was_held_for_long_stays_at_rest() -> None:
    case = beam(((0.2, 0.3),))
    held = bent(case, 1e-3)
    path = Path(np.array([0.0, 2.0]), np.zeros(2), np.array([0.5, 2.0]), places=held.places, pulls=held.pulls)
    still = transient(case, path)
    assert np.abs(still.u - at_rest(case, held).state.u).max() < 1e-5 * np.abs(still.u).max()


def test_a_tolerance_that_no_step_keeps_is_the_reason_that_is_told() -> None:
    case = beam()
    path = Path(np.array([0.0, 1.0]), np.zeros(2), np.array([0.0, 1.0]))
    found = transient(case, path, held=bent(case, 1e-3), tolerance=1e-12)
    assert not found.converged
    assert re.fullmatch(r"no step from 0 s on: it errs by \S+ mm however short it is", found.reason)
    assert found.time.tolist() == [0.0]
