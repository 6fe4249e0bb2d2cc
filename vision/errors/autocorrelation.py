"""Memory of noise: the part of a place's scatter at rest that comes anew in every frame, and the part that
stays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from vision.camera import Array

# Where these numbers come from: docs/records/error-numbers.md
MOST_RHO = 0.98  # of what lasts: a memory of 50 frames
LAGS = 14  # number of lags that are compared
TOWARDS_LONG = 0.25  # a lag counts with this power of its length: slow errors harm a fit most
SURE = 3.0  # sds of the lag-1 correlation from which noise lasts at all


@dataclass(frozen=True)
class Persistence:
    """Noise: white, plus a part that lasts."""

    lasting: float  # share of the variance that is correlated from frame to frame
    rho: float  # correlation of that part from one frame to the next
    total: float  # variance over that of what is new in every frame, as `innovations` has it
    first: float  # correlation of the whole from one frame to the next

    def of_mean(self, count: int) -> float:
        """Variance of the mean of successive values, relative to a single value.

        >>> WHITE.of_mean(100)
        0.01
        >>> slow = Persistence(lasting=0.5, rho=0.9, total=1.0, first=0.45)
        >>> round(slow.of_mean(100), 4)  # as if 11 values were independent
        0.091
        """
        return float(of_mean(np.array(self.lasting), np.array(self.rho), count))

    def independent(self, frames: int) -> float:
        """Number of independent values that tell a variance as well as these frames do (Bartlett 1946)."""
        lasts = self.lasting**2 * self.rho**2 / (1.0 - self.rho**2)
        return max(frames / (1.0 + 2.0 * lasts), 2.0)


WHITE = Persistence(0.0, 0.0, 1.0, 0.0)


def of_mean(lasting: Array, rho: Array, count: int) -> Array:
    """Variance of the mean of `count` successive values, relative to a single value: white noise, and a share
    `lasting` that is an autoregression with rho."""
    lag = np.arange(1, count)
    weight = np.sum((1.0 - lag / count) * _left(rho, lag), axis=-1)
    return np.asarray((1.0 + 2.0 * lasting * weight) / count)


def _left(rho: Array | float, lag: NDArray[np.intp]) -> Array:
    """Correlation (...,l) that is left after some frames: rho^lag, 0 where that would underflow."""
    power = np.log(np.maximum(np.asarray(rho)[..., None], 1e-300)) * lag
    return np.where(power > -500.0, np.exp(np.maximum(power, -500.0)), 0.0)


def persistence_of(error: Array) -> Persistence:
    """The memory that all errors (t,n) at rest share, each about its own mean; NaN where not seen.

    Video compression repeats what hardly changes, and its error with it: the correlation at a lag of 1 would
    tell too short a memory. Half the mean square difference at lags up to half of the film is
    w + v (1 - rho^lag), which least squares fit; w, v >= 0. Errors are first divided by the sd of what is new
    in them: by their own sd, of which a film knows little, the slow ones would count less.
    """
    unit = _scaled(error, error)
    if not unit.size:
        return WHITE
    ahead, behind = np.nan_to_num(unit[1:]), np.nan_to_num(unit[:-1])
    lag1 = float(np.sum(ahead * behind) / np.sum(np.nan_to_num(unit) ** 2))
    if lag1 < SURE * _scatter(np.nan_to_num(unit)):
        return WHITE
    unit = _scaled(unit, innovations(unit, lag1))
    lags = np.unique(np.round(np.geomspace(1, len(error) // 2, LAGS)).astype(int))
    semivariance = np.array([0.5 * np.nanmean((unit[lag:] - unit[:-lag]) ** 2) for lag in lags])
    weight = lags**TOWARDS_LONG
    best, result = np.inf, (0.0, 1.0, 0.0)
    for rho in np.exp(-1.0 / np.geomspace(0.3, -1.0 / np.log(MOST_RHO), 80)):
        terms = np.stack([np.ones(len(lags)), 1.0 - _left(rho, lags)], axis=1) / semivariance[:, None]
        (white, lasts), misfit = nnls(terms * weight[:, None], weight)
        if misfit < best:
            best, result = misfit, (float(rho), float(white), float(lasts))
    rho, white, lasts = result
    return Persistence(lasts / (white + lasts), rho, white + lasts, lag1)


def _scatter(unit: Array) -> float:
    """Sd of the pooled lag-1 correlation of white errors (t,n), which may be correlated with each other."""
    correlation = unit.T @ unit / len(unit)
    return float(np.sqrt((correlation**2).sum() / len(unit)) / unit.shape[1])


def _scaled(error: Array, by: Array) -> Array:
    """Errors (t,n) over the rms of others (s,n), without those that have none."""
    size = np.sqrt(np.nansum(by**2, axis=0) / np.maximum(np.isfinite(by).sum(axis=0), 1))
    return np.asarray(error[:, size > 0] / size[size > 0])


def innovations(error: Array, lag1: float) -> Array:
    """Innovations (t-1,...): the new part in every frame but the first of errors (t,...) with the correlation
    `lag1` from frame to frame.

    It is nearly white, so that it tells how points are correlated, and which are noisier, ten times better
    than the errors themselves.
    """
    return np.asarray(error[1:] - lag1 * error[:-1])
