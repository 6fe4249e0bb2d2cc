"""Errors of Student's t: gross errors hardly count, and without them little is lost."""

import numpy as np
import pytest

from calibrate import Fit, Parameter, least_squares
from calibrate.fit import Jacobian, Residual
from calibrate.parameters import Array
from calibrate.robust import NU, parted, scale_of, student, weights

TRUE = np.array([0.3, 2.0])
TWO = (Parameter("a", -5.0, 5.0), Parameter("b", 0.1, 9.0))
X = np.linspace(0.0, 2.0, 400)
OUTLIERS = np.arange(7, 400, 20)  # 5 % of the values


def curve(theta: Array) -> Array:
    return np.asarray(10 * theta[0] + 4 * np.exp(-theta[1] * X))


def posed(y: Array) -> tuple[Residual, Jacobian]:
    """A residual of unit noise, and its derivatives."""

    def slope(theta: Array) -> Array:
        return np.stack([np.full_like(X, 10.0), -4 * X * np.exp(-theta[1] * X)], axis=1)

    return lambda theta: curve(theta) - y, slope


def fitted(y: Array, *, robust: bool) -> Fit:
    residual, slope = posed(y)
    start = least_squares(residual, slope, TWO, start=[0.0, 1.0])
    if not robust:
        return start
    root, turned, information = student(residual, slope)
    return least_squares(root, turned, TWO, start=start.theta, information=information)


def reweighted(y: Array) -> Array:
    """The iteratively reweighted least squares of Lange et al., written out."""
    residual, slope = posed(y)
    theta = fitted(y, robust=False).theta
    for _ in range(300):
        z, rows = residual(theta), slope(theta)
        assert z is not None
        w = weights(z)
        theta = theta - np.linalg.solve(rows.T @ (w[:, None] * rows), rows.T @ (w * z))
    return theta


def noisy(seed: int, *, outliers: bool) -> Array:
    y = curve(TRUE) + np.random.default_rng(seed).normal(size=len(X))
    y[OUTLIERS] += 40.0 * outliers
    return y


def test_gross_errors_in_5_percent_bias_least_squares_and_not_the_t() -> None:
    plain = [fitted(noisy(seed, outliers=True), robust=False).theta for seed in range(30)]
    heavy = [fitted(noisy(seed, outliers=True), robust=True) for seed in range(30)]
    sd = fitted(noisy(0, outliers=False), robust=False).sd
    biased = np.abs(np.mean(plain, axis=0) - TRUE) / sd
    left = np.abs(np.mean([fit.theta for fit in heavy], axis=0) - TRUE) / sd
    assert biased.max() > 10
    assert left.max() < 0.7  # of the mean of 30 fits, itself known to 0.2 sd; Lange et al. leave 0.1 per 1 %
    inside = [np.abs(fit.theta - TRUE) < 1.96 * fit.sd for fit in heavy]
    assert np.mean(inside) > 0.85


def test_without_gross_errors_the_t_finds_nearly_the_same_as_least_squares() -> None:
    pairs = [[fitted(noisy(seed, outliers=False), robust=r) for r in (False, True)] for seed in range(60)]
    plain, robust = (np.array([pair[k].theta for pair in pairs]) for k in (0, 1))
    sd = np.array([pair[0].sd for pair in pairs]).mean(axis=0)
    assert (np.abs(robust - plain) / sd).max() < 1.2  # the variance is 1.08 times as large: 0.28 sd apart, rms
    assert np.sqrt(((robust - plain) ** 2).mean(axis=0)) == pytest.approx(0.28 * sd, rel=0.35)
    # expected information 5/7 of normal errors, where the t is right; its sd is then sqrt(7/5) that of those
    assert pairs[0][1].sd == pytest.approx(np.sqrt(7 / 5) * pairs[0][0].sd, rel=0.05)


def test_it_ends_where_reweighted_least_squares_end() -> None:
    y = noisy(3, outliers=True)
    assert fitted(y, robust=True).theta == pytest.approx(reweighted(y), abs=0.02 * 0.1)  # to 0.02 sd


def test_its_derivatives_are_those_of_its_values() -> None:
    y = noisy(1, outliers=True)
    y[5] = curve(TRUE)[5]  # z = 0, where the root bends
    root, slope, _ = student(*posed(y))
    for theta in (TRUE, np.array([0.9, 1.0])):
        r = root(theta)
        assert r is not None
        for k, h in enumerate(1e-6 * np.eye(2)):
            a, b = root(theta + h), root(theta - h)
            assert a is not None
            assert b is not None
            if theta is TRUE:  # where the scale is 1, and stays
                assert slope(theta)[:, k] == pytest.approx((a - b) / 2e-6, abs=2e-4)
            assert 2 * r @ slope(theta)[:, k] == pytest.approx((a @ a - b @ b) / 2e-6, rel=1e-5, abs=1e-3)


def test_the_squares_are_the_deviance_of_the_t() -> None:
    from scipy.stats import t

    y = noisy(2, outliers=True)
    for theta in (TRUE, np.array([0.9, 1.0])):  # right, and far off: there the scale is larger
        root, z = student(*posed(y))[0](theta), posed(y)[0](theta)
        assert root is not None
        assert z is not None
        s = np.linspace(1.0, 12.0, 4001)
        deviance = [2 * np.sum(t.logpdf(0.0, NU) - t.logpdf(z, NU, scale=one)) for one in s]
        assert root @ root == pytest.approx(min(deviance), rel=1e-5)  # the likeliest scale, as the grid has it
        assert scale_of(z) == pytest.approx(s[np.argmin(deviance)], abs=0.01)
    assert scale_of(z) > 3.0
    assert scale_of(0 * z) == 1.0


def test_a_model_without_an_answer_has_none_under_the_t() -> None:
    root, slope, _ = student(lambda theta: None, lambda theta: np.ones((3, 2)))
    assert root(TRUE) is None
    assert np.isnan(slope(TRUE)).all()


SHARED = np.stack([np.full_like(X, 20.0), 8 * np.sin(3 * X)])  # two errors that all values share, 1 sd


def test_a_gross_error_does_not_pull_what_all_values_share() -> None:
    z = np.random.default_rng(5).normal(size=len(X)) + SHARED.T @ [0.7, -1.2]
    z[[40, 200, 333]] += 900.0
    left, amplitudes, scale = parted(z, SHARED)
    assert amplitudes == pytest.approx([0.7, -1.2], abs=0.05)  # 400 values of sd 1: 0.0025 and 0.009; the rest is SETTLED
    assert set(np.flatnonzero(np.abs(left) > 5 * scale)) == {40, 200, 333}
    pulled = np.linalg.solve(np.eye(2) + SHARED @ SHARED.T, SHARED @ z)
    assert np.abs(pulled - [0.7, -1.2]).max() > 0.2
    assert np.sum(np.abs(z - SHARED.T @ pulled) > 5) > 100  # it would make gross errors of good values


def test_with_shared_errors_the_derivatives_are_those_of_the_deviance(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calibrate.robust.TURNS", 2000)
    monkeypatch.setattr("calibrate.robust.SETTLED", 1e-11)
    y = noisy(4, outliers=True) + SHARED.T @ [0.5, 0.5]
    root, slope, information = student(*posed(y), modes=SHARED)
    theta = np.array([0.32, 1.9])
    r = root(theta)
    assert r is not None
    assert len(r) == len(X) + 2
    for k, h in enumerate(1e-4 * np.eye(2)):
        a, b = root(theta + h), root(theta - h)
        assert a is not None
        assert b is not None
        assert 2 * r @ slope(theta)[:, k] == pytest.approx((a @ a - b @ b) / 2e-4, rel=0.02, abs=0.5)
    rows = posed(y)[1](theta)
    scale = parted(posed(y)[0](theta), SHARED)[2]  # type: ignore[arg-type]
    whole = np.linalg.inv(np.eye(len(X)) * scale**2 * (NU + 3) / (NU + 1) + SHARED.T @ SHARED)
    made = information(theta)
    assert made.shape == rows.shape
    np.testing.assert_allclose(made.T @ made, rows.T @ whole @ rows, rtol=1e-6)
