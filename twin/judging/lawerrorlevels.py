"""A fitted model -> its deviance, its fit and its lack of fit at each size of its laws' errors.

No further solve: under the wider errors the fit takes one step along the derivatives that it has.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from twin.judging.comparison import ADEQUATE, lack_of_fit, smooth_functions
from twin.judging.judged import Judged, judge, judge_fit
from twin.judging.lawerrors import LEVELS, WEIGHTS, erring, law_errors
from twin.targets import Array, Targets


@dataclass(frozen=True, kw_only=True)
class Level:
    """A model at one size of its laws' errors.

    law: their share of what the effects add, 1 sd. deviance: chi2 + ln det of the data's covariance. fitted
    (n, f): derivatives by the free parameters, whitened; step (f,): what the fit moves by; p_value: of the
    lack of fit.
    """

    law: float
    deviance: float
    fitted: Array
    step: Array
    p_value: float


def levels(judged: Judged, targets: Targets, *, ahead: bool = True) -> tuple[Level, ...]:
    """The levels of a judged model that was fitted without law errors, one for each of LEVELS. Where no law
    may err there is the first alone. At every level, the first included, one linearised step improves the
    fit. So the fit need not have converged. Without `ahead` no step is taken: what was solved counts.

    Whitened modes M (n, k) of the law errors make the whitened residual's covariance I + eps^2 M M'. With
    the eigenvectors U and the eigenvalues v of M M', those above 1e-10 of the largest, it is whitened by its
    symmetric inverse root (Kessy, Lewin & Strimmer 2018, doi 10.1080/00031305.2016.1277159), and the matrix
    determinant lemma gives what it adds to the deviance:

        W = I - U diag(1 - 1 / sqrt(1 + eps^2 v)) U',    ln det = sum ln(1 + eps^2 v)
    """
    laws, bounds = law_errors(judged.model, judged.theta, targets), _step_bounds(judged)
    w, smooth = judged.whitener, smooth_functions(targets, judged.whitener)
    modes = np.concatenate([np.zeros((0, *targets.value.shape)), *(law.modes for law in laws)])
    M = w.whiten(modes).T
    eigenvalues, eigenvectors = np.linalg.eigh(M.T @ M)
    nonzero = eigenvalues > 1e-10 * max(float(eigenvalues.max(initial=0.0)), 1e-300)
    v = eigenvalues[nonzero]
    U = M @ eigenvectors[:, nonzero] / np.sqrt(v)

    def level(eps: float) -> Level:
        reduction = 1 - 1 / np.sqrt(1 + eps**2 * v)

        def whitened(x: Array) -> Array:
            return np.asarray(x - (U * reduction) @ (U.T @ x), float)

        z, fitted = whitened(judged.z), whitened(judged.fitted)
        step = _bounded_step(fitted, z, bounds) if ahead else np.zeros(fitted.shape[1])
        residual = z - fitted @ step
        functions = whitened(smooth) if len(z) > 2 * smooth.shape[1] else None
        return Level(
            law=eps,
            deviance=float(residual @ residual + w.log_det + np.log1p(eps**2 * v).sum()),
            fitted=fitted,
            step=step,
            p_value=lack_of_fit(targets, w, residual, fitted, functions) if judged.testable else float("nan"),
        )

    return tuple(map(level, LEVELS if laws else LEVELS[:1]))


def asked_for(at_levels: Sequence[Level], evidence: Sequence[float]) -> Level:
    """The most probable level, given 2 ln B (l,) at each. Levels at which the model is adequate come first.

    >>> none = np.zeros(0)
    >>> rows = [Level(law=eps, deviance=0.0, fitted=none, step=none, p_value=p)
    ...         for eps, p in zip(LEVELS, (1e-9, 0.2, 0.6, 0.7))]
    >>> asked_for(rows, [90.0, 20.0, 60.0, 55.0]).law
    0.1
    """
    adequate = [k for k, row in enumerate(at_levels) if row.p_value > ADEQUATE] or range(len(at_levels))
    return at_levels[max(adequate, key=lambda k: evidence[k] / 2 + np.log(WEIGHTS[k]))]


def with_laws(judged: Judged, targets: Targets, *, refit: bool = True) -> Judged:
    """A judged model under the law errors that the data ask for, fitted again under them if `refit`. The
    test of its fit then knows them, and its intervals that no law is exact."""
    if not erring(judged.model):
        return judged
    at_levels = levels(judged, targets)
    law = asked_for(at_levels, [-row.deviance for row in at_levels]).law
    if law and refit:
        judged = judge(judged.model, targets, starts=judged.theta, seed=judged.fit.seed, law=law)
    elif law:
        judged = judge_fit(judged.model, targets, judged.fit, law=law)
    return inexact(judged, targets)


def inexact(judged: Judged, targets: Targets) -> Judged:
    """A judged model whose intervals know that no law is exact, however well it fits: the covariance of its
    fit is taken over all levels above 0 of its laws' errors, each by its probability.

    With the weights w, the covariance C and the step d to the optimum of each level (Laplace's approximation
    of the marginal likelihood), it is sum w (C + d d' + (eps diag a)^2): a law that errs by eps in shape
    defines its amplitudes a no better, which no data tell. Where priors, tests of the silicone, heavy tails
    or bounds say more than the derivatives of the film, it stays as it is.
    """
    if not erring(judged.model) or not targets.bare or judged.at_bound:
        return judged
    exact = judge_fit(judged.model, targets, judged.fit) if judged.errors.law else judged
    rows = levels(exact, targets)[1:]
    C = np.array([np.linalg.pinv(row.fitted.T @ row.fitted, rcond=1e-12, hermitian=True) for row in rows])
    fall = np.linalg.slogdet(C)[1] - np.array([row.deviance for row in rows])
    if not np.isfinite(fall).all():  # what these data leave open has no width to average
        return judged
    w = np.array(WEIGHTS[1:]) * np.exp(np.maximum(fall - fall.max(), -700.0) / 2)
    d, eps = np.array([row.step for row in rows]), np.array([row.law for row in rows])
    amplitudes = {p.name: p.null or 0.0 for e in erring(judged.model) for p in e.amplitudes}
    a = np.array([x - amplitudes.get(name, x) for name, x in judged.values.items()])
    own = np.diag(a**2) * eps[:, None, None] ** 2
    covariance = np.einsum("l,lij->ij", w / w.sum(), C + d[:, :, None] * d[:, None, :] + own)
    return replace(judged, fit=replace(judged.fit, covariance=covariance))


def _step_bounds(judged: Judged) -> tuple[Array, Array]:
    """The lowest and highest step (f,) of each free parameter."""
    free = [p for p in judged.model.parameters if p.name not in judged.at_bound]
    now = np.array([judged.values[p.name] for p in free])
    return np.array([p.low for p in free]) - now, np.array([p.high for p in free]) - now


def _bounded_step(fitted: Array, z: Array, bounds: tuple[Array, Array]) -> Array:
    """The step (f,) within bounds (low, high) that minimises |z - fitted step|^2."""
    if not fitted.shape[1]:
        return np.zeros(0)
    lengths = np.linalg.norm(fitted, axis=0)
    lengths[lengths == 0] = 1.0
    step = np.linalg.lstsq(fitted / lengths, z, rcond=1e-9)[0] / lengths
    low, high = bounds
    if np.all((step >= low) & (step <= high)):
        return np.asarray(step, float)
    q, r = np.linalg.qr(fitted / lengths)
    ends = np.minimum(low * lengths, -1e-12), np.maximum(high * lengths, 1e-12)
    return np.asarray(scipy.optimize.lsq_linear(r, q.T @ z, bounds=ends, method="bvls").x / lengths, float)
