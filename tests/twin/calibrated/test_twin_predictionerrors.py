"""What film and tests of the silicone leave open of a prediction, against the normal equations."""

import numpy as np
import pytest

from fe import Case, Material
from fe.homogeneous import nominal_stress
from tests.twin.conftest import plain_targets
from twin.calibrated.predictionerrors import Uncertain, told_by_film
from twin.judging.materialcurves import curve_jacobian
from twin.model.keptmodel import KeptModel, base_model
from twin.targets import MaterialCurve

TRUE, STRAIN = np.array([0.2, 0.1]), np.linspace(0.05, 0.6, 12)


def test_a_curve_narrows_what_is_left_open_as_far_as_it_knows_the_constants(
    short_case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = plain_targets()
    still = np.zeros_like(plain.value)
    monkeypatch.setattr(KeptModel, "predict", lambda self, theta: still)
    monkeypatch.setattr(KeptModel, "per_pressure", lambda self, theta: still)
    stress = nominal_stress(Material(*TRUE), STRAIN, "uniaxial")
    curve = MaterialCurve(
        name="a", kind="uniaxial", strain=STRAIN, stress=1.01 * stress, sd=np.full(12, 1e-3), modes=np.zeros((0, 12)),
        mode_names=(), time=None, up_to=1.6, recorded=12, left_out=0,
    )  # fmt: skip
    model, rng = base_model(plain, short_case), np.random.default_rng(1)
    columns = rng.normal(size=(3, *still.shape))  # two constants, and a mode
    prior = np.array([1e4, 1e4, 1.0])
    uncertain = Uncertain(columns, prior, free=np.ones(2, bool))
    for targets in (plain, plain_targets(curves=(curve,))):
        change, left = told_by_film(targets, model, TRUE, uncertain)
        seen = np.moveaxis(columns[:, :, :2], 0, -1).reshape(-1, 3) / 0.01  # the fixed marker shows nothing
        information, told = seen.T @ seen + np.diag(prior), np.zeros(3)
        if targets.curves:
            J = -curve_jacobian(model, targets, TRUE)
            information[:2, :2] += J.T @ J
            told[:2] = J.T @ curve.whiten(0.01 * stress)
        covariance = np.linalg.inv(information)
        wanted = np.einsum("jspi,jk,kspi->spi", columns, covariance, columns)
        np.testing.assert_allclose((left**2).sum(axis=0), wanted, rtol=1e-6)
        np.testing.assert_allclose(change, np.tensordot(covariance @ told, columns, 1), rtol=1e-6, atol=1e-12)
