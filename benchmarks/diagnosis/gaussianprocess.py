"""An additive discrepancy as Dakota fits one: a Gaussian process on what the calibrated base model leaves.

The model is calibrated first; the process learns measured - predicted over pressure and place, each axis for
itself, with one size and two lengths chosen by the likelihood. It names nothing: it says `discrepancy` or
not, and corrects what is foretold.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from twin.targets import Array, Targets

SIZES = (0.1, 0.3, 1.0, 3.0, 10.0)  # of the residual's rms
PRESSURES = (0.15, 0.4, 1.0, 2.5)  # lengths as shares of the top pressure
PLACES = (10.0, 30.0, 100.0)  # mm
SAID = 6.0  # 2 ln of the likelihood ratio beyond noise alone, from which on it says `discrepancy`


@dataclass(frozen=True)
class Discrepancy:
    """said: whether it is more than noise; learnt (k, p, 3) mm: the correction of what is foretold."""

    said: bool
    learnt: Array


@dataclass(frozen=True)
class Grid:
    """Correlations of steps (s, s) and of markers (m, m) with their eigenvectors: their products are those of
    all values."""

    steps: tuple[Array, Array]
    markers: tuple[Array, Array]

    @staticmethod
    def of(pressure: Array, place: Array, lengths: tuple[float, float]) -> "Grid":
        """For pressures (s, 1) as shares of the top, and places (m, 2) mm."""
        one, two = (
            np.linalg.eigh(alike(x, x, length)) for x, length in zip((pressure, place), lengths, strict=True)
        )
        return Grid((one[0], one[1]), (two[0], two[1]))

    def fitted(self, y: Array, size: float, sd: float) -> tuple[float, Array]:
        """2 ln likelihood of values (s, m) over noise alone, and their weights (s, m)."""
        up, ux = self.steps[1], self.markers[1]
        variance = size**2 * np.clip(np.outer(self.steps[0], self.markers[0]), 0.0, None) + sd**2
        inner = up.T @ y @ ux
        gain = (inner**2 * (sd**-2 - 1 / variance)).sum() - np.log(variance / sd**2).sum()
        return float(gain), np.asarray(up @ (inner / variance) @ ux.T)


def discrepancy(judged: Any, targets: Targets, steps: Array) -> Discrepancy:
    """The process on the residual of the steps that a fit sees, asked at `steps` (s,) of True and False."""
    pressure = (targets.pressure / targets.pressure.max())[:, None]
    place = np.array([p.position for p in targets.points])[~targets.fixed][:, ::2]
    seen, values = ~targets.held_out, dict(_values(judged, targets))
    rms = float(np.sqrt(np.mean([(y**2).mean() for y, _ in values.values()])))
    best: tuple[Any, ...] = ()
    for lengths in product(PRESSURES, PLACES):
        grid = Grid.of(pressure[seen], place, lengths)
        for size in SIZES:
            fits = {axis: grid.fitted(y, size * rms, sd) for axis, (y, sd) in values.items()}
            gain = sum(g for g, _ in fits.values())
            if not best or gain > best[0]:
                best = gain, size * rms, lengths, {axis: w for axis, (_, w) in fits.items()}
    gain, size, lengths, weights = best
    asked = alike(pressure[steps], pressure[seen], lengths[0])
    out = np.zeros((len(asked), *targets.value.shape[1:]))
    for axis, w in weights.items():
        out[:, ~targets.fixed, axis] = size**2 * asked @ w @ alike(place, place, lengths[1])
    return Discrepancy(gain > SAID, out)


def alike(x: Array, y: Array, length: float) -> Array:
    """Correlations (n, m) of rows (n, d) and (m, d) that fall off over a length."""
    return np.asarray(np.exp(-0.5 * ((x[:, None] - y) ** 2).sum(axis=-1) / length**2))


def _values(judged: Any, targets: Targets) -> Iterator[tuple[int, tuple[Array, float]]]:
    """By axis the residual (s, m) mm of the markers on the finger, and the noise's sd; a value that was not
    seen is 0."""
    seen, moving = ~targets.held_out, ~targets.fixed
    residual = np.nan_to_num(targets.value - judged.predicted)[seen][:, moving]
    for axis in (0, 2):
        sd = np.sqrt(np.nanmedian(targets.covariance[..., axis, axis]))
        yield axis, (residual[..., axis], float(sd))
