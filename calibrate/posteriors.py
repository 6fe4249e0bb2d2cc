"""A log density -> a Markov chain of its parameters, with the checks that say whether it may be trusted.

The walkers are emcee's (D. Foreman-Mackey et al. 2013, doi:10.1086/670067), with moves of differential
evolution (C. J. F. ter Braak 2006, doi:10.1007/s11222-006-8769-1) and stretch moves (J. Goodman, J. Weare
2010, doi:10.2140/camcos.2010.5.65). A chain is long enough where each walker has been through many
autocorrelation times, and halves of walkers agree: split R-hat (A. Vehtari et al. 2021,
doi:10.1214/20-BA1221).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
    """Positions (n, w, d) of w walkers after each of n steps, their log densities (n, w), how many moves (w,)
    were accepted, and the state of the random numbers: key (624,) of a Mersenne twister, and (3,) its place,
    whether it keeps a normal number, and that."""

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
        """The positions (k, w, d) after the beginning."""
        return self.positions[int(BURN * self.steps) :]

    @property
    def samples(self) -> Array:
        """The positions (k w, d) after the beginning, walker by walker within a step."""
        return self.kept.reshape(-1, self.positions.shape[2])

    @property
    def log_densities(self) -> Array:
        """The log densities (k w,) of `samples`."""
        return self.log_density[int(BURN * self.steps) :].ravel()

    @property
    def acceptance(self) -> float:
        """The share of all moves that were accepted."""
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
        """Split R-hat (d,): how much wider all halves of walkers together are than each; inf where no walker
        moves."""
        half = len(self.kept) // 2
        halves = np.concatenate([self.kept[:half], self.kept[half : 2 * half]], axis=1)  # (n, 2 w, d)
        within, between = halves.var(axis=0, ddof=1).mean(axis=0), halves.mean(axis=0).var(axis=0, ddof=1)
        out = np.full(len(within), np.inf)
        moving = within > 0
        out[moving] = np.sqrt((half - 1) / half + between[moving] / within[moving])
        return out

    @property
    def doubt(self) -> str:
        """Why the chain may not be trusted, "" where it may."""
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
        """All of it as arrays by name."""
        return {
            "positions": self.positions, "log_density": self.log_density, "accepted": self.accepted,
            "key": self.key, "place": self.place,
        }  # fmt: skip

    @staticmethod
    def of(arrays: Mapping[str, Any]) -> "Chain":
        """The chain of its arrays."""
        return Chain(*(arrays[name] for name in ("positions", "log_density", "accepted", "key", "place")))

    def and_then(self, other: "Chain") -> "Chain":
        """The chain with another that goes on where it ends."""
        return Chain(
            np.concatenate([self.positions, other.positions]),
            np.concatenate([self.log_density, other.log_density]),
            self.accepted + other.accepted, other.key, other.place,
        )  # fmt: skip


def sampled(
    log_density: LogDensity,
    start: Array,
    *,
    seed: int,
    chain: Chain | None = None,
    most: int = MOST,
    step: Callable[[Chain], None] = lambda chain: None,
) -> Chain:
    """The chain of a log density, as long as it must be to be trusted, or of `most` steps.

    log_density: positions (m, d) -> (m,), -inf where there is none. start (w, d): where the walkers begin,
    all of a finite density. chain: to be gone on with; the same bits come out as without a stop. step: called
    with the chain after each BLOCK of steps. Raises ValueError for a start that is none, and without emcee.
    """
    walkers, size = start.shape
    if walkers < 2 * size or walkers % 2:
        raise ValueError(
            f"start: {walkers} walkers of {size} parameters: wanted {2 * size} or more, an even number"
        )
    emcee = _emcee()
    # not DESnookerMove: up to emcee 3.1.6 it samples another density (https://github.com/dfm/emcee/pull/531)
    moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.StretchMove(), 0.2)]
    with np.errstate(under="ignore"):
        able = chain is not None or bool(np.all(np.isfinite(log_density(start))))
    if not able:
        raise ValueError("start: the density of some walkers is 0; wanted all of them where it is not")
    while chain is None or (chain.steps < most and chain.doubt):
        own = emcee.EnsembleSampler(walkers, size, log_density, moves=moves, vectorize=True)
        at: Any = start
        if chain is None:
            own.random_state = np.random.RandomState(seed).get_state()
        else:
            place, kept, normal = chain.place
            state = ("MT19937", chain.key, int(place), int(kept), float(normal))
            at = emcee.State(chain.positions[-1], log_prob=chain.log_density[-1], random_state=state)
        with np.errstate(under="ignore"):
            end = own.run_mcmc(at, BLOCK, skip_initial_state_check=chain is not None)
        more = Chain(
            own.get_chain(), own.get_log_prob(), np.asarray(own.backend.accepted, float),
            np.asarray(end.random_state[1]), np.array(end.random_state[2:], float),
        )  # fmt: skip
        chain = more if chain is None else chain.and_then(more)
        step(chain)
    return chain


def spread(chain: Chain, count: int) -> Array:
    """Positions (count, d) of a chain that lie far apart within the densest 95 % of it: the farthest from the
    mean first, then always the farthest from those before, in sds of the chain."""
    samples = chain.samples
    dense = samples[chain.log_densities >= np.percentile(chain.log_densities, 5.0)]
    some = dense[:: max(len(dense) // 4000, 1)]
    root = np.linalg.cholesky(np.atleast_2d(np.cov(samples.T)))
    unit = np.linalg.solve(root, (some - samples.mean(axis=0)).T).T
    near, out = np.linalg.norm(unit, axis=1), []
    for _ in range(count):
        k = int(np.argmax(near))
        out.append(some[k])
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
