"""The noise model of displacements that no static film was made of: as the user states it, or as the values
scatter while the pressure rests or is held."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from twin.targets import Array, Noise

Still = tuple[tuple[int, int], ...] | Literal["holds"]  # first and last steps, from 0; or found by pressure
STATED = 10**6  # frames of a noise that is stated: as good as known
HELD = 0.01  # of the largest pressure is how far it may move in a hold
SHORTEST = 8  # steps of a hold that is long enough to tell scatter from creep
DEGREE = 3  # of the polynomial of time that takes the creep out of a hold
ROUNDED = 1e-9  # mm: what arithmetic leaves of a value that never changes
LEAST = 30  # free values of every component: fewer know its sd worse than to a tenth


def stated_noise(value: Array, sd_mm: float, rho: float = 0.0) -> Noise:
    """The noise model that an sd states for values (s, p, 3) mm: of each by itself, and from step to step
    correlated by rho."""
    seen = np.isfinite(value).any(axis=0)
    sentence = f"The noise is taken as stated, an sd of {sd_mm:g} mm{correlated(rho)}: "
    sentence += "the verdict holds if that is right."
    sd = np.where(seen, sd_mm, np.nan)
    return _noise(sd, np.where(seen, rho, np.nan), np.eye(sd.size), STATED, sentence)


def correlated(rho: float) -> str:
    """How values hang together from step to step, in words after a comma."""
    return f", correlated by {rho:.2g} from step to step" if rho else ", each value by itself"


def mean_variance(rho: float, count: int) -> float:
    """The variance of a mean of so many values over that of one: of an autoregression with rho."""
    return min((1 + rho) / (1 - rho) / count, 1.0)


def still_noise(value: Array, pressure: Array, still: Still) -> Noise:
    """The noise model of values (s, p, 3) mm by their scatter in steps at rest or under a held pressure.

    pressure (s,) MPa. In each stretch a polynomial of time is taken out, for the silicone creeps. ValueError
    where a component has fewer than LEAST free values in them, or does not scatter at all.
    """
    stretches = holds(pressure) if still == "holds" else list(still)
    for start, end in stretches:
        if not 0 <= start <= end < len(value):
            raise ValueError(
                f"still_steps = [{start}, {end}]: wanted the first and last step of a rest or hold, from 0 "
                f"to {len(value) - 1}"
            )
    s, p, _ = value.shape
    flat = value.reshape(s, 3 * p)
    parts = [_scatter(flat[start : end + 1]) for start, end in stretches]
    scatter = np.concatenate([np.zeros((0, 3 * p)), *(rest for rest, _ in parts)])
    free = sum(n for _, n in parts)
    seen = np.isfinite(flat).any(axis=0)
    _check(scatter[:, seen], free, stretches)
    sd, rho, correlation = np.full(3 * p, np.nan), np.full(3 * p, np.nan), np.eye(3 * p)
    values = scatter[:, seen]
    taken = (len(values) - free) / len(values)  # by the polynomials, from the correlation too
    lag = _lagged([rest[:, seen] for rest, _ in parts])
    rho[seen] = lag = np.clip(lag + taken * (1 + 2 * lag), 0.0, 0.95)
    remaining = (1 - taken * (1 + lag) / (1 - lag)).clip(0.5)
    sd[seen] = np.sqrt((values**2).sum(axis=0) / (len(values) * remaining))
    correlation[np.ix_(seen, seen)] = np.corrcoef(values, rowvar=False) if seen.sum() > 1 else 1.0
    sentence = (
        f"The noise was estimated from {len(values)} steps at rest or under a held pressure, "
        "not from a static film."
    )
    return _noise(sd.reshape(p, 3), rho.reshape(p, 3), correlation, free, sentence)


def holds(pressure: Array) -> list[tuple[int, int]]:
    """First and last step of each stretch of SHORTEST steps or more in which the pressure (s,) stays within
    HELD.

    >>> holds(np.array([0.0, 1.0, *[2.0] * 9, 1.0]))
    [(2, 10)]
    """
    near, out, start = HELD * float(np.abs(pressure).max()), [], 0
    for k in range(1, len(pressure) + 1):
        if k == len(pressure) or np.ptp(pressure[start : k + 1]) > near:
            out += [(start, k - 1)] if k - start >= SHORTEST else []
            start = k
    return out


def _scatter(values: Array) -> tuple[Array, int]:
    """Scatter (k, m) of values about a polynomial of time, and its degrees of freedom; of the steps in which
    every component that is ever seen is seen."""
    complete = values[np.isfinite(values[:, np.isfinite(values).any(axis=0)]).all(axis=1)]
    degree = min(DEGREE, max((len(complete) - 1) // 4, 0))
    if len(complete) < 2:
        return np.zeros((0, values.shape[1])), 0
    basis = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(complete)), degree)
    fitted = basis @ np.linalg.lstsq(basis, np.nan_to_num(complete), rcond=None)[0]
    return complete - fitted, len(complete) - degree - 1


def _lagged(parts: Sequence[Array]) -> Array:
    """Lag-1 correlation (m,) of values over all stretches (k, m)."""
    along = sum((rest[1:] * rest[:-1]).sum(axis=0) for rest in parts)
    return np.asarray(along / sum((rest**2).sum(axis=0) for rest in parts), float)


def _check(scatter: Array, free: int, stretches: Sequence[tuple[int, int]]) -> None:
    """Raise ValueError where the scatter of components (k, m) says too little of their noise."""
    if free < LEAST or not np.isfinite(scatter).all():
        raise ValueError(
            f"still_steps: {len(stretches)} rests or holds leave {max(free, 0)} free values of each "
            f"component, wanted {LEAST} or more in which every point is seen; name longer ones, or "
            "state sd_mm instead"
        )
    if not (np.abs(scatter).max(axis=0) > ROUNDED).all():
        raise ValueError("still_steps: a component does not scatter at all; state sd_mm instead, in mm")


def _noise(sd: Array, rho: Array, correlation: Array, frames: int, basis: str) -> Noise:
    nothing: NDArray[np.float64] = np.where(np.isnan(sd), np.nan, 0.0)
    return Noise(
        sd=sd, rho=rho, correlation=correlation, frames=frames, codec_sd=nothing, gauge_sd_MPa=0.0,
        gauge_frames=0, basis=basis,
    )  # fmt: skip
