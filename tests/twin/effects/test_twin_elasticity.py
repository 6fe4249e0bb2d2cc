"""How far the base law's constants may go: a fit below a C01 of 0, as far as rubber is stable."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibrate import least_squares
from twin.contract.specimen import small_test
from twin.effects.library import effect
from twin.effects.material import Elasticity
from twin.effects.protocol import Effect, Unsolvable
from twin.laws.mooneyrivlin import LEAST_SHARE
from twin.model import keptmodel
from twin.model.keptmodel import KeptModel
from twin.model.prediction import Model
from twin.targets import Array

OGDEN = {"C10": 0.435, "C01": -0.145, "stiffening.C20": 0.0725}  # MPa: one term of Ogden, 0.58 MPa and exponent 4


def ends(law: Effect) -> dict[str, tuple[float, float]]:
    return {p.name: (p.low, p.high) for p in law.parameters}


def test_a_fit_may_take_a_negative_C01_where_0_was_allowed() -> None:
    assert ends(Elasticity()) == {"C10": (0.01, 0.5), "C01": (0.0, 0.5)}  # those of the genetic algorithm
    assert ends(Elasticity().fitted()) == {"C10": (0.01, 1.5), "C01": (-1.0, 0.5)}
    stated = Elasticity(bounds={"C10": (0.1, 2.0), "C01": (0.0, 0.1)})
    assert ends(stated.fitted()) == {"C10": (0.1, 6.0), "C01": (-4.0, 0.1)}
    held = Elasticity(fixed={"C10": 0.2}).fitted()
    assert ends(held) == {"C01": (-0.4, 0.5)}
    assert held.fixed == {"C10": 0.2}
    for law in (Elasticity(bounds={"C01": (0.02, 0.1)}), Elasticity(fixed={"C01": 0.083})):
        assert ends(law.fitted()) == ends(law)


def test_rubber_that_is_not_stable_is_refused_with_a_sentence() -> None:
    model = Model(small_test(), (Elasticity().fitted(),), np.array([0]))
    least = {"C10": 1 - LEAST_SHARE, "C01": LEAST_SHARE}
    assert model.allowed({**least, "C10": least["C10"] + 0.02})
    assert not model.allowed({**least, "C10": least["C10"] - 0.02})
    model.put(least)
    for C01 in (-0.16, -0.5):
        with pytest.raises(Unsolvable, match=r"no stable rubber: of its shear modulus -(\d|inf)"):
            model.put({"C10": 0.4, "C01": C01})


def test_stability_is_that_of_the_law_with_all_its_terms() -> None:
    stiffening = {"C10": 0.5, "C01": -0.22}
    model = Model(small_test(), (Elasticity().fitted(), effect("stiffening")), np.array([0]))
    assert not model.allowed({**stiffening, "stiffening.C20": 0.0})
    assert model.allowed({**stiffening, "stiffening.C20": 0.1})
    assert not model.allowed({"C10": 0.2, "C01": 0.0, "stiffening.C20": -0.05})  # softens until it shears on


def test_the_base_model_of_targets_takes_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keptmodel, "base_test", lambda targets, case: small_test())
    targets: Any = SimpleNamespace(rests=np.zeros(5, int), reference=np.array([0]))
    model = keptmodel.base_model(targets, small_test().case)
    assert ends(model.effects[0]) == ends(Elasticity().fitted())


def test_a_silicone_of_ogden_with_exponent_4_is_within_reach_of_a_fit() -> None:
    test = small_test()
    path = replace(test.path, pressure=1.5 * test.path.pressure)
    rubber = test.case.with_material(C10=0.0, C01=0.0, ogden=((0.58, 4.0),))
    truth = Model(replace(test, case=rubber, path=path), (), np.array([0])).predict(np.zeros(0))
    model = KeptModel(replace(test, path=path), (Elasticity().fitted(), effect("stiffening")), np.array([0]))
    theta = model.theta(OGDEN)
    np.testing.assert_allclose(model.predict(theta), truth, rtol=0, atol=1e-6)
    start = model.theta({"C10": 0.2, "C01": 0.1, "stiffening.C20": 0.0})

    def residual(theta: Array) -> Array | None:
        try:
            return ((model.predict(theta) - truth) / 1e-3).ravel()
        except Unsolvable:
            return None

    def jacobian(theta: Array) -> Array:
        return (model.jacobian(theta) / 1e-3).reshape(len(theta), -1).T

    found = least_squares(residual, jacobian, model.parameters, start=start)
    np.testing.assert_allclose(found.theta, theta, rtol=0.02)
