"""Markov chains against posteriors that are known in closed form, or by integration over a grid."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from emcee.moves import DEMove, StretchMove
from scipy.stats import norm

from calibrate import Parameter, least_squares, posteriors, profile_likelihood
from calibrate.parameters import Array
from calibrate.posteriors import END, RHAT, TAUS, Chain, sampled, spread
from calibrate.profiles import Held


def walkers(at: Array, sd: Array, *, seed: int = 4, count: int = 32) -> Array:
    return np.asarray(at + sd * np.random.default_rng(seed).normal(size=(count, len(at))))


def mc(chain: Chain, sd: Array | float) -> Array:
    """1 sd (d,) of a mean over the chain."""
    return np.asarray(sd * np.sqrt(chain.tau / (chain.kept.shape[0] * chain.kept.shape[1])))


def test_the_posterior_of_a_linear_model_is_its_covariance_and_its_profile() -> None:
    x = np.linspace(0, 1, 20)
    design = np.column_stack([np.ones(20), x])
    y = design @ [1.0, 2.0] + np.random.default_rng(5).normal(size=20)
    both = [Parameter("p", -50, 50), Parameter("q", -50, 50)]
    model = (lambda t: y - design @ t), (lambda t: -design)
    fit = least_squares(*model, both, start=(0, 0), tolerance=1e-6)
    root = np.linalg.qr(np.column_stack([design, y])).R

    def density(t: Array) -> Array:
        return -0.5 * ((np.column_stack([-t, np.ones(len(t))]) @ root.T) ** 2).sum(axis=1)

    chain = sampled(density, walkers(fit.theta, fit.sd), seed=1)
    assert chain.doubt == ""
    off = chain.samples.mean(axis=0) - fit.theta
    assert np.all(np.abs(off) < 4 * mc(chain, fit.sd))  # one in 16,000
    np.testing.assert_allclose(np.cov(chain.samples.T), fit.covariance, rtol=0.12)  # of some 3000 independent positions: 4 sds
    for k, name in enumerate(("p", "q")):
        profile = profile_likelihood(lambda _: model, held=Held.parameter(both, name), theta=fit.theta)
        ends = [end.value for end in profile.ends[1]]
        np.testing.assert_allclose(np.percentile(chain.samples[:, k], END), ends, atol=0.15 * fit.sd[k])


def test_a_curved_posterior_is_that_of_integration() -> None:
    # measured: a b = 1 +- 0.3, b = 2 +- 0.5, both flat within 0 and 4
    def density(x: Array) -> Array:
        log_p = -0.5 * (((x[:, 0] * x[:, 1] - 1) / 0.3) ** 2 + ((x[:, 1] - 2) / 0.5) ** 2)
        return np.where(np.all((x >= 0) & (x <= 4), axis=1), log_p, -np.inf)

    chain = sampled(density, walkers(np.array([0.5, 2.0]), np.array([0.1, 0.2])), seed=2)
    assert chain.doubt == ""
    a, b = np.meshgrid(*(np.linspace(0, 4, 801),) * 2, indexing="ij")
    p = np.exp(np.maximum(-0.5 * (((a * b - 1) / 0.3) ** 2 + ((b - 2) / 0.5) ** 2), -700.0))
    for k, axis in ((0, 1), (1, 0)):
        at, weight = np.linspace(0, 4, 801), p.sum(axis=axis)
        share = np.cumsum(weight) / weight.sum()
        wanted = np.interp([0.025, 0.5, 0.975], share, at)
        found = np.percentile(chain.samples[:, k], [2.5, 50.0, 97.5])
        sd = np.sqrt(np.average((at - np.average(at, weights=weight)) ** 2, weights=weight))
        np.testing.assert_allclose(found, wanted, atol=0.2 * sd)  # emcee's own snooker move was off by 0.5


def test_a_posterior_ends_at_a_bound() -> None:
    def density(x: Array) -> Array:
        return np.where(x[:, 0] >= 0, -0.5 * (x[:, 0] + 0.5) ** 2, -np.inf)

    start = np.abs(walkers(np.array([0.5]), np.array([0.4])))
    chain = sampled(density, start, seed=3)
    assert chain.samples.min() >= 0.0
    wanted = norm.isf(norm.sf(0.5) * np.array([0.975, 0.5, 0.025])) - 0.5
    np.testing.assert_allclose(np.percentile(chain.samples, [2.5, 50.0, 97.5]), wanted, atol=0.06)


def gauss(x: Array) -> Array:
    return np.asarray(-0.5 * (x**2).sum(axis=1))


@pytest.fixture(scope="module")
def trusted() -> Chain:
    """A chain of two normal numbers that may be trusted."""
    return sampled(gauss, walkers(np.zeros(2), np.ones(2)), seed=1)


def test_a_chain_that_was_killed_goes_on_with_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    start, kept = walkers(np.zeros(3), np.ones(3)), []
    whole = sampled(gauss, start, seed=7, most=1000, step=kept.append)
    assert len(kept) == 4
    again = Chain.of({name: np.asarray(x) for name, x in kept[1].arrays.items()})
    for name, x in sampled(gauss, start, seed=7, most=1000, chain=again).arrays.items():
        np.testing.assert_array_equal(x, whole.arrays[name], err_msg=name)
    assert sampled(gauss, start, seed=7, most=1000, chain=whole) is whole
    monkeypatch.setattr(posteriors, "BLOCK", 750)
    at_once = sampled(gauss, start, seed=7, most=750)
    np.testing.assert_array_equal(at_once.positions, whole.positions[:750])
    other = sampled(gauss, start, seed=8, most=250)
    assert not np.array_equal(other.positions[0], whole.positions[0])


def test_moves_of_emcee_are_an_argument() -> None:
    start = walkers(np.zeros(2), np.ones(2))
    usual = sampled(gauss, start, seed=7, most=250)
    named = sampled(gauss, start, seed=7, most=250, moves=[(DEMove(), 0.8), (StretchMove(), 0.2)])
    np.testing.assert_array_equal(usual.positions, named.positions)
    walk = sampled(gauss, start, seed=7, most=250, moves=StretchMove())
    assert not np.array_equal(usual.positions, walk.positions)


def test_a_chain_that_is_too_short_says_so(trusted: Chain) -> None:
    chain = sampled(gauss, walkers(np.zeros(2), np.ones(2)), seed=1, most=250)
    assert chain.steps == 250
    assert "autocorrelation times, wanted 100" in chain.doubt
    assert trusted.rhat.max() < RHAT
    assert len(trusted.kept) >= TAUS * trusted.tau.max()
    assert trusted.doubt == ""


def test_walkers_that_do_not_meet_are_seen(trusted: Chain) -> None:
    side = np.where(np.arange(32) % 2, 0.5, -0.5)[None, :, None]
    apart = replace(trusted, positions=trusted.positions + side)
    assert apart.tau.max() < 1.5 * trusted.tau.max()  # which alone does not show it
    assert "R-hat is 1." in apart.doubt


def test_walkers_that_stay_where_they_are_are_no_sample() -> None:
    still = Chain(np.ones((500, 8, 2)), np.zeros((500, 8)), np.full(8, 250.0), np.zeros(624), np.zeros(3))
    assert np.all(np.isinf(still.tau))
    assert "0 autocorrelation times" in still.doubt
    stuck = replace(still, accepted=np.zeros(8))
    assert "0.0% of its moves" in stuck.doubt


def test_checks_lie_far_apart_within_the_sample(trusted: Chain) -> None:
    found = spread(trusted, 8)
    assert np.all((found**2).sum(axis=1) <= 6.5)  # 95 % lie within 5.99
    assert (found[0] ** 2).sum() > 4.5
    apart = np.linalg.norm(found[:, None] - found[None], axis=2)[~np.eye(8, dtype=bool)]
    assert apart.min() > 1.0
    assert len(np.unique(np.sign(found), axis=0)) == 4


def test_what_is_no_start_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="3 walkers of 2 parameters: wanted 4 or more, an even number"):
        sampled(gauss, np.zeros((3, 2)), seed=0)
    with pytest.raises(ValueError, match="the density of some walkers is 0"):
        sampled(lambda x: np.where(x[:, 0] > 0, 0.0, -np.inf), walkers(np.zeros(1), np.ones(1)), seed=0)
    monkeypatch.setitem(sys.modules, "emcee", None)
    with pytest.raises(ValueError, match=r"needs emcee and corner.*pip install emcee corner"):
        sampled(gauss, walkers(np.zeros(1), np.ones(1)), seed=0)
