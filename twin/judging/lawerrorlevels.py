"""A fitted model -> how it stands at each size of its laws' errors: its deviance, fit and lack of fit there.

No further solve: under the wider errors the fit takes one step along the derivatives that it has.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

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


def levels(judged: Judged, targets: Targets) -> tuple[Level, ...]:
    """The levels of a judged model that was fitted without law errors, one for each of LEVELS; the first
    alone where it has no law that may err. At each the fit goes on along the derivatives that it has, at the
    first too, so that it need not be at its end."""
    laws, room = law_errors(judged.model, judged.theta, targets), _room(judged)
    w, smooth = judged.whitener, smooth_functions(targets, judged.whitener)
    modes = np.concatenate([np.zeros((0, *targets.value.shape)), *(one.modes for one in laws)])
    columns = w.whiten(modes).T
    sizes, turn = np.linalg.eigh(columns.T @ columns)
    keep = sizes > 1e-10 * max(float(sizes.max(initial=0.0)), 1e-300)
    axes, sizes = columns @ turn[:, keep] / np.sqrt(sizes[keep]), sizes[keep]

    shown = not np.isnan(judged.comparison.p_value)  # else there are no more data than parameters

    def at(law: float) -> Level:
        shrink = 1 - 1 / np.sqrt(1 + law**2 * sizes)

        def calmed(x: Array) -> Array:
            return np.asarray(x - (axes * shrink) @ (axes.T @ x), float)

        z, fitted = calmed(judged.z), calmed(judged.fitted)
        step = _bounded(fitted, z, room)
        left = z - fitted @ step
        some = calmed(smooth) if len(z) > 2 * smooth.shape[1] else None
        return Level(
            law=law,
            deviance=float(left @ left + w.log_det + np.log1p(law**2 * sizes).sum()),
            fitted=fitted,
            step=step,
            p_value=lack_of_fit(targets, w, left, fitted, some) if shown else float("nan"),
        )

    return tuple(map(at, LEVELS if laws else LEVELS[:1]))


def asked_for(found: Sequence[Level], evidence: Sequence[float]) -> Level:
    """The level that data with 2 ln B (l,) at each ask for: of those at which the model fits the likeliest,
    of all where it fits at none."""
    fits = [k for k, one in enumerate(found) if one.p_value > ADEQUATE] or range(len(found))
    return found[max(fits, key=lambda k: evidence[k] / 2 + np.log(WEIGHTS[k]))]


def with_laws(judged: Judged, targets: Targets, *, refit: bool = True) -> Judged:
    """A judged model under the law errors that the data ask for, fitted anew under them, or as it was
    fitted: intervals and the test of its fit then know that no law is exact."""
    if not erring(judged.model):
        return judged
    found = levels(judged, targets)
    law = asked_for(found, [-one.deviance for one in found]).law
    if not law:
        return judged
    if not refit:
        return judge_fit(judged.model, targets, judged.fit, law=law)
    return judge(judged.model, targets, starts=judged.theta, seed=judged.fit.seed, law=law)


def _room(judged: Judged) -> tuple[Array, Array]:
    """How far each free parameter may go down and up (f,)."""
    free = [p for p in judged.model.parameters if p.name not in judged.at_bound]
    now = np.array([judged.values[p.name] for p in free])
    return np.array([p.low for p in free]) - now, np.array([p.high for p in free]) - now


def _bounded(fitted: Array, z: Array, room: tuple[Array, Array]) -> Array:
    """The step (f,) within its room that leaves least of z (n,)."""
    if not fitted.shape[1]:
        return np.zeros(0)
    lengths = np.linalg.norm(fitted, axis=0)
    lengths[lengths == 0] = 1.0
    step = np.linalg.lstsq(fitted / lengths, z, rcond=1e-9)[0] / lengths
    low, high = room
    if np.all((step >= low) & (step <= high)):
        return np.asarray(step, float)
    q, r = np.linalg.qr(fitted / lengths)
    ends = np.minimum(low * lengths, -1e-12), np.maximum(high * lengths, 1e-12)
    return np.asarray(lsq_linear(r, q.T @ z, bounds=ends, method="bvls").x / lengths, float)
