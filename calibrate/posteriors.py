"""Markov chain Monte Carlo of a log density, with checks of convergence.

The walkers are emcee's (D. Foreman-Mackey et al. 2013, doi:10.1086/670067), with moves of differential
evolution (C. J. F. ter Braak 2006, doi:10.1007/s11222-006-8769-1) and stretch moves (J. Goodman, J. Weare
2010, doi:10.2140/camcos.2010.5.65). A chain is long enough where each walker has been through many
autocorrelation times, and halves of walkers agree: split R-hat (A. Vehtari et al. 2021,
doi:10.1214/20-BA1221).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from calibrate.parameters import Array

LogDensity = Callable[[Array], Array]
BLOCK = 250  # steps between two checks
BURN = 0.2  # of all steps, at the beginning, that are left out
TAUS = 100.0  # autocorrelation times that every walker goes through at least
RHAT = 1.01  # of every parameter at most
ACCEPTED = 0.05  # of all moves at least
MOST = 20000  # steps of a walker
HALF, END = (16.0, 84.0), (2.5, 97.5)  # percentiles of the 68 % and of the 95 % interval


@dataclass(frozen=True, eq=False)
class Chain:
    """Chain of w walkers over n steps: positions (n, w, d), log densities (n, w), accepted moves (w,).

    key (624,), place (3,): state of the Mersenne twister (its position, flag and value of a stored normal
    number), from which the chain goes on bit by bit.
    """

    positions: Array
    log_density: Array
    accepted: Array
    key: Array
    place: Array

    @property
    def steps(self) -> int:
        """Steps of a walker."""
        return len(self.positions)

    @property
    def kept(self) -> Array:
        """Positions (k, w, d) after burn-in."""
        return self.positions[int(BURN * self.steps) :]

    @property
    def samples(self) -> Array:
        """Positions (k w, d) after burn-in, walker by walker within a step."""
        return self.kept.reshape(-1, self.positions.shape[2])

    @property
    def log_densities(self) -> Array:
        """Log densities (k w,) of `samples`."""
        return self.log_density[int(BURN * self.steps) :].ravel()

    @property
    def acceptance(self) -> float:
        """Share of accepted moves."""
        return float(self.accepted.mean() / self.steps)

    @cached_property
    def tau(self) -> Array:
        """Integrated autocorrelation time (d,) in steps; inf where no walker moves."""
        from emcee.autocorr import integrated_time

        out = np.full(self.positions.shape[2], np.inf)
        moving = np.ptp(self.kept, axis=0).min(axis=0) > 0
        if moving.any():
            with np.errstate(under="ignore"):
                out[moving] = integrated_time(self.kept[:, :, moving], tol=0, quiet=True)
        return out

    @property
    def rhat(self) -> Array:
        """Split R-hat (d,): spread of all half chains over the spread within each; inf without moves."""
        half = len(self.kept) // 2
        halves = np.concatenate([self.kept[:half], self.kept[half : 2 * half]], axis=1)  # (n, 2 w, d)
        within, between = halves.var(axis=0, ddof=1).mean(axis=0), halves.mean(axis=0).var(axis=0, ddof=1)
        out = np.full(len(within), np.inf)
        moving = within > 0
        out[moving] = np.sqrt((half - 1) / half + between[moving] / within[moving])
        return out

    @property
    def doubt(self) -> str:
        """Reason against trusting the chain, "" where it has converged."""
        if self.acceptance < ACCEPTED:
            return f"{self.acceptance:.1%} of its moves are accepted, wanted {ACCEPTED:.0%}"
        times = len(self.kept) / self.tau.max()
        if times < TAUS:
            return f"each walker went through {times:.0f} autocorrelation times, wanted {TAUS:.0f}"
        if not self.rhat.max() < RHAT:
            return f"R-hat is {self.rhat.max():.3f}, wanted below {RHAT}"
        return ""

    @property
    def arrays(self) -> dict[str, Array]:
        """Arrays by the name of their field."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @staticmethod
    def of(arrays: Mapping[str, Any]) -> "Chain":
        """Chain of its arrays by name."""
        return Chain(**{field.name: arrays[field.name] for field in fields(Chain)})

    def and_then(self, more: "Chain") -> "Chain":
        """This chain continued by another that begins at its end."""
        return Chain(
            np.concatenate([self.positions, more.positions]),
            np.concatenate([self.log_density, more.log_density]),
            self.accepted + more.accepted, more.key, more.place,
        )  # fmt: skip


def sampled(
    log_density: LogDensity,
    start: Array,
    *,
    seed: int,
    chain: Chain | None = None,
    most: int = MOST,
    moves: Any = None,
    step: Callable[[Chain], None] = lambda chain: None,
) -> Chain:
    """Chain of a log density, continued until it has converged or has `most` steps.

    log_density: positions (m, d) -> (m,), -inf outside the support. start (w, d): first positions of the
    walkers, all of finite density. chain: chain to continue, bit by bit as without a stop. moves: moves of
    emcee, or pairs (move, weight); by default 0.8 DEMove and 0.2 StretchMove. step: called with the chain
    after each BLOCK of steps. Raises ValueError for an impossible start, and without emcee.

    A standard normal distribution in two dimensions:

    >>> import numpy as np
    >>> start = np.random.default_rng(1).normal(size=(16, 2))
    >>> chain = sampled(lambda x: -0.5 * (x**2).sum(axis=1), start, seed=1, most=500)
    >>> np.abs(chain.samples.mean(axis=0)).max() < 0.1, np.abs(chain.samples.std(axis=0) - 1).max() < 0.1
    (np.True_, np.True_)
    """
    walkers, size = start.shape
    if walkers < 2 * size or walkers % 2:
        raise ValueError(
            f"start: {walkers} walkers of {size} parameters: wanted {2 * size} or more, an even number"
        )
    emcee = _emcee()
    # not DESnookerMove: up to emcee 3.1.6 it samples another density (https://github.com/dfm/emcee/pull/531)
    moves = moves or [(emcee.moves.DEMove(), 0.8), (emcee.moves.StretchMove(), 0.2)]
    with np.errstate(under="ignore"):
        able = chain is not None or bool(np.all(np.isfinite(log_density(start))))
    if not able:
        raise ValueError("start: the density of some walkers is 0; wanted all of them where it is not")
    while chain is None or (chain.steps < most and chain.doubt):
        sampler = emcee.EnsembleSampler(walkers, size, log_density, moves=moves, vectorize=True)
        state: Any = start
        if chain is None:
            sampler.random_state = np.random.RandomState(seed).get_state()
        else:
            place, stored, normal = chain.place
            twister = ("MT19937", chain.key, int(place), int(stored), float(normal))
            state = emcee.State(chain.positions[-1], log_prob=chain.log_density[-1], random_state=twister)
        with np.errstate(under="ignore"):
            end = sampler.run_mcmc(state, BLOCK, skip_initial_state_check=chain is not None)
        more = Chain(
            sampler.get_chain(), sampler.get_log_prob(), np.asarray(sampler.backend.accepted, float),
            np.asarray(end.random_state[1]), np.array(end.random_state[2:], float),
        )  # fmt: skip
        chain = more if chain is None else chain.and_then(more)
        step(chain)
    return chain


def spread(chain: Chain, count: int) -> Array:
    """Farthest-point sample (count, d) of the densest 95 % of a chain.

    The position farthest from the mean comes first, then always the one farthest from all before it, in sds
    of the chain.
    """
    samples = chain.samples
    dense = samples[chain.log_densities >= np.percentile(chain.log_densities, 5.0)]
    candidates = dense[:: max(len(dense) // 4000, 1)]
    root = np.linalg.cholesky(np.atleast_2d(np.cov(samples.T)))
    unit = np.linalg.solve(root, (candidates - samples.mean(axis=0)).T).T
    near, out = np.linalg.norm(unit, axis=1), []
    for _ in range(count):
        k = int(np.argmax(near))
        out.append(candidates[k])
        near = np.minimum(near if len(out) > 1 else np.inf, np.linalg.norm(unit - unit[k], axis=1))
    return np.array(out)


def _emcee() -> Any:
    try:
        import emcee
    except ImportError:
        raise ValueError(
            "a posterior needs emcee and corner, which are not installed; run pip install emcee corner"
        ) from None
    return emcee
