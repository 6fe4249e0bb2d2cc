"""Tests and criteria of whitened residuals and fits, and a sentence on two parameters that act alike.

The tests know that the noise itself was measured: variances estimated from few static frames make a chi2
too large and its tail too long, and the plain chi2 test then calls a right model wrong.
"""

import math

import numpy as np
import scipy
from numpy.typing import ArrayLike

from calibrate.parameters import Array, Fit


def chi2_test(chi2: float, counts: ArrayLike, static_frames_effective: ArrayLike) -> float:
    """Probability of a chi2 at least as large if the model is right and the noise as estimated.

    counts (c,): values of each component (a marker and axis with a variance of its own), less its share of
    the fitted parameters. static_frames_effective (c,): degrees of freedom nu_c of each variance estimate,
    inf where it is known. Of n frames with lag-1 correlation rho: n - 2 where sd and rho of the component
    both come from them and both whiten (the errors of the two cancel in part: measured, share of p < 0.01
    in tests), n (1 - rho^2) / (1 + rho^2) where rho is known better than that.
    Component c then sums to n_c F(n_c, nu_c); the total's mean and variance are matched by a scaled F with
    sum n_c and as many denominator degrees as it takes (after F. E. Satterthwaite, doi:10.2307/3002019).
    Raises ValueError where nu_c <= 4: no finite variance.

    >>> round(chi2_test(120.0, [100], [float("inf")]), 3), round(chi2_test(120.0, [100], [50.0]), 3)
    (0.084, 0.24)
    """
    n, (mean, square) = np.asarray(counts, float), _scales(static_frames_effective)
    variance = np.sum(2 * n * square + n**2 * (square - mean**2))
    return _tail(chi2, float(n @ mean), float(variance), float(n.sum()))


def omnibus(
    z: ArrayLike,
    basis: ArrayLike,
    *,
    component: ArrayLike,
    static_frames_effective: ArrayLike,
    fitted: ArrayLike | None = None,
) -> float:
    """Probability that noise alone gives the whitened residual so large a share in q smooth functions.

    z (n,): whitened residual. basis (n, q): the functions at the n values, whitened as z is. component
    (n,): index of the component whose variance whitened each value. static_frames_effective (c,): as in
    `chi2_test`. fitted (n, d): whitened Jacobian of what was fitted, projected out of the functions first.
    More sensitive than the whole chi2 to misfit that is smooth, which missing physics is. Raises ValueError
    where nothing of the functions is left to test.
    """
    return omnibus_test(
        z, basis, component=component, static_frames_effective=static_frames_effective, fitted=fitted
    )[2]


def omnibus_test(
    z: ArrayLike,
    basis: ArrayLike,
    *,
    component: ArrayLike,
    static_frames_effective: ArrayLike,
    fitted: ArrayLike | None = None,
) -> tuple[float, int, float]:
    """The chi2 in smooth functions, their number where they are independent, and the probability of
    `omnibus`, with its arguments."""
    q = _apart(np.asarray(basis, float), fitted)
    if q.shape[1] == 0:
        raise ValueError(
            "omnibus: the fitted parameters explain every function of the basis, so nothing is left to "
            "test; give others"
        )
    mean, square = _scales(static_frames_effective)
    parts = [q[np.asarray(component) == c] for c in range(len(mean))]
    grams = np.array([part.T @ part for part in parts])
    h = np.trace(grams, axis1=1, axis2=2)  # share of each component in the projector
    flat = grams.reshape(len(grams), -1)
    mixed = flat @ flat.T
    pairs = np.outer(mean, mean)
    np.fill_diagonal(pairs, square)
    variance = 2 * np.sum(pairs * mixed) + h**2 @ (square - mean**2)
    total = float(np.sum((q.T @ np.asarray(z, float)) ** 2))
    return total, q.shape[1], _tail(total, float(h @ mean), float(variance), float(q.shape[1]))


def excess(z: ArrayLike, basis: ArrayLike, *, fitted: ArrayLike | None = None) -> float:
    """Squared projection of the whitened residual on smooth functions, minus its expectation under noise.

    Noise gives 1 per function. Arguments as in `omnibus`. Where the noise is overstated, chi2 may lie below
    its degrees of freedom despite a misfit; this measure is then lower by at most the number of functions.
    """
    q = _apart(np.asarray(basis, float), fitted)
    return float(np.sum((q.T @ np.asarray(z, float)) ** 2)) - q.shape[1]


def _apart(basis: Array, fitted: ArrayLike | None) -> Array:
    """Orthonormal functions (n, q) of a basis with what was fitted projected out."""
    functions = basis
    if fitted is not None:
        done = _orthonormal(np.asarray(fitted, float))
        functions = functions - done @ (done.T @ functions)
    return _orthonormal(functions, size=np.linalg.norm(basis, axis=0))


def _scales(frames: ArrayLike) -> tuple[Array, Array]:
    """Mean and mean square of true over estimated variance, nu / chi2_nu, for each component."""
    nu = np.atleast_1d(np.asarray(frames, float))
    if not np.all(nu > 4):
        raise ValueError(
            f"noise of {np.min(nu):.3g} effective static frames: wanted more than 4 to test against; "
            "film several hundred"
        )
    inverse = 1 / nu
    mean = 1 / (1 - 2 * inverse)
    return mean, mean / (1 - 4 * inverse)


def _tail(total: float, mean: float, variance: float, n: float) -> float:
    """Upper tail at `total` of a F(n, nu) with a and nu from the mean and the variance."""
    spread = variance / mean**2 * n - 2  # 0 for a chi2 with n degrees of freedom
    if spread <= 1e-9:
        return float(scipy.special.chdtrc(n, n * total / mean))
    nu = (4 * (spread + 2) + 2 * n - 4) / spread
    return float(scipy.special.fdtrc(n, nu, total / mean * nu / (nu - 2)))


def _orthonormal(columns: Array, size: Array | None = None) -> Array:
    """Orthonormal basis (n, rank) of the columns, each taken relative to its size (its own norm)."""
    norms = np.linalg.norm(columns, axis=0) if size is None else size
    scaled = columns / np.where(norms > 0, norms, 1.0)
    sizes, axes = np.linalg.eigh(scaled.T @ scaled)  # small: far cheaper than the SVD of n rows
    rank = sizes > 1e-9
    return scaled @ (axes[:, rank] / np.sqrt(sizes[rank]))


def bic(chi2: float, k: int, n: int) -> float:
    """Bayesian information criterion of k parameters fitted to n values (doi:10.1214/aos/1176344136).

    >>> round(bic(100.0, 2, 1000), 2)
    113.82
    """
    return chi2 + k * math.log(n)


def sidak(p: float, m: int) -> float:
    """Probability that the smallest of m independent p-values is at most p (doi:10.2307/2283989).

    >>> round(sidak(0.01, 5), 3)
    0.049
    """
    return 1.0 if p >= 1 else -math.expm1(m * math.log1p(-p))


def holm(p: ArrayLike) -> Array:
    """p-values (m,) adjusted for their number (S. Holm 1979), to be compared with the level of the test.

    >>> holm([0.01, 0.04, 0.03])
    array([0.03, 0.06, 0.06])
    """
    values = np.asarray(p, float)
    order = np.argsort(values)
    adjusted = np.empty_like(values)
    adjusted[order] = np.maximum.accumulate(values[order] * np.arange(len(values), 0, -1))
    return np.minimum(adjusted, 1.0)


def identifiability(fit: Fit, names: tuple[str, str], *, fits: bool = True) -> str:
    """Sentence on two parameters that act alike (C10, C01): their sum, their share, and their separability.

    fits: whether the model agrees with the data; no interval is given where it does not. The sds of sum and
    share follow from the covariance to first order. The two "cannot be separated" where their correlation
    exceeds 0.9 in size, where the share's sd exceeds 0.25, or where the data leave them undetermined. Raises
    ValueError for a name that is not a parameter of the fit.
    """
    fitted = [p.name for p in fit.parameters]
    if absent := [name for name in names if name not in fitted]:
        raise ValueError(f"identifiability: no parameter {absent} in the fit, which has {fitted}")
    i, j = (fitted.index(name) for name in names)
    a, b, unit = names[0], names[1], f" {fit.parameters[i].unit}".rstrip()
    total, share = fit.theta[i] + fit.theta[j], fit.theta[j] / (fit.theta[i] + fit.theta[j])
    verdict = f"{a} and {b} cannot be separated by these targets"
    bare = f"{a} + {b} = {total:.4g}{unit}, share {b}/({a} + {b}) = {share:.3g}"
    if stuck := [name for name in names if name in fit.at_bound]:
        return f"{bare}. {verdict}: the fit ends at a bound of {' and '.join(stuck)}."
    block = fit.covariance[np.ix_([i, j], [i, j])]
    if not np.all(np.isfinite(block)):
        return f"{bare}. {verdict}: the data leave them undetermined."
    slope = np.array([-fit.theta[j], fit.theta[i]]) / total**2
    sd_total, sd_share = math.sqrt(max(block.sum(), 0.0)), math.sqrt(max(slope @ block @ slope, 0.0))
    correlation = fit.correlation[i, j]
    if sd_share > 0.25:
        # with the share held: the inverse of the information on the sum alone
        turn = np.stack([np.ones(2), slope])
        sd_held = 1 / math.sqrt(np.linalg.inv(turn @ block @ turn.T)[0, 0])
        held = f"{a} + {b} = {total:.4g}{unit}{_span(total, sd_held, fits)} at a given share"
        reason = f"only their sum is known (correlation {correlation:.3f})"
        return f"{held}, which may be anything. {verdict}: {reason}."
    values = (
        f"{a} + {b} = {total:.4g}{unit}{_span(total, sd_total, fits)}, "
        f"share {b}/({a} + {b}) = {share:.3g}{_span(share, sd_share, fits, high=1.0)}, "
        f"correlation {correlation:.3f}"
    )
    if abs(correlation) > 0.9:
        return f"{values}. {verdict} one by one: their errors trade off, so quote the sum and the share."
    if not fits:  # what is missing moves the share, and nothing here tells how far
        return f"{values}. These targets can tell {a} and {b} apart, but only with a model that fits."
    return f"{values}. These targets tell {a} and {b} apart."


def _span(value: float, sd: float, fits: bool, *, high: float = math.inf) -> str:
    """The 95 % interval of a positive value in brackets, cut at 0 and `high`; nothing where there is none."""
    ends = max(value - 1.96 * sd, 0.0), min(value + 1.96 * sd, high)
    width = ends[1] - ends[0]
    if not fits or width <= 0:
        return ""
    digits = max(0, 1 - math.floor(math.log10(width)))
    return f" (95 % interval {ends[0]:.{digits}f} to {ends[1]:.{digits}f})"
