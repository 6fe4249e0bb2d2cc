"""A reduced model of motions in time against whole steps, statics and its own loss factor."""

from dataclasses import replace

from benchmarks.kernel.beams import DENSITY
from benchmarks.kernel.convergence import SHORT, SILICONE
from benchmarks.kernel.reducedmotions import COARSE, stub

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from fe import Case, finger_case
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.reduced import ReducedModel
from fe.dynamics.timesteps import transient
from fe.path import Path

TOP = 0.02  # MPa


@pytest.fixture(scope="module")
def case() -> Case:
    return stub()


@pytest.fixture(scope="module")
def model(case: Case) -> ReducedModel:
    return ReducedModel.of(case, np.linspace(-0.3 * TOP, 1.5 * TOP, 7).tolist(), count=3)


def course(model: ReducedModel, *, rise: float, periods: float) -> tuple[Path, float]:
    """A ramp to TOP in so many periods, and the period in s."""
    period = float(2 * np.pi / np.sqrt(model.square[3, 0]))
    time = np.array([0.0, rise, 100.0 + rise]) * period
    return Path(time, np.array([0.0, TOP, TOP]), np.linspace(0.0, periods, round(20 * periods) + 1) * period), period


def test_equilibria_and_what_pushes_along_them_are_those_of_the_case(case: Case, model: ReducedModel) -> None:
    between = 0.45 * TOP
    state = at_rest(case, HeldLoad(between)).state
    off = np.abs(model.place(between).reshape(-1, 3) - state.u).max()
    assert off < 2e-3 * np.abs(state.u).max()
    # what the vibrations take of the load is what the equilibrium takes: K U' = f, K phi = w^2 M phi
    row = model._terms(model.pressure[3])
    mass, load, square = row[3:].reshape(4, -1)[[0, 2, 3]]
    np.testing.assert_allclose(load[:2], (square * mass)[:2], rtol=0.02)


def test_suction_is_the_pressure_of_the_other_sign_and_bends_the_other_way() -> None:
    """Of three bellows; the paths of `fe.solve` begin at no pressure, and rise."""
    bending = finger_case(replace(SILICONE, density=DENSITY), finger=SHORT, lattice=COARSE)
    up, down, far = (at_rest(bending, HeldLoad(p)) for p in (1e-4, -1e-4, -0.0105))
    assert far.converged
    np.testing.assert_allclose(down.state.u, -up.state.u, atol=0.02 * np.abs(up.state.u).max())
    assert 80 < np.abs(far.state.u).max() / np.abs(down.state.u).max() < 150
    assert not at_rest(bending, HeldLoad(-0.5)).converged


def test_a_slow_course_is_statics_and_a_fast_one_swings_as_whole_steps_do(case: Case, model: ReducedModel) -> None:
    path, period = course(model, rise=30.0, periods=35.0)
    slow = model.follow(path)
    size = np.abs(model.place(TOP)).max()
    assert slow.swing.max() < 0.05 * size
    path, period = course(model, rise=0.6, periods=1.5)
    fast = model.follow(path)
    assert fast.swing.max() > 0.3 * size
    assert np.isnan(fast.error).all()
    whole = transient(case, path, tolerance=1e9, longest=period / 40, radius=0.95)
    off = np.linalg.norm(whole.u - fast.u, axis=2).max(axis=1)
    assert off.max() < 0.2 * fast.swing.max()  # three vibrations of a stub


def test_a_loss_factor_damps_by_half_of_it(model: ReducedModel) -> None:
    path, _ = course(model, rise=0.5, periods=9.0)
    swing = model.follow(path, loss=0.1).swing
    fall = np.log(swing[60] / swing[160]) / (2 * np.pi * 5)  # of five periods; faster vibrations are gone before
    assert fall == pytest.approx(0.05, rel=0.15)
    assert model.follow(path).swing[160] > 0.7 * model.follow(path).swing[60]


def test_the_error_of_a_point_is_its_own_and_whole_steps_lose_no_more_than_it(case: Case, model: ReducedModel) -> None:
    path, period = course(model, rise=0.6, periods=3.0)
    tip = int(np.argmin(np.linalg.norm(case.nodes - case.position(4401), axis=1)))
    point = csr_matrix(([1.0], ([0], [tip])), shape=(1, len(case.nodes)))
    moved, lossy = model.follow(path), model.follow(path, loss=0.3)
    moments = [0.6 * period]
    of_tip = model.certified(moved, moments, at=point).error
    assert of_tip.shape == (len(path.output), 1, 3)
    # of a period in which it loses 0.6 of its amplitude
    assert model.certified(lossy, moments, at=point).error[0].max() < 2 * of_tip[0].max() + 0.1 * lossy.swing.max()


def test_creep_and_loads_without_equilibrium_are_refused(case: Case) -> None:
    creeping = replace(case, materials={k: replace(m, prony=((0.1, 1.0),)) for k, m in case.materials.items()})
    with pytest.raises(ValueError, match="wanted one without Prony series"):
        ReducedModel.of(creeping, [0.0, 0.01])
    with pytest.raises(ValueError, match="no equilibrium at 2000 kPa"):
        ReducedModel.of(case, [0.0, 2.0], count=1)
