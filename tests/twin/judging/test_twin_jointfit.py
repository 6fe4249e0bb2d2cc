"""Curves of the silicone in a fit's residual, and whether they agree with a film: against closed forms."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fe import Case, Material
from fe.homogeneous import nominal_stress
from tests.fe import lawpoints
from tests.twin.conftest import plain_targets
from twin.effects.library import effect
from twin.effects.material import Elasticity
from twin.effects.protocol import Unsolvable
from twin.judging.fitting import whitened
from twin.judging.jointfit import agreement, rank, sd_along
from twin.judging.materialcurves import beside_film, curve_jacobian, curve_residual, silicone
from twin.laws.catalogue import LAWS
from twin.laws.law import RubberLaw
from twin.model.keptmodel import KeptModel, base_model
from twin.targets import Array, MaterialCurve, Targets

TRUE = np.array([0.2, 0.1])
STRAIN = np.linspace(0.03, 0.6, 20)


def curve(kind: Any = "uniaxial", *, stress: Array | None = None, sd: float = 0.001, scale: float = 0.02) -> MaterialCurve:
    own = nominal_stress(Material(*TRUE), STRAIN, kind) if stress is None else stress
    return MaterialCurve(
        name=kind, kind=kind, strain=STRAIN, stress=own, sd=np.full(20, sd), modes=scale * own[None],
        mode_names=("scale",), time=None, up_to=1.6, recorded=20, left_out=0,
    )  # fmt: skip


@pytest.fixture(scope="module")
def model(short_case: Case) -> KeptModel:
    return base_model(plain_targets(), short_case)


def test_a_curve_has_no_residual_at_its_own_constants(model: KeptModel) -> None:
    targets = plain_targets(curves=(curve(), curve("planar")))
    np.testing.assert_allclose(curve_residual(model, targets, TRUE), 0.0, atol=1e-9)
    theta = np.array([0.25, 0.04])
    apart = curve_residual(model, targets, theta)
    assert apart.shape == (40,)
    own = curve().whiten(curve().stress - nominal_stress(Material(*theta), STRAIN, "uniaxial"))
    np.testing.assert_allclose(apart[:20], own, rtol=1e-12)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_curve_knows_every_law(law: RubberLaw, short_case: Case) -> None:
    elasticity = Elasticity(law)
    model = base_model(plain_targets(), short_case, elasticity=elasticity)
    theta = model.theta({p.name: p.start for p in elasticity.parameters if p.start is not None})
    material = elasticity.constants(model.named(theta)).material
    stress = lawpoints.nominal_stress(material, 1 + STRAIN, "uniaxial")
    targets = plain_targets(curves=(curve(stress=stress),))
    # the law's own stress at constant volume: the bulk modulus of 1000 shear moduli changes it by 1e-3
    np.testing.assert_allclose(curve_residual(model, targets, theta), 0.0, atol=2.0)
    step = 0.1 * np.array([p.step for p in elasticity.parameters])
    assert np.abs(curve_residual(model, targets, np.minimum(theta + step, [p.high for p in elasticity.parameters]))).max() > 0.01


def test_the_derivatives_of_a_curve_are_those_of_its_residual(model: KeptModel) -> None:
    targets, h = plain_targets(curves=(curve(), curve("equibiaxial"))), 1e-4
    J = curve_jacobian(model, targets, TRUE)
    for k, e in enumerate(np.eye(2)):
        a, b = (curve_residual(model, targets, TRUE + s * h * e) for s in (1, -1))
        np.testing.assert_allclose(J[:, k], (a - b) / (2 * h), rtol=1e-6, atol=1e-4)  # a step of 2e-8 MPa in stresses of 600 MPa (K) times 1e-16


def test_a_specimen_has_the_effects_of_the_material_and_no_other(model: KeptModel) -> None:
    with_all = model.with_effect(effect("stiffening", users=())).with_effect(effect("precurvature", users=()))
    values = {p.name: (p.low + p.high) / 2 for p in with_all.parameters} | {"C10": 0.2, "C01": 0.1, "stiffening.C20": 0.03}
    found = silicone(with_all, values)
    assert (found.C10, found.C01, found.C20) == (0.2, 0.1, 0.03)


def test_a_law_without_a_stress_is_no_fit(model: KeptModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MaterialCurve, "predicted", lambda self, material: np.full(20, np.nan))
    with pytest.raises(Unsolvable, match="no stress at some strains of the material test uniaxial"):
        curve_residual(model, plain_targets(curves=(curve(),)), TRUE)


def test_film_and_curves_stand_below_each_other(model: KeptModel, monkeypatch: pytest.MonkeyPatch) -> None:
    u = np.zeros((8, 3, 3))
    monkeypatch.setattr(KeptModel, "predict", lambda self, theta: u)
    monkeypatch.setattr(KeptModel, "jacobian", lambda self, theta: np.stack([u + 1, u + 2]))
    w: Any = SimpleNamespace(whiten=lambda x: x.reshape(*x.shape[:-3], -1), components=np.zeros((9, 2)))
    for curves, rows in (((), 72), ((curve(),), 92)):
        residual, jacobian, _ = whitened(model, plain_targets(curves=curves), w)
        z = residual(TRUE + 0.01)
        assert z is not None
        assert z.shape == (rows,)
        J = jacobian(TRUE + 0.01)
        np.testing.assert_array_equal(J[:72], np.tile([-1.0, -2.0], (72, 1)))
        assert J.shape == (rows, 2)
        if curves:
            targets = plain_targets(curves=curves)
            np.testing.assert_array_equal(J[72:], curve_jacobian(model, targets, TRUE + 0.01))
            np.testing.assert_array_equal(z[72:], curve_residual(model, targets, TRUE + 0.01))


def test_curves_add_to_the_information_of_another_loss_too(model: KeptModel) -> None:
    targets = plain_targets(curves=(curve(),))
    film = [lambda theta, k=k: k * np.ones((3, 2)) for k in (1.0, 0.7)]  # derivatives, and what a loss leaves of them
    _, jacobian, information = beside_film(lambda theta: np.zeros(3), *film, model=model, targets=targets)
    assert information is not None
    np.testing.assert_array_equal(information(TRUE)[:3], 0.7)
    np.testing.assert_array_equal(information(TRUE)[3:], jacobian(TRUE)[3:])
    assert beside_film(lambda theta: None, film[0], None, model=model, targets=targets)[2] is None


def judged(model: KeptModel, theta: Array, rows: Array, z: Array) -> Any:
    """A film that is linear in the constants: whitened derivatives (n, 2), and what it leaves (n,)."""
    values = dict(zip(("C10", "C01"), theta.tolist(), strict=True))
    return SimpleNamespace(model=model, theta=theta, values=values, at_bound=(), fitted=rows, z=z)


def test_a_film_that_agrees_decides_what_the_curve_leaves_open(model: KeptModel) -> None:
    targets: Targets = plain_targets(curves=(curve(),))
    rows = np.array([[1.0, 1.0], [1.0, 1.0]]) / (0.003 * np.sqrt(2))  # knows C10 + C01 to 3 kPa
    found = agreement(judged(model, TRUE, rows, np.zeros(2)), targets)
    assert found is not None
    assert found.film_shear_MPa == pytest.approx(0.6)
    assert found.film_shear_sd_MPa == pytest.approx(0.006)
    J = curve_jacobian(model, targets, TRUE)
    sd = 2 * np.sqrt(np.ones(2) @ np.linalg.inv(J.T @ J) @ np.ones(2))
    assert found.tests_shear_sd_MPa == pytest.approx(sd, rel=1e-6)
    covariance = np.linalg.inv(J.T @ J + rows.T @ rows)
    assert found.tests[0].decides == pytest.approx(np.trace(covariance @ J.T @ J), rel=1e-6)
    assert found.film_decides == pytest.approx(np.trace(covariance @ rows.T @ rows), rel=1e-6)
    assert found.p_value == pytest.approx(1.0)
    assert found.sentence.startswith("Film and material tests (uniaxial) agree within their errors.")


@pytest.mark.parametrize("apart", [1.0, 6.0])
def test_a_film_that_asks_for_another_modulus_is_so_many_sds_apart(model: KeptModel, apart: float) -> None:
    """Film and curve ask for C10 + C01 that are `apart` sds of their difference from each other; at the joint fit,
    which lies between, what both leave adds up to apart^2."""
    targets = plain_targets(curves=(curve(),))
    J = curve_jacobian(model, targets, TRUE)
    known = np.linalg.inv(J.T @ J)
    own, sd = float(np.ones(2) @ known @ np.ones(2)), 0.004
    wished = 0.3 + apart * np.sqrt(own + sd**2)  # of the film; the curve's is 0.3
    row = np.ones(2) / sd
    theta = np.linalg.solve(J.T @ J + np.outer(row, row), J.T @ J @ TRUE + row * wished / sd)
    found = agreement(judged(model, theta, row[None], np.array([(wished - theta.sum()) / sd])), targets)
    assert found is not None
    # the curve is not quite linear in the constants over so far
    assert found.film_shear_MPa == pytest.approx(2 * wished, rel=1e-3)
    assert found.tests_shear_MPa == pytest.approx(0.6, rel=1e-3)
    assert f"{apart:.1f} sd apart" in found.sentence
    from scipy.stats import chi2

    assert np.log(found.p_value) == pytest.approx(np.log(chi2.sf(apart**2, 1)), rel=0.05)
    assert ("contradict" in found.sentence) == (apart > 4)


def test_a_curve_of_another_law_is_told(model: KeptModel) -> None:
    stiffer = nominal_stress(Material(C10=0.2, C01=0.1, C30=0.5), STRAIN, "uniaxial")
    targets = plain_targets(curves=(curve(stress=stiffer, scale=0.001),))
    found = agreement(judged(model, TRUE, np.eye(2), np.zeros(2)), targets)
    assert found is not None
    assert found.law_p_value < 1e-6  # type: ignore[operator]
    assert "law does not follow the material tests: uniaxial is off by up to" in found.sentence


def test_without_curves_there_is_nothing_to_agree_with(model: KeptModel) -> None:
    assert agreement(judged(model, TRUE, np.eye(2), np.zeros(2)), plain_targets()) is None


def test_what_is_not_determined_has_no_sd() -> None:
    rows = np.array([[1.0, 1.0], [2.0, 2.0]]) / np.sqrt(10)
    assert rank(rows) == 1
    assert sd_along(np.array([1.0, 1.0]), rows) == pytest.approx(np.sqrt(2.0))
    assert sd_along(np.array([1.0, 0.0]), rows) is None


def test_noise_of_a_curve_is_no_contradiction(model: KeptModel) -> None:
    noise = 0.001 * np.random.default_rng(5).standard_normal(20)
    targets = plain_targets(curves=(curve(stress=curve().stress + noise),))
    J, best = curve_jacobian(model, targets, TRUE), TRUE
    for _ in range(3):  # Gauss-Newton, where the curve alone ends
        best = best - np.linalg.lstsq(J, curve_residual(model, targets, best), rcond=None)[0]
    found = agreement(judged(model, best, 300 * np.ones((2, 2)), np.zeros(2)), targets)
    assert found is not None
    assert found.tests[0].chi2 == pytest.approx(18.0, abs=18.0)  # of 20 values less 2 constants: 3 sds
    assert found.p_value == pytest.approx(1.0, abs=0.05)  # both ask for the same: nothing is left between them
    assert found.law_p_value > 1e-3  # type: ignore[operator]
