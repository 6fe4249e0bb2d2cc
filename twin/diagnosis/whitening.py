"""Targets and a model's own errors -> a whitener: residuals in mm become independent values of variance 1.

The noise is the static film's, an autoregression of first order in time whose markers are correlated within a
frame, plus the white codec noise of patches that move; a Kalman filter gives its innovations. On top come
modes: errors shared by many values, 1 sd each, and one gauge error per step.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from twin.targets import Array, Targets

# mm, numerical error of a prediction at one step, taken as white: interpolating a history between its solved
# times leaves 0.3 um rms, 5 um at most (fe/path.py), and the mesh modes are made without history.
NUMERICAL = 0.003


@dataclass(frozen=True)
class Whitener:
    """What `whitener` returns; `whiten` is W, `amplitudes` the most probable size of each shared mode."""

    components: NDArray[np.int64]  # (m, 2): point and axis of each component that is data
    valid: NDArray[np.bool_]  # (s, m)
    sd: Array  # (s, m) mm
    rho: Array  # (m,) lag-1 correlation of the static part
    static: Array  # (m, m) mm2, covariance of the static part within a step
    first: NDArray[np.bool_]  # (s,) first step of a block
    modes: Array  # (k, s, m) mm, shared modes first (the reference's gauge error last), then one a step
    shared: int  # how many of the modes are shared

    @property
    def count(self) -> int:
        """Number of values that are data."""
        return int(self.valid.sum())

    def pick(self, field: Array) -> Array:
        """The components (..., s, m) of a field (..., s, p, 3)."""
        return field[..., self.components[:, 0], self.components[:, 1]]

    @cached_property
    def _filter(self) -> tuple[Array, Array]:
        """What the Kalman filter of x_t = rho x_t-1 + w_t, observed with white noise, does at each step:
        values to innovations (s, m, m), and innovations to corrections of x (s, m, m); zeros where there is
        no data (Anderson & Moore 1979, Optimal Filtering)."""
        steps, m = self.valid.shape
        turn, gain, P = np.zeros((steps, m, m)), np.zeros((steps, m, m)), self.static
        drive = self.static * (1 - np.outer(self.rho, self.rho))
        white = np.maximum(self.sd**2 - np.diag(self.static), 0.0)
        for t, seen in enumerate(self.valid):
            P = self.static if self.first[t] else np.outer(self.rho, self.rho) * P + drive
            own = np.ix_(seen, seen)
            turn[t][own] = np.linalg.inv(np.linalg.cholesky(P[own] + np.diag(white[t, seen])))
            gain[t] = P @ turn[t].T
            P = P - gain[t] @ gain[t].T
        return turn, gain

    def _innovations(self, y: Array) -> Array:
        """Independent values (..., n) of fields y (..., s, m), without the modes; 0 where no data."""
        fields = np.moveaxis(np.where(self.valid, y, 0.0).reshape(-1, *self.valid.shape), 0, 2)  # (s, m, k)
        out, x = np.zeros_like(fields), np.zeros(fields.shape[1:])
        for t, (turn, gain) in enumerate(zip(*self._filter, strict=True)):
            if self.first[t]:
                x = np.zeros_like(x)
            x = np.where(np.abs(x) > 1e-100, x, 0.0)  # of long ago; its squares would underflow
            out[t] = turn @ (fields[t] - x)
            x = self.rho[:, None] * (x + gain @ out[t])
        return np.moveaxis(out, 2, 0).reshape(*y.shape[:-2], out.shape[0] * out.shape[1])

    @cached_property
    def _whitened_modes(self) -> Array:
        """The innovations (k, n) of every mode."""
        return self._innovations(self.modes)

    @cached_property
    def _axes(self) -> tuple[Array, Array]:
        """Orthonormal directions (n, r) in which the modes add variance, and the modes' sizes (r,) there."""
        G = self._whitened_modes
        sizes, turn = np.linalg.eigh(G @ G.T)
        keep = sizes > 1e-10 * max(sizes.max(initial=0.0), 1e-300)
        root = np.sqrt(sizes[keep])
        return (G.T @ turn[:, keep]) / root, root

    def whiten(self, field: Array) -> Array:
        """W applied to fields (..., s, p, 3) mm: values (..., n) of variance 1 where the field is noise."""
        return self._calmed(self._innovations(self.pick(field)))

    def _calmed(self, z: Array) -> Array:
        """Innovations (..., n) with the variance of the modes taken off their directions."""
        axes, sizes = self._axes
        return np.asarray(z - (z @ axes) * (1 - 1 / np.sqrt(1 + sizes**2)) @ axes.T, float)

    @cached_property
    def _gauge_axes(self) -> Array:
        """Orthonormal directions (n, r) of whitened values in which the gauge's errors lie."""
        return np.linalg.qr(self._calmed(self._whitened_modes[self.shared :]).T).Q

    def along_gauge(self, z: Array) -> tuple[float, int]:
        """The chi2 of whitened values (n,) along the gauge's errors, and its number of values."""
        return float(((z @ self._gauge_axes) ** 2).sum()), self._gauge_axes.shape[1]

    def amplitudes(self, residual: Array) -> Array:
        """Most probable amplitude (k,) of every mode in a residual (s, p, 3) mm, in sds."""
        z = self._innovations(self.pick(residual))
        G = self._whitened_modes.T
        return np.asarray(np.linalg.solve(np.eye(G.shape[1]) + G.T @ G, G.T @ z), float)

    def cleaned(self, residual: Array, *, gauge: bool = False) -> Array:
        """The residual (s, m) mm without its shared modes; gauge noise stays unless `gauge`; NaN where no
        data."""
        count = len(self.modes) if gauge else self.shared
        left = self.pick(residual) - np.tensordot(self.amplitudes(residual)[:count], self.modes[:count], 1)
        return np.where(self.valid, left, np.nan)

    def rms(self, residual: Array, *, gauge: bool = False) -> float:
        """Root mean square in mm of the cleaned residual."""
        return float(np.sqrt(np.nanmean(self.cleaned(residual, gauge=gauge) ** 2)))

    @property
    def noise_sd(self) -> float:
        """Root mean variance in mm of one value: independent noise and the gauge's."""
        variance = self.sd**2 + (self.modes[self.shared :] ** 2).sum(axis=0)
        return float(np.sqrt(variance[self.valid].mean()))


def whitener(targets: Targets, *, prediction_modes: Array, gauge: Array) -> Whitener:
    """The whitener of targets with a model's modes.

    prediction_modes (q, s, p, 3) mm: discretisation errors, 1 sd each. gauge (s, p, 3) mm: the effect on each
    step of 1 sd of its pressure's gauge noise, relative to the reference.
    """
    data = targets.valid & ~targets.held_out[:, None, None]
    components = np.argwhere(data.any(axis=0))
    p, i = components.T
    valid = data[:, p, i]
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3)[:, p, i]
    sd = np.sqrt(np.where(valid, variance, 1.0))
    static, rho = np.diag(sd.min(axis=0) ** 2), np.zeros(len(components))
    if targets.noise is not None:
        flat, own = p * 3 + i, targets.noise.sd[p, i]
        # the inverse of a covariance estimated from n frames is too large by (n - 2) / (n - m - 1) beyond
        # what single variances are (Hartlap, Simon & Schneider 2007, doi 10.1051/0004-6361:20066170)
        frames, m = targets.noise.frames, len(components)
        inflation = (frames - 2) / max(frames - m - 1, 1)
        sd = np.sqrt(sd**2 + (inflation - 1) * own**2)
        correlation = shrunk(targets.noise.correlation[np.ix_(flat, flat)], frames, i)
        static = inflation * correlation * np.outer(own, own)
        rho = np.clip(np.nan_to_num(targets.noise.rho[p, i]), 0.0, 0.95)
    moving = (gauge[:, p, i] != 0).any(axis=0)
    sd = np.sqrt(sd**2 + np.where(moving, NUMERICAL**2, 0.0))
    shared, single = _gauge_modes(gauge[:, p, i], targets.reference)
    modes = np.concatenate([targets.modes[:, :, p, i], prediction_modes[:, :, p, i], shared])
    modes, single = (np.where(valid, np.nan_to_num(x), 0.0) for x in (modes, single))
    first = np.append(True, np.diff(targets.block) > 0)
    return Whitener(
        components=components,
        valid=valid,
        sd=sd,
        rho=rho,
        static=static,
        first=first,
        modes=np.concatenate([modes, single]),
        shared=len(modes),
    )


def _gauge_modes(gauge: Array, reference: NDArray[np.int64]) -> tuple[Array, Array]:
    """A shared mode (1 or 0, s, m) and single modes (k, s, m) of 1 sd, of gauge errors (s, m) mm a step.

    The mean error of the reference moves all other steps against it by the same; what single steps of the
    reference are off from that mean, and every other step, is on its own.
    """
    inside = np.isin(np.arange(len(gauge)), reference)
    mean = np.where(inside[:, None], 0.0, -gauge[reference].mean(axis=0) / np.sqrt(len(reference)))
    steps = np.flatnonzero((gauge != 0).any(axis=1))
    single = np.zeros((len(steps), *gauge.shape))
    for row, step in enumerate(steps):
        single[row, step] = gauge[step]
        if inside[step]:
            single[row, reference] -= gauge[step] / len(reference)
    return mean[None][: int(mean.any())], single


def shrunk(correlation: Array, frames: int, axis: NDArray[np.int64]) -> Array:
    """The correlation (m, m) estimated from `frames` frames, drawn by its own sampling error towards what all
    components of one axis (m,) share, and independence between axes.

    The weight is the ratio of the sampling variance (1 - r^2)^2 / n to the spread of the off-diagonal values
    about that target (Schaefer & Strimmer 2005, doi 10.2202/1544-6115.1175). Towards plain independence,
    markers that jitter together would lose a part of it, and their mean would be stated too small.
    """
    off = ~np.eye(len(correlation), dtype=bool)
    target = np.zeros_like(correlation)
    for k in np.unique(axis):
        same = np.outer(axis == k, axis == k) & off
        target[same] = max(float(correlation[same].mean()), 0.0) if same.any() else 0.0
    spread = float(((correlation - target)[off] ** 2).sum())
    noise = float(((1 - correlation[off] ** 2) ** 2).sum()) / max(frames - 1, 1)
    weight = min(1.0, noise / spread) if spread > 0 else 1.0
    return np.where(off, correlation + weight * (target - correlation), 1.0)
