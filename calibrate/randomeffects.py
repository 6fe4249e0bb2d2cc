"""Random effects of several groups: the sd between them, and a test of the newest group.

The model of a random-effects meta-analysis: y_i = mu + b_i + e_i, b_i ~ N(0, tau^2) between the groups, e_i
~ N(0, s_i^2) of the measurement, s_i known. A few groups tell tau poorly, and a test that takes its estimate
for the truth finds changes that are none. So the newest group is judged by its predictive distribution, in
which tau is integrated out.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from calibrate.parameters import Array

LEAST = 3  # former groups: two tell next to nothing of the sd between them
KNOTS = 400  # of the quadrature over tau; twice as many change p by less than 1e-3 of itself
# Where the prior of tau turns from flat into 1 / tau, in rms sds of measurement: at 1 the false alarms of 8
# groups reach 5.5 % where tau is twice these sds, at 2 they stay below 5 %.
TURN = 2.0


@dataclass(frozen=True, kw_only=True)
class Heterogeneity:
    """The mean of several groups with its sd, the sd between them, and Cochran's Q with its p-value."""

    mean: float
    sd_mean: float
    between_sd: float
    q: float
    groups: int


@dataclass(frozen=True, kw_only=True)
class Newcomer:
    """Difference of the newest group from the former ones, and its p-value."""

    value: float
    expected: float  # the mean of the former groups
    difference: float
    low: float  # of the 95 % interval within which a group like the former ones is expected
    high: float
    p_value: float
    former: Heterogeneity


def between(values: ArrayLike, sds: ArrayLike) -> Heterogeneity:
    """Mean of, and sd between, groups of values (k,) with the sds (k,) of their measurement.

    The moment estimator of R. DerSimonian and N. Laird, doi:10.1016/0197-2456(86)90046-2, cut off at 0.
    Raises ValueError for fewer than two groups and for a sd that is not positive.

    >>> groups = between([1.0, 2.0, 3.0], [0.1, 0.1, 0.1])
    >>> round(groups.mean, 6), round(groups.between_sd, 3)
    (2.0, 0.995)
    """
    y, s = _checked(values, sds, least=2)
    w = 1 / s**2
    q = float(w @ (y - w @ y / w.sum()) ** 2)
    scale = float(w.sum() - (w @ w) / w.sum())
    tau2 = max(0.0, (q - (len(y) - 1)) / scale)
    v = 1 / (s**2 + tau2)
    return Heterogeneity(
        mean=float(v @ y / v.sum()), sd_mean=float(1 / math.sqrt(v.sum())), between_sd=math.sqrt(tau2), q=q,
        groups=len(y),
    )  # fmt: skip


def newcomer(values: ArrayLike, sds: ArrayLike, *, value: float, sd: float) -> Newcomer:
    """Test of a further group with its value and sd against former ones, values (k,) with sds (k,).

    Given tau, the difference to the mean of the former groups is normal with variance tau^2 + sd^2
    + var(mean). tau is integrated out (prediction: J. P. T. Higgins et al.,
    doi:10.1111/j.1467-985X.2008.00552.x) under a prior that is flat for tau below the sds of measurement and
    1 / tau above (the choice matters with few groups: A. Gelman, doi:10.1214/06-BA117A). Where the
    measurement is exact, this is the t test with k - 1 degrees of freedom. It holds its rate of false alarms
    whatever tau is, and is careful for small ones (`benchmarks/batches/drift.py`). Raises ValueError for
    fewer than 3 former groups.

    >>> newcomer([1.0, 1.1, 0.9, 1.0], [0.05] * 4, value=2.0, sd=0.05).p_value < 0.01
    True
    """
    y, s = _checked(values, sds, least=LEAST)
    if not sd > 0:
        raise ValueError(f"sd of the newest group: {sd:g}; wanted more than 0")
    with np.errstate(under="ignore"):  # a share of 1e-320 is none
        weight, mean, spread = _posterior(y, s)
        spread = np.hypot(spread, sd)
        p = float(weight @ (2 * scipy.special.ndtr(-np.abs(value - mean) / spread)))
        low, high = (_quantile(weight, mean, spread, level) for level in (0.025, 0.975))
    former = between(y, s)
    return Newcomer(
        value=value, expected=float(weight @ mean), difference=value - float(weight @ mean), low=low,
        high=high, p_value=min(p, 1.0), former=former,
    )  # fmt: skip


def _posterior(y: Array, s: Array) -> tuple[Array, Array, Array]:
    """Weights (m,) of values of tau, and at each the mean of the groups and the sd of a further one about
    it."""
    unit = float(np.sqrt(np.mean(s**2)))
    widest = max(float(np.ptp(y)), unit)
    # evenly in log(1 + tau / unit): fine where tau is small, wide enough where it is large
    step = np.linspace(0.0, math.log1p(1e3 * widest / unit), KNOTS)
    tau = unit * np.expm1(step)
    total = s**2 + tau[:, None] ** 2  # (m, k)
    w = 1 / total
    sums = w.sum(axis=1)
    mean = w @ y / sums
    misfit = (w * (y - mean[:, None]) ** 2).sum(axis=1)
    prior = 1 / (tau + TURN * unit)
    log = -0.5 * (np.log(total).sum(axis=1) + np.log(sums) + misfit)
    density = prior * np.exp(np.maximum(log - log.max(), -700)) * (tau + unit)  # d tau = (tau + unit) d step
    density[[0, -1]] /= 2
    return density / density.sum(), mean, np.sqrt(tau**2 + 1 / sums)


def _quantile(weight: Array, mean: Array, spread: Array, level: float) -> float:
    """The value below which a mixture of normal distributions has the share `level`, by bisection."""
    far = 60 * float(spread.max())
    low, high = float(mean.min()) - far, float(mean.max()) + far
    for _ in range(100):
        middle = (low + high) / 2
        below = weight @ scipy.special.ndtr((middle - mean) / spread) < level
        low, high = (middle, high) if below else (low, middle)
    return (low + high) / 2


def _checked(values: ArrayLike, sds: ArrayLike, *, least: int) -> tuple[Array, Array]:
    y, s = np.asarray(values, float), np.asarray(sds, float)
    if y.ndim != 1 or y.shape != s.shape or len(y) < least:
        raise ValueError(
            f"{y.size} values and {s.size} sds of groups; wanted as many of both, {least} or more"
        )
    if not (np.all(np.isfinite(y)) and np.all(np.isfinite(s)) and np.all(s > 0)):
        raise ValueError(f"values {y} with sds {s}: wanted finite values and sds above 0")
    return y, s
