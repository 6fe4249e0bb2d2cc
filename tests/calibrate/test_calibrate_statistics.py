"""Tests that know how the noise was measured are uniform where nothing is wrong; words say what is known."""

import numpy as np
import pytest
from scipy import stats

from calibrate import Fit, Parameter, bic, chi2_test, excess, holm, identifiability, omnibus, sidak
from tests.messages import says

COMPONENTS = 8  # four markers, two axes
STEPS = 424  # 42.4 s at 10 frames/s


def null_chi2(frames: int, *, trials: int, seed: int) -> np.ndarray:
    """chi2 (trials,) of a right model, whitened with variances from so many static frames."""
    rng = np.random.default_rng(seed)
    estimated = rng.chisquare(frames - 1, (trials, COMPONENTS)) / (frames - 1)
    return np.sum(rng.chisquare(STEPS, (trials, COMPONENTS)) / estimated, axis=1)


@pytest.mark.parametrize("frames", [20, 120, 300])
def test_a_right_model_is_rejected_as_rarely_as_promised(frames: int) -> None:
    counts, nu = np.full(COMPONENTS, STEPS), np.full(COMPONENTS, frames - 1.0)
    chi2 = null_chi2(frames, trials=4000, seed=frames)
    p = np.array([chi2_test(x, counts, nu) for x in chi2])
    # 0.01 of 4000 is 40 +- 6.3; the moments match no distribution exactly, hence the wider upper side.
    assert 0.004 <= np.mean(p < 0.01) <= 0.02
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.015)
    assert np.mean(p < 0.5) == pytest.approx(0.5, abs=0.04)
    naive = stats.chi2.sf(chi2, COMPONENTS * STEPS)
    assert np.mean(naive < 0.01) > 0.05  # measured: 0.63, 0.22, 0.09


def autoregressive(rho: float, shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    x = rng.normal(size=shape)
    for t in range(1, shape[-1]):
        x[..., t] = rho * x[..., t - 1] + np.sqrt(1 - rho**2) * x[..., t]
    return x


def test_sd_and_correlation_from_the_same_frames_count_as_n_minus_2() -> None:
    frames, rho, trials = 300, 0.4, 1000
    rng = np.random.default_rng(8)
    static = autoregressive(rho, (trials, COMPONENTS, frames), rng)
    static -= static.mean(axis=-1, keepdims=True)
    sum2 = np.sum(static**2, axis=-1)
    variance, found = sum2 / (frames - 1), np.sum(static[..., 1:] * static[..., :-1], axis=-1) / sum2
    film = autoregressive(rho, (trials, COMPONENTS, STEPS), rng)
    new = film[..., 1:] - found[..., None] * film[..., :-1]
    first = film[..., 0] ** 2 / variance
    chi2 = np.sum(first + np.sum(new**2, axis=-1) / (variance * (1 - found**2)), axis=-1)
    counts, nu = np.full(COMPONENTS, STEPS), np.full(COMPONENTS, frames - 2.0)
    p = np.array([chi2_test(x, counts, nu) for x in chi2])
    # 10 +- 3 of 1000; the error of rho itself, left out, adds chi2 of 1 in 300: measured 0.013 - 0.017.
    assert 0.003 <= np.mean(p < 0.01) <= 0.03


def test_known_noise_gives_the_chi2_test_and_one_component_the_f_test() -> None:
    assert chi2_test(130.0, [60, 40], [np.inf, np.inf]) == pytest.approx(stats.chi2.sf(130, 100), rel=1e-12)
    # A single component is an F exactly.
    assert chi2_test(130.0, [100], [50]) == pytest.approx(stats.f.sf(1.3, 100, 50), rel=1e-9)


def test_the_power_is_not_lost() -> None:
    # Misfit that adds 15 % to chi2, 120 frames: found nearly always, in spite of the honest test.
    chi2 = 1.15 * null_chi2(300, trials=500, seed=1)
    p = [chi2_test(x, np.full(COMPONENTS, STEPS), np.full(COMPONENTS, 299.0)) for x in chi2]
    assert np.mean(np.array(p) < 0.01) > 0.8


def test_too_few_static_frames_are_refused() -> None:
    with pytest.raises(ValueError, match="noise of 4 effective static frames"):
        chi2_test(10.0, [10, 10], [4, 300])


def film_residuals(bend: float, *, trials: int, seed: int):
    """Whitened residuals (steps x components,) beside a fitted drift, each with its chi2: noise from 30
    static frames, plus a parabola of the given size in sd that is the same in all components."""
    rng = np.random.default_rng(seed)
    for _ in range(trials):
        scale = np.sqrt(29 / rng.chisquare(29, COMPONENTS))[COMPONENT]
        z = scale * (rng.normal(size=COMPONENT.size) + bend * np.tile(S**2, COMPONENTS))
        yield z - DRIFT @ (DRIFT.T @ z) / np.sum(DRIFT**2)


S = np.linspace(-1, 1, 200)
COMPONENT = np.repeat(np.arange(COMPONENTS), S.size)
DRIFT = np.tile(1 + S, COMPONENTS)[:, None]
CUBIC = np.polynomial.legendre.legvander(S, 3)
OMNIBUS = {"component": COMPONENT, "static_frames_effective": np.full(COMPONENTS, 29.0), "fitted": DRIFT}


@pytest.mark.parametrize("shared", [True, False])
def test_omnibus_is_uniform_where_nothing_is_missing(shared: bool) -> None:
    basis = np.tile(CUBIC, (COMPONENTS, 1)) if shared else np.kron(np.eye(COMPONENTS), CUBIC)
    p = np.array([omnibus(z, basis, **OMNIBUS) for z in film_residuals(0.0, trials=800, seed=4)])
    assert 0.0 < np.mean(p < 0.01) <= 0.0225  # 8 +- 2.8 of 800, less or more by 3.5 of them
    assert np.mean(p < 0.5) == pytest.approx(0.5, abs=0.07)  # 0.5 +- 0.018, four of them


def test_omnibus_finds_a_smooth_misfit_that_chi2_cannot() -> None:
    basis, counts = np.tile(CUBIC, (COMPONENTS, 1)), np.full(COMPONENTS, S.size)
    films = list(film_residuals(0.3, trials=200, seed=5))
    smooth = [omnibus(z, basis, **OMNIBUS) for z in films]
    whole = [chi2_test(z @ z, counts, np.full(COMPONENTS, 29.0)) for z in films]
    assert np.mean(np.array(smooth) < 0.01) > 0.75
    assert np.mean(np.array(whole) < 0.01) < 0.1


def test_omnibus_with_known_noise_is_a_chi2_of_the_rank() -> None:
    rng = np.random.default_rng(2)
    basis = rng.normal(size=(60, 3))
    z = rng.normal(size=60)
    q = np.linalg.qr(basis).Q
    twice = np.column_stack([basis, basis @ [1.0, 2.0, 3.0]])  # a fourth function that is none
    p = omnibus(z, twice, component=np.zeros(60, int), static_frames_effective=[np.inf])
    assert p == pytest.approx(stats.chi2.sf(np.sum((q.T @ z) ** 2), 3), rel=1e-9)


def test_omnibus_of_one_component_is_an_f_test() -> None:
    rng = np.random.default_rng(6)
    basis, z = rng.normal(size=(60, 5)), 1.3 * rng.normal(size=60)
    part = np.sum((np.linalg.qr(basis).Q.T @ z) ** 2)
    p = omnibus(z, basis, component=np.zeros(60, int), static_frames_effective=[12])
    assert p == pytest.approx(stats.f.sf(part / 5, 5, 12), rel=1e-9)


def test_omnibus_refuses_functions_that_the_fit_explains() -> None:
    jacobian = np.random.default_rng(3).normal(size=(20, 2))
    with pytest.raises(ValueError, match="the fitted parameters explain every function"):
        omnibus(
            np.ones(20),
            jacobian @ [[1.0], [2.0]],
            component=np.zeros(20, int),
            static_frames_effective=[100],
            fitted=jacobian,
        )


def test_criteria_and_multiplicity() -> None:
    assert bic(100.0, 3, 50) == pytest.approx(100 + 3 * np.log(50))
    assert sidak(0.01, 20) == pytest.approx(1 - 0.99**20)
    assert sidak(1e-300, 20) == pytest.approx(2e-299, abs=0)  # no loss where 1 - p is 1
    assert sidak(1.0, 5) == 1.0
    # Holm's steps by hand: 0.01 x 3, then 0.02 x 2, then 0.5; never below the one before.
    assert holm([0.02, 0.5, 0.01]) == pytest.approx([0.04, 0.5, 0.03])
    assert holm([0.02, 0.021, 0.01]) == pytest.approx([0.04, 0.04, 0.03])
    assert holm([0.6, 0.9]) == pytest.approx([1.0, 1.0])


def fit_with(covariance: list[list[float]], *, theta=(0.214, 0.083), at_bound=()) -> Fit:
    return Fit(
        parameters=(Parameter("C10", 0.01, 0.5, "MPa"), Parameter("C01", 0.0, 0.5, "MPa")),
        theta=np.array(theta),
        covariance=np.array(covariance),
        chi2=1.0,
        degrees_of_freedom=1,
        seed=0,
        evaluations=1,
        converged=True,
        reason="",
        at_bound=at_bound,
    )


def test_words_for_a_ridge() -> None:
    # Sum known to 0.002 MPa, difference to 0.3: variances (0.3^2 + 0.002^2) / 4, covariance negative.
    v, c = (0.3**2 + 0.002**2) / 4, (0.002**2 - 0.3**2) / 4
    words = identifiability(fit_with([[v, c], [c, v]]), ("C10", "C01"))
    assert "C10 and C01 cannot be separated by these targets: only their sum is known" in words
    # Sum and difference are independent here, so the sum at a given share is known to 0.002 / sqrt(1 +
    # small).
    says(words, "C10", "C01 = 0.297 MPa", "95 %", "0.2931", "0.3009")
    assert "correlation -1.000" in words


def test_words_for_a_sum_that_only_a_given_share_fixes() -> None:
    # What is known is C10 + 0.8 C01, to 0.002; C01 itself to 0.4: the bare sum has an sd of 0.08.
    known, loose = np.array([1.0, 0.8]), np.array([-0.8, 1.0])
    axes = np.stack([known / (known @ known), loose / np.linalg.norm(loose)], axis=1)
    covariance = axes @ np.diag([0.002**2, 0.4**2]) @ axes.T
    words = identifiability(fit_with(covariance.tolist()), ("C10", "C01"))
    # Share held at r = C01 / total: C10 + 0.8 C01 = total (1 - 0.2 r), so sd(total) = 0.002 / (1 - 0.2 *
    # 0.279).
    says(words, "C10", "C01 = 0.297 MPa", "95 %", "0.2928", "0.3012")


def test_words_where_the_share_is_known_but_the_errors_trade_off() -> None:
    v, c = 0.01**2, -0.95 * 0.01**2
    words = identifiability(fit_with([[v, c], [c, v]]), ("C10", "C01"))
    assert "cannot be separated by these targets one by one" in words
    assert "quote the sum and the share" in words
    says(words, "C10", "C01 = 0.297 MPa", "95 %", "0.291", "0.303")


def test_words_for_a_model_that_does_not_fit_give_no_interval() -> None:
    v = 0.01**2
    for c in (-0.95 * v, 0.0):
        fit = fit_with([[v, c], [c, v]])
        assert "interval" in identifiability(fit, ("C10", "C01"))
        assert "interval" not in identifiability(fit, ("C10", "C01"), fits=False)
        says(identifiability(fit, ("C10", "C01"), fits=False), "C10", "C01 = 0.297 MPa")
    loose = fit_with([[0.3**2, -(0.2999**2)], [-(0.2999**2), 0.3**2]])
    assert "interval" in identifiability(loose, ("C10", "C01"))
    assert "interval" not in identifiability(loose, ("C10", "C01"), fits=False)


def test_the_interval_of_a_share_stays_between_nothing_and_all() -> None:
    words = identifiability(fit_with([[0.03**2, 0], [0, 0.03**2]], theta=(0.29, 0.005)), ("C10", "C01"))
    assert "share C01/(C10 + C01) = 0.0169 (95 % interval 0.00 to" in words


def test_words_where_they_part_and_where_a_bound_or_nothing_is_known() -> None:
    parted = fit_with([[1e-6, 0], [0, 1e-6]])
    assert identifiability(parted, ("C10", "C01")).endswith("These targets tell C10 and C01 apart.")
    assert identifiability(parted, ("C10", "C01"), fits=False).endswith("apart, but only with a model that fits.")
    stuck = fit_with([[1e-6, 0], [0, 0]], theta=(0.297, 0.0), at_bound=("C01",))
    assert "cannot be separated by these targets: the fit ends at a bound of C01" in identifiability(
        stuck, ("C10", "C01")
    )
    lost = fit_with([[np.inf, np.nan], [np.nan, np.inf]])
    assert "the data leave them undetermined" in identifiability(lost, ("C10", "C01"))
    with pytest.raises(ValueError, match=r"no parameter \['C20'\]"):
        identifiability(lost, ("C10", "C20"))


def test_excess_is_the_misfit_in_smooth_functions_beyond_noise() -> None:
    rng = np.random.default_rng(31)
    basis, fitted = rng.standard_normal((3000, 12)), rng.standard_normal((3000, 2))
    noise = rng.standard_normal((400, 3000))
    of_noise = [excess(z, basis, fitted=fitted) for z in noise]
    assert np.mean(of_noise) == pytest.approx(0, abs=5 * np.sqrt(24 / 400))  # chi2 of 12, less 12
    misfit = 0.3 * basis[:, 0]
    apart = misfit - fitted @ np.linalg.lstsq(fitted, misfit, rcond=None)[0]
    of_both = [excess(z + misfit, basis, fitted=fitted) for z in noise]
    size = apart @ apart
    assert np.mean(of_both) == pytest.approx(size, abs=5 * np.sqrt((24 + 4 * size) / 400))
    # noise stated three times too large hides the misfit from chi2, but not here
    overstated = (noise[0] + misfit) / 3
    assert overstated @ overstated < 3000
    assert excess(overstated, basis, fitted=fitted) > size / 9 - 12 - 5 * np.sqrt(24 + 4 * size / 9)
    assert excess(overstated, basis, fitted=fitted) > 10
