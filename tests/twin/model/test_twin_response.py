"""A response answers as the whole solves do that it stands for, and says how far off it may be."""

from collections.abc import Callable

import numpy as np
import pytest

from fe import Case
from twin.effects.library import effect
from twin.effects.protocol import Unsolvable
from twin.model.keptmodel import KeptModel, base_model
from twin.model.response import FAR, Surrogate
from twin.targets import Array, Targets

BASE = np.array([0.214, 0.083])  # MPa, C10 and C01


@pytest.fixture(scope="module")
def base(coarsest_case: Case, make_targets: Callable[..., Targets]) -> KeptModel:
    model = base_model(make_targets(), coarsest_case)
    assert isinstance(model, KeptModel)
    return model


@pytest.fixture(scope="module")
def response(base: KeptModel) -> Surrogate:
    """Of stiffening: the base model's solve and the effect's tangents."""
    own = effect("stiffening")
    whole = base.with_effect(own)
    assert isinstance(whole, KeptModel)
    return Surrogate.of(whole, base, BASE, base.tangents(BASE, [own]))


def at(response: Surrogate, *, total: float = 1.0, C20: float = 0.01) -> Array:
    return response.theta({"C10": total * BASE[0], "C01": total * BASE[1], "stiffening.C20": C20})


def off(response: Surrogate, theta: Array) -> tuple[float, float]:
    """What it is off and what it states, mm rms."""
    u, sd = response.answer(theta)
    return tuple(float(np.sqrt(np.mean(x**2))) for x in (response.whole.predict(theta) - u, sd))  # type: ignore[return-value]


def test_where_nothing_is_added_it_is_the_base_model(base: KeptModel, response: Surrogate) -> None:
    u, sd = response.answer(at(response, C20=0.0))
    assert np.abs(u - base.predict(BASE)).max() < 1e-4 * np.abs(u).max()  # `response.SURE` of the motion
    assert sd.max() < 1e-3 * np.abs(u).max()


def test_at_a_whole_solve_it_is_that_solve(response: Surrogate) -> None:
    theta = at(response, total=1.05)
    known = response.certified(theta)
    np.testing.assert_array_equal(known.predict(theta), response.whole.predict(theta))
    wanted = response.whole.jacobian(theta)
    for own, row in zip(known.jacobian(theta), wanted, strict=True):
        assert np.abs(own - row).max() < 1e-2 * np.abs(row).max()
    assert known.certified(theta) is known  # nothing is learnt twice


def test_a_whole_solve_brings_it_nearer(response: Surrogate) -> None:
    theta = at(response, total=1.1, C20=0.03)
    far, stated = off(response, theta)
    near, closer = off(response.certified(at(response, total=1.08, C20=0.025)), theta)
    assert near < 0.2 * far
    assert closer < 0.2 * stated


def test_what_it_is_off_is_what_it_states(response: Surrogate) -> None:
    """Pooled over sizes; docs/finite-elements.md has all effects."""
    rng, pulls = np.random.default_rng(4), []
    known = response.certified(at(response, total=1.03, C20=0.01))
    for _ in range(6):
        theta = at(response, total=float(np.exp(0.1 * rng.standard_normal())), C20=float(rng.uniform(0, 0.04)))
        error, stated = off(known, theta)
        pulls.append(error / stated)
    assert 0.05 < np.sqrt(np.mean(np.square(pulls))) < 1.25  # of one smooth effect: what is stated is for all


def test_its_derivatives_are_those_of_its_answer(response: Surrogate) -> None:
    theta, step = at(response, total=1.02), 1e-5
    for k, row in enumerate(response.jacobian(theta)):
        ends = [response.predict(theta + s * step * np.eye(3)[k]) for s in (1, -1)]
        np.testing.assert_allclose((ends[0] - ends[1]) / (2 * step), row, rtol=0, atol=1e-4 * np.abs(row).max())


def test_an_amplitude_far_beyond_its_plausible_range_is_answered(base: KeptModel) -> None:
    own = effect("hoop_reinforcement")
    whole = base.with_effect(own)
    assert isinstance(whole, KeptModel)
    response = Surrogate.of(whole, base, BASE, base.tangents(BASE, [own]))
    theta = np.array([*BASE, 40 * response.axes[2].scale])  # N/mm
    known = response.certified(theta)
    u, sd = known.answer(theta * (1.0, 1.0, 1.01))
    error = np.abs(u - whole.predict(theta)).max()
    assert error < min(0.05 * np.abs(u).max(), 3 * sd.max())


def test_far_from_every_solve_it_does_not_answer(response: Surrogate) -> None:
    scale = response.axes[0].scale
    theta = at(response)
    theta[0] += 1.1 * FAR * scale
    assert not response.reaches(theta)
    with pytest.raises(Unsolvable, match=r"C10 = .*: too far from every solve .* certify a whole solve there"):
        response.predict(theta)


def test_it_is_of_one_mesh_and_of_its_own_effects(response: Surrogate) -> None:
    with pytest.raises(TypeError, match="one mesh"):
        response.on_mesh(None)
    assert not isinstance(response.with_effect(effect("creep")), Surrogate)


def test_a_time_means_nothing_where_nothing_creeps(base: KeptModel) -> None:
    own = effect("creep")
    whole = base.with_effect(own)
    assert isinstance(whole, KeptModel)
    response = Surrogate.of(whole, base, BASE, base.tangents(BASE, [own]))
    found = [response.predict(np.array([*BASE, 0.0, tau])) for tau in (1.0, 7.0)]
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-9)
    moved = [response.predict(np.array([*BASE, 0.05, tau])) for tau in (1.0, 7.0)]
    assert np.abs(moved[1] - moved[0]).max() > 1e-3  # mm


def test_a_law_without_tangents_asks_for_a_solve_first(base: KeptModel) -> None:
    whole = base.with_effect(effect("stiffening"))
    assert isinstance(whole, KeptModel)
    blind = Surrogate.of(KeptModel(whole.test, whole.effects, whole.reference), base, BASE, {})
    theta = at(blind)
    assert not blind.reaches(theta)
    assert blind.certified(theta).reaches(theta)
