"""Near a whole solve a model answers by its response, as far off as it states; beyond, it is solved."""

from collections.abc import Callable

import numpy as np
import pytest

from fe import Case
from twin.effects.library import effect
from twin.model.keptmodel import KeptModel, base_model
from twin.model.nearmodel import NearModel
from twin.model.response import Surrogate
from twin.targets import Array, Targets

BASE, SIZE = np.array([0.214, 0.083]), 0.02  # MPa: C10 and C01, and C20 of the stiffening
LIMIT = 0.002  # mm


@pytest.fixture(scope="module")
def bases(coarsest_case: Case, make_targets: Callable[..., Targets]) -> tuple[KeptModel, dict[str, list[Array]]]:
    base = base_model(make_targets(), coarsest_case)
    return base, base.tangents(BASE, [effect("stiffening")])


def near(bases: tuple[KeptModel, dict[str, list[Array]]], limit_mm: float = LIMIT) -> NearModel:
    """Of stiffening, with no solve of its own."""
    base, tangents = bases
    effects = (*base.effects, effect("stiffening"))
    whole = KeptModel(base.test, effects, base.reference, parent=base)
    return NearModel.of(whole, base, BASE, tangents, limit_mm=limit_mm)


def at(total: float, c20: float = SIZE) -> Array:
    return np.array([*(total * BASE), c20])


def test_a_short_step_takes_no_second_solve_and_a_long_one_does(
    bases: tuple[KeptModel, dict[str, list[Array]]]
) -> None:
    model = near(bases)
    model.predict(at(1.0))  # the first question is solved, though tangents at null are known
    assert len(model.whole.kept) == 1
    step = model.predict(at(1.01))
    model.jacobian(at(1.01))
    model.per_pressure(at(1.01))
    assert len(model.whole.kept) == 1
    assert model.is_solved(at(1.0))
    assert not model.is_solved(at(1.01))
    moved = np.abs(step - model.predict(at(1.0))).max()
    off = np.abs(step - model.whole.drawn(at(1.01)).u).max()
    assert off < 0.02 * moved  # derivatives at null, corrected by one solve
    far = at(1.5, 3 * SIZE)
    assert model.error_mm(far) > LIMIT
    np.testing.assert_array_equal(model.predict(far), model.whole.predict(far))
    assert len(model.whole.kept) == 2


def test_without_a_limit_every_question_is_solved(bases: tuple[KeptModel, dict[str, list[Array]]]) -> None:
    model = near(bases, limit_mm=0.0)
    for total in (1.0, 1.001):
        model.predict(at(total))
    assert len(model.whole.kept) == 2
    for total in (1.0, 1.001):
        np.testing.assert_array_equal(model.predict(at(total)), model.whole.predict(at(total)))


@pytest.mark.parametrize(("wrong", "taken"), [(1.0, False), (0.6, True)])
def test_a_solve_takes_derivatives_where_the_response_foresaw_it_wrong(
    bases: tuple[KeptModel, dict[str, list[Array]]], wrong: float, taken: bool
) -> None:
    base, tangents = bases
    rows = {label: [wrong * fields for fields in each] for label, each in tangents.items()}
    model = near((base, rows), limit_mm=0.0)
    model.predict(at(1.0))
    (solve,) = model.whole.kept
    assert (solve.jacobian is not None) == taken
    slope = model.jacobian(at(1.0))
    exact = model.whole.jacobian(at(1.0))
    assert np.linalg.norm(slope - exact) < 0.05 * np.linalg.norm(exact)
    model.certify(at(1.0), derivatives=True)
    np.testing.assert_array_equal(model.jacobian(at(1.0)), exact)


def test_where_it_answers_without_a_solve_it_is_as_far_off_as_it_states(
    bases: tuple[KeptModel, dict[str, list[Array]]]
) -> None:
    model, rng, pulls = near(bases), np.random.default_rng(2), []
    model.predict(at(1.0))
    for _ in range(12):
        theta = at(1.0) * (1 + 0.05 * rng.standard_normal(3))
        stated = model.error_mm(theta)
        if stated > LIMIT:
            continue
        off = (model.predict(theta) - model.whole.drawn(theta).u)[:, model.test.moving]
        pulls.append(float(np.sqrt((off**2).mean())) / stated)
    assert len(model.whole.kept) == 1
    assert len(pulls) >= 6
    assert 0.02 < np.sqrt(np.mean(np.square(pulls))) < 1.25


def test_where_the_response_knows_nothing_the_first_solve_takes_derivatives(
    bases: tuple[KeptModel, dict[str, list[Array]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    model, taken = near(bases), []
    monkeypatch.setattr(KeptModel, "values", lambda self, theta: taken.append(theta) or self.solved(theta))
    model.predict(at(1.0))
    assert len(taken) == 1
    answer = Surrogate.answer
    monkeypatch.setattr(Surrogate, "answer", lambda self, theta: (answer(self, theta)[0], np.full((), 1e3)))
    model = near(bases)
    monkeypatch.setattr(NearModel, "_rms", lambda self, field: float(np.abs(field).max()))
    model.certify(at(1.0))
    assert len(taken) == 1
    assert model.whole.kept[-1].jacobian is not None
