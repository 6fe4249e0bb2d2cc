"""Bounded nonlinear least squares of a whitened residual with a Jacobian.

Levenberg-Marquardt (D. Marquardt, doi:10.1137/0111030) with bounds kept exactly in every step (a small
bounded linear problem). The Jacobian is asked for at the start and after every step that is taken: where
derivatives come with a solve it costs little, and the covariance comes from that of the optimum.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from calibrate.parameters import Array, Fit, Parameter, bounds

Residual = Callable[[Array], Array | None]
Jacobian = Callable[[Array], Array]

GAIN = 10.0  # of tolerance^2, by which the best step would lower chi2 at most where a fit has converged
FLOOR = 1e-3  # of chi2, that derivatives may promise in vain: where nuisance modes take up most of a
# parameter, a solver's error of 3e-5 is several per cent of what is left of its column
GROWTH = 30.0  # of the damping after a step that fails: less hardly shortens it where columns trade off
CONDITION = 1e12  # of the scaled J'J: a direction beyond it is not determined
DAMPING = 1e-3, 1e-12, 1e10  # first, least, largest; relative to unit columns
ACCEPT = 0.05  # share of the predicted fall that makes a step good enough to take
AT_BOUND = 1e-9  # of the range
CONVERGED = "converged"


class _Model:
    """Residual, counted, and Jacobian; a residual that is absent or not finite is None."""

    def __init__(self, residual: Residual, jacobian: Jacobian) -> None:
        self._residual, self._jacobian = residual, jacobian
        self.evaluations = 0

    def residual(self, theta: Array) -> Array | None:
        self.evaluations += 1
        r = self._residual(theta.copy())
        return None if r is None or not np.all(np.isfinite(r)) else np.asarray(r, float)

    def jacobian(self, theta: Array) -> Array:
        return np.asarray(self._jacobian(theta.copy()), float)


@dataclass(frozen=True, eq=False)
class _End:
    """End of a descent: theta (d,), whitened residual (n,) or None, Jacobian (n, d) at theta."""

    theta: Array
    residual: Array | None
    jacobian: Array
    converged: bool
    reason: str

    @property
    def chi2(self) -> float:
        return math.inf if self.residual is None else float(self.residual @ self.residual)


@dataclass(frozen=True, eq=False)
class _Step:
    """A move (d,), the fall of chi2 it should bring, and its length in sd."""

    move: Array
    gain: float
    length: float


def least_squares(
    residual: Residual,
    jacobian: Jacobian,
    parameters: Sequence[Parameter],
    *,
    start: ArrayLike,
    seed: int = 0,
    max_evaluations: int = 40,
    tolerance: float = 0.01,
    information: Jacobian | None = None,
) -> Fit:
    """Fit with the lowest chi2 = r'r within the bounds, the best of all starts.

    residual: theta (d,) -> r (n,), whitened; None where the model cannot be solved: the step is then
    shortened. jacobian: theta (d,) -> dr/dtheta (n, d). start (d,) or (m, d): one descent each, of at most
    max_evaluations residuals. seed: the one that drew the starts, kept in the Fit. It has converged where the
    best step is shorter than `tolerance` sd in every direction and would lower chi2 by less than 10
    tolerance^2, or by less than 1e-3 of it and, shortened too, does not. information: theta (d,) -> rows (n,
    d) whose products are the information that the covariance comes from, by default those of the Jacobian.
    Raises ValueError for a start outside the bounds; a fit that does not converge says so in its reason.

    A line through three points whose sd is 0.1:

    >>> import numpy as np
    >>> x, y = np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.1, 4.9])
    >>> parameters = [Parameter("slope", -10.0, 10.0), Parameter("offset", -10.0, 10.0)]
    >>> fit = least_squares(
    ...     lambda t: (t[0] * x + t[1] - y) / 0.1, lambda t: np.stack([x, np.ones(3)], axis=1) / 0.1,
    ...     parameters, start=[0.0, 0.0])
    >>> fit.theta.round(3), fit.sd.round(3)
    (array([1.95, 1.05]), array([0.071, 0.091]))
    >>> fit.converged, fit.degrees_of_freedom
    (True, 1)
    >>> fit.correlation[0, 1].round(3)
    np.float64(-0.775)
    """
    parameters = tuple(parameters)
    low, high = bounds(parameters)
    starts = inside(np.atleast_2d(np.asarray(start, float)), parameters)
    model = _Model(residual, jacobian)
    with np.errstate(under="ignore"):
        ends = [_descend(model, theta, low, high, max_evaluations, tolerance) for theta in starts]
        best = min(ends, key=lambda end: end.chi2)
        solved = best.residual is not None
        rows = np.asarray(information(best.theta), float) if information and solved else best.jacobian
        return _fit(best, parameters, seed, model, rows)


def inside(starts: Array, parameters: tuple[Parameter, ...]) -> Array:
    """Starts (m, d), checked. Raises ValueError for one outside the bounds or of another length."""
    if starts.ndim != 2 or starts.shape[1] != len(parameters):
        raise ValueError(
            f"start: shape {starts.shape}, wanted {len(parameters)} values in each row, one a parameter"
        )
    for theta in starts:
        for p, x in zip(parameters, theta):
            if not p.low <= x <= p.high:
                raise ValueError(
                    f"start: {p.name} = {x} {p.unit} is outside its bounds {p.low} .. {p.high}; move it"
                )
    return starts


def _descend(
    model: _Model, theta: Array, low: Array, high: Array, budget: int, tolerance: float
) -> _End:
    last = model.evaluations + budget
    r = model.residual(theta)
    if r is None:
        unknown = np.full((0, len(theta)), np.nan)
        return _End(theta, None, unknown, False, "the model cannot be solved at the start")
    return _Descent(model, theta, r, model.jacobian(theta), low, high, last, tolerance).run()


@dataclass(eq=False)
class _Descent:
    """Levenberg-Marquardt from one start: its theta, residual, Jacobian and damping."""

    model: _Model
    theta: Array
    r: Array
    jac: Array
    low: Array
    high: Array
    last: int
    tolerance: float
    damping: float = DAMPING[0]
    growth: float = GROWTH
    rejected: int = 0

    def run(self) -> _End:
        while True:
            ended = self._ended()
            if ended is not None:
                return ended
            self._advance()

    def _step(self, damping: float) -> _Step:
        return bounded_step(self.jac, self.r, self.low - self.theta, self.high - self.theta, damping)

    def _ended(self) -> _End | None:
        """End of the descent once it has converged or failed, else None."""
        if not np.all(np.isfinite(self.jac)):
            return self._end(False, "the derivatives have values that are not finite")
        best = self._step(DAMPING[1])
        # Rejected steps this small are the numerical floor of the misfit, which is high where chi2 is large.
        least = GAIN * self.tolerance**2
        vain = FLOOR * float(self.r @ self.r)
        floor = (self.rejected and best.gain < least) or (self.rejected > 1 and best.gain < vain)
        if floor or (best.gain < least and best.length < self.tolerance):
            return self._end(True, CONVERGED)
        if self.damping > DAMPING[2]:
            return self._end(False, "no step lowers chi2, or the model cannot be solved around this point")
        if self.model.evaluations >= self.last:
            return self._end(False, "the evaluations allowed are used up; start nearer, or allow more")
        return None

    def _end(self, converged: bool, reason: str) -> _End:
        return _End(self.theta, self.r, self.jac, converged, reason)

    def _advance(self) -> None:
        """Try one step; accept it or shorten the next."""
        step = self._step(self.damping)
        trial = np.clip(self.theta + step.move, self.low, self.high)
        new = self.model.residual(trial)
        quality = 0.0 if new is None or step.gain <= 0 else float(self.r @ self.r - new @ new) / step.gain
        if new is not None and quality > ACCEPT:
            self.theta, self.r, self.rejected = trial, new, 0
            self.jac = self.model.jacobian(trial)
            self._damp(max(1 - (2 * quality - 1) ** 3, 0.1))
            return
        self._damp(self.growth)
        self.growth *= 2
        self.rejected += 1

    def _damp(self, factor: float) -> None:
        """H. B. Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05."""
        self.growth = self.growth if factor > 1 else GROWTH
        self.damping = max(self.damping * factor, DAMPING[1])


def _lengths(jac: Array, widths: Array) -> Array:
    """Column lengths (d,), so that unit columns follow; a column of zeros is scaled by the range."""
    lengths = np.sqrt(np.sum(jac**2, axis=0))
    return np.where(lengths > 0, lengths, 1 / widths)


def bounded_step(jac: Array, r: Array, low: Array, high: Array, damping: float) -> _Step:
    """The move that minimises |r + J move|^2 + damping |scaled move|^2 with low <= move <= high."""
    lengths = _lengths(jac, high - low)
    d = len(lengths)
    small: Array = np.linalg.qr(np.column_stack([jac / lengths, r])).R  # same norms in d + 1 rows
    columns, c = small[:, :d], small[:, d]
    a = np.vstack([columns, math.sqrt(damping) * np.eye(d)])
    b = -np.concatenate([c, np.zeros(d)])
    x = scipy.optimize.lsq_linear(a, b, bounds=(low * lengths, high * lengths), method="bvls", max_iter=50).x
    change = columns @ x
    return _Step(x / lengths, float(c @ c - (c + change) @ (c + change)), float(np.linalg.norm(change)))


def _fit(
    end: _End, parameters: tuple[Parameter, ...], seed: int, model: _Model, rows: Array
) -> Fit:
    low, high = bounds(parameters)
    reach = AT_BOUND * (high - low)
    free = (end.theta > low + reach) & (end.theta < high - reach)
    covariance, rank = _covariance(rows, free, high - low)
    covariance = covariance + _for_bounds(end, free, low, high)
    lost = [p.name for p, v in zip(parameters, np.diag(covariance)) if np.isinf(v)]
    reason = end.reason
    if lost:
        number, names = int(free.sum()) - rank, ", ".join(lost)
        reason += f"; the data leave {number} combination{'s' * (number > 1)} of {names} undetermined"
    return Fit(
        parameters=parameters,
        theta=end.theta,
        covariance=covariance,
        chi2=end.chi2,
        degrees_of_freedom=len(rows) - rank,
        seed=seed,
        evaluations=model.evaluations,
        converged=end.converged,
        reason=reason,
        at_bound=tuple(p.name for p, varies in zip(parameters, free) if not varies),
    )


def _covariance(jac: Array, free: NDArray[np.bool_], widths: Array) -> tuple[Array, int]:
    """inv(J'J) over the free columns, 0 elsewhere, and the rank: undetermined parameters have inf and NaN."""
    covariance = np.zeros((len(free), len(free)))
    columns = np.flatnonzero(free)
    if len(jac) == 0 or not np.all(np.isfinite(jac)):
        covariance[np.ix_(columns, columns)] = np.nan
        covariance[columns, columns] = np.inf
        return covariance, 0
    lengths = _lengths(jac, widths)[columns]
    _, sizes, rows = np.linalg.svd(np.linalg.qr(jac[:, columns] / lengths).R)
    determined = np.zeros(len(columns), bool)
    determined[: len(sizes)] = (sizes > 0) & (sizes**2 * CONDITION > np.max(sizes, initial=0.0) ** 2)
    factor = rows[determined].T / sizes[determined[: len(sizes)]] / lengths[:, None]
    block = factor @ factor.T
    lost = np.linalg.norm(rows[~determined], axis=0) > 1e-6  # parameters in undetermined directions
    block[lost] = block[:, lost] = np.nan
    block[lost, lost] = np.inf
    covariance[np.ix_(columns, columns)] = block
    return covariance, int(determined.sum())


def _for_bounds(end: _End, free: NDArray[np.bool_], low: Array, high: Array) -> Array:
    """Covariance (d, d) of the free parameters that parameters at a bound add.

    The data allow such a parameter to lie inside its bounds, and the free ones follow it. Its posterior is a
    normal distribution truncated at the bound, a sds from its mode, with E[(x - bound)^2] = sd^2 (1 + a^2 -
    a h(a)) and the hazard h(a) = phi(a) / (1 - Phi(a)); at most a third of its squared range.
    """
    out = np.zeros((len(free), len(free)))
    inside = np.flatnonzero(free)
    if end.residual is None or not len(inside) or not np.all(np.isfinite(end.jacobian)):
        return out
    fitted = end.jacobian[:, inside]
    for k in np.flatnonzero(~free):
        column = end.jacobian[:, k]
        follow = np.linalg.lstsq(fitted, column, rcond=1e-6)[0]
        apart = column - fitted @ follow
        size, most = float(np.linalg.norm(apart)), float(high[k] - low[k]) ** 2 / 3
        if size <= 1e-6 * np.linalg.norm(column):
            square = most
        else:
            a = abs(float(apart @ end.residual)) / size
            square = min(most, _spread(a) / size**2)
        out[np.ix_(inside, inside)] += square * np.outer(follow, follow)
    return out


def _spread(a: float) -> float:
    """E[(x - a)^2] of a standard normal x above a >= 0."""
    hazard = math.sqrt(2 / math.pi) / float(scipy.special.erfcx(a / math.sqrt(2)))
    return min(max(1 + a**2 - a * hazard, 0.0), 2 / max(a, 1e-9) ** 2)  # which it nears: far out all cancels
