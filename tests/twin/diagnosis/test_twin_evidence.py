"""What linear evidence promises: closed forms, brute-force integrals, and rates over draws."""

import numpy as np
import pytest
from scipy.integrate import quad

from twin.diagnosis.evidence import Gram, apart, ceiling, occam, orthonormal

RNG = np.random.default_rng(7)
TWO, ONE = np.array([False]), np.array([True])


def problem(size: float, *, k: int = 1, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """A residual (n,) with `size` in each of k columns (n, k)."""
    columns = RNG.standard_normal((n, k)) * 0.3
    return columns @ np.full(k, size) + RNG.standard_normal(n), columns


@pytest.mark.parametrize("one_sided", [False, True])
@pytest.mark.parametrize("size", [-2.0, 0.0, 1.5])
def test_evidence_is_the_ratio_of_marginal_likelihoods(size: float, one_sided: bool) -> None:
    z, c = problem(size)

    def ratio(a: float) -> float:
        prior = np.exp(-(a**2) / 2) / np.sqrt(2 * np.pi) * (2 if one_sided else 1)
        r = z - c[:, 0] * a
        return float(prior * np.exp((z @ z - r @ r) / 2))

    # a thousandth: quad's own error on a peak whose width it does not know
    whole = quad(ratio, 0.0 if one_sided else -8.0, 8.0, limit=200)[0]
    found = Gram.of(z, c).log_bayes(np.array([one_sided]))
    assert found == pytest.approx(2 * np.log(whole), abs=2e-3)


def test_what_is_attained_keeps_within_the_bounds() -> None:
    z, c = problem(-3.0)
    gram = Gram.of(z, c)
    free, gain = gram.attained(np.array([-np.inf]), np.array([np.inf]))
    assert gain == pytest.approx(float((c[:, 0] @ z) ** 2 / (c[:, 0] @ c[:, 0])))
    held, nothing = gram.attained(np.array([0.0]), np.array([np.inf]))
    assert free[0] < 0
    assert (held[0], nothing) == (0.0, 0.0)  # an effect that can only add gains nothing where it would take away
    short, some = gram.attained(np.array([-1.0]), np.array([1.0]))
    assert short[0] == -1.0
    assert 0 < some < gain


def test_several_amplitudes_are_attained_together() -> None:
    z, c = problem(1.0, k=3)
    low, high = np.full(3, -np.inf), np.full(3, np.inf)
    amplitudes, gain = Gram.of(z, c).attained(low, high)
    best, *_ = np.linalg.lstsq(c, z, rcond=None)
    assert amplitudes == pytest.approx(best, rel=1e-6)
    assert gain == pytest.approx(z @ z - ((z - c @ best) ** 2).sum(), rel=1e-6)
    twice = np.concatenate([c, c[:, :1]], axis=1)  # a column that says nothing new adds nothing
    assert Gram.of(z, twice).attained(np.full(4, -9.0), np.full(4, 9.0))[1] == pytest.approx(gain, rel=1e-6)


def test_laplace_of_a_linear_fit_is_its_evidence() -> None:
    z, c = problem(0.8, k=2)
    gram = Gram.of(z, c)
    amplitudes, gain = gram.attained(np.full(2, -np.inf), np.full(2, np.inf))
    both = np.array([False, False])
    assert gain - occam(amplitudes, gram.S) == pytest.approx(gram.log_bayes(both), rel=1e-6)


def test_noise_alone_is_seldom_evidence() -> None:
    c = RNG.standard_normal((50, 1))
    found = [Gram.of(RNG.standard_normal(50), c).log_bayes(TWO) for _ in range(400)]
    # 2 ln B > 6 is odds of 20 to 1: by Markov's inequality at most 5 % of draws, here far fewer
    assert np.mean(np.array(found) > 6.0) <= 0.02
    assert np.median(found) < 0


def test_ceilings_are_squared_cosines() -> None:
    basis = np.linalg.qr(RNG.standard_normal((40, 3))).Q
    a, b = basis[:, 0], basis[:, 1]
    mixed = np.cos(0.3) * a + np.sin(0.3) * b
    assert ceiling(mixed, a[:, None]) == pytest.approx(np.cos(0.3) ** 2)
    assert ceiling(mixed, basis[:, :2]) == pytest.approx(1.0)
    assert ceiling(mixed, basis[:, 2:]) == pytest.approx(0.0, abs=1e-12)
    assert ceiling(np.zeros(40), basis) == 0.0


def test_what_was_fitted_is_taken_out() -> None:
    fitted = RNG.standard_normal((40, 2)) * [1e-6, 1e6]  # parameters of any unit
    basis = orthonormal(np.concatenate([fitted, fitted[:, :1]], axis=1))
    assert basis.shape == (40, 2)
    left = apart(RNG.standard_normal((40, 5)), basis)
    assert np.abs(fitted.T @ left / np.linalg.norm(fitted, axis=0)[:, None]).max() < 1e-12
