"""One decaying vibration that several signals share: frequency and damping ratio with their covariance."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from twin.targets import Array

DRIFT = 2  # degree of the polynomial under the vibration: creep, a clamp that gives way
LEAST = 8  # frames beyond the number of constants


@dataclass(frozen=True)
class DampedSine:
    """A vibration in a stretch of a record.

    frequency in Hz, of the damped motion; damping: its ratio; covariance (2, 2) of the two; amplitude (c,) of
    each signal in the middle of the stretch, in the signals' unit; time: that middle, s; rms: of the rest.
    """

    time: float
    frequency: float
    damping: float
    covariance: Array
    amplitude: Array
    rms: float

    @property
    def sd(self) -> Array:
        """The sd (2,) of frequency in Hz and damping ratio."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def largest(self) -> float:
        """Amplitude of the point that moves most, of signals that are points' x, y, z in turn."""
        return float(np.linalg.norm(self.amplitude.reshape(-1, 3), axis=1).max())


def damped_sine(time: Array, signals: Array, *, near: float) -> DampedSine:
    """The decaying vibration that signals (t, c) at times (t,) s share, next to a frequency `near` in Hz.

    y = drift + exp(-zeta w t) (A cos w' t + B sin w' t), w' = w sqrt(1 - zeta^2): amplitude and phase of each
    signal, and its drift, are linear and eliminated (variable projection, Golub & Pereyra 1973, doi
    10.1137/0710036). The covariance is that of least squares; the residual's variance is taken as it is
    found, and multiplied by the time for which it keeps its sign (what a model lacks stays for several
    frames). ValueError for a stretch of too few frames.
    """
    t, middle = time - time.mean(), float(time.mean())
    half = float(np.ptp(time)) / 2
    if len(t) * signals.shape[1] < 2 + (DRIFT + 3) * signals.shape[1] + LEAST or half <= 0:
        raise ValueError(f"{len(t)} frames: too few for a vibration and its drift; film it faster or longer")

    def basis(p: Array) -> Array:
        w, zeta = p
        ratio = min(abs(zeta), 0.99)
        real = np.sqrt(1 - ratio**2)
        decay = np.exp(np.clip(-zeta * w / real * t, -50, 50))
        waves = (decay * np.cos(w * t), decay * np.sin(w * t))
        return np.column_stack([(t / half) ** k for k in range(DRIFT + 1)] + [*waves])

    def left(p: Array) -> Array:
        A = basis(p)
        return np.asarray(signals - A @ np.linalg.lstsq(A, signals, rcond=None)[0]).ravel()

    w = 2 * np.pi * near
    exact: Any = {"diff_step": 1e-6, "xtol": 1e-12, "ftol": 1e-12}
    found = scipy.optimize.least_squares(left, [w, 0.05], x_scale=[0.1 * w, 0.05], **exact)
    r, free = found.fun, found.fun.size - 2 - (DRIFT + 3) * signals.shape[1]
    variance = float(r @ r) / free * _lasting(r.reshape(signals.shape))
    J = np.asarray(found.jac, float)
    covariance = variance * np.linalg.inv(J.T @ J)
    to_Hz = np.diag([1 / (2 * np.pi), 1.0])
    A = basis(found.x)
    waves = np.linalg.lstsq(A, signals, rcond=None)[0][-2:]
    return DampedSine(
        middle, abs(float(found.x[0])) / (2 * np.pi), float(found.x[1]), to_Hz @ covariance @ to_Hz,
        np.hypot(*waves), float(np.sqrt(r @ r / free)),
    )  # fmt: skip


def _lasting(left: Array) -> float:
    """Number of frames for which a residual (t, c) keeps its sign, 1 for white noise: (1 + r) / (1 - r), r
    its correlation from frame to frame."""
    power = float((left**2).sum())
    if power <= 0:
        return 1.0
    r = float((left[1:] * left[:-1]).sum()) / power
    r += (DRIFT + 5) / len(left)  # what the fit itself takes from the correlation
    return (1 + min(max(r, 0.0), 0.9)) / (1 - min(max(r, 0.0), 0.9))
