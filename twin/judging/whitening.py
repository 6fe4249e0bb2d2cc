"""Targets and a model's own errors -> a whitener: residuals in mm become independent values of variance 1.

The noise is the static film's, whose markers are correlated within a frame: an autoregression of first order
in time, and a white rest; and the white codec noise of patches that move. A Kalman filter gives its
innovations. On top come modes: errors shared by many values, 1 sd each, and one gauge error per step.

The solver's own error is left out. Without history it is 5e-8 of the motion (48 levels for 12). With creep,
of three Prony terms on film A with a regulator's ripple, three times as many times change the default finger
by 1.0 um rms, its tip by 2.0 um of 63 mm. In films with noise of 1.5 and 0.8 um that raises chi2 by 50 and
200 of 5000; p falls from 0.24 to 0.09 and 0.02. As white noise it would cost a model with memory 1600 and
3500 of its deviance beside one without, which is the larger error.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from twin.targets import Array, Noise, Targets


@dataclass(frozen=True)
class Steady:
    """The noise at rest of a film: static (m, m) mm2, the covariance within a step of its part that lasts;
    fresh (m, m) mm2, that of its part that is new in each frame; rho (m,), the lag-1 correlation of the
    first."""

    static: Array
    fresh: Array
    rho: Array


@dataclass(frozen=True)
class Whitener:
    """What `whitener` returns; `whiten` is W, `amplitudes` the most probable size of each shared mode."""

    components: NDArray[np.int64]  # (m, 2): point and axis of each component that is data
    valid: NDArray[np.bool_]  # (s, m)
    sd: Array  # (s, m) mm
    steady: tuple[Steady, ...]  # (blocks,)
    block: NDArray[np.int64]  # (s,)
    modes: Array  # (k, s, m) mm, shared modes first (the reference's gauge error last), then one a step
    shared: int  # how many of the modes are shared
    names: tuple[str, ...]  # (shared,) of the shared modes

    @property
    def rho(self) -> Array:
        """The lag-1 correlation (m,) of the static part in the first block."""
        return self.steady[0].rho

    @property
    def static(self) -> Array:
        """The covariance (m, m) mm2 of the static part in the first block."""
        return self.steady[0].static

    @cached_property
    def first(self) -> NDArray[np.bool_]:
        """Which steps (s,) are the first of their block."""
        return np.append(True, np.diff(self.block) > 0)

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
        for t, seen in enumerate(self.valid):
            n = self.steady[self.block[t]]
            kept = np.outer(n.rho, n.rho)
            P = n.static if self.first[t] else kept * P + n.static * (1 - kept)
            own = np.ix_(seen, seen)
            white = np.maximum(self.sd[t] ** 2 - np.diag(n.static + n.fresh), 0.0)[seen]
            turn[t][own] = np.linalg.inv(np.linalg.cholesky((P + n.fresh)[own] + np.diag(white)))
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
            x = self.steady[self.block[t]].rho[:, None] * (x + gain @ out[t])
        return np.moveaxis(out, 2, 0).reshape(*y.shape[:-2], out.shape[0] * out.shape[1])

    @cached_property
    def _whitened_modes(self) -> Array:
        """The innovations (k, n) of every mode."""
        return self._innovations(self.modes)

    @cached_property
    def _gram(self) -> Array:
        """The products (k, k) of the modes' innovations."""
        return np.asarray(self._whitened_modes @ self._whitened_modes.T, float)

    @cached_property
    def _axes(self) -> tuple[Array, Array]:
        """Orthonormal directions (n, r) in which the modes add variance, and the modes' sizes (r,) there."""
        G = self._whitened_modes
        sizes, turn = np.linalg.eigh(self._gram)
        keep = sizes > 1e-10 * max(sizes.max(initial=0.0), 1e-300)
        root = np.sqrt(sizes[keep])
        return (G.T @ turn[:, keep]) / root, root

    def whiten(self, field: Array) -> Array:
        """W applied to fields (..., s, p, 3) mm: values (..., n) of variance 1 where the field is noise."""
        return self._calmed(self._innovations(self.pick(field)))

    @cached_property
    def log_det(self) -> float:
        """ln det of the covariance in mm2 of the values that are data: that of their innovations, and what
        the modes add, ln det(1 + G'G) (matrix determinant lemma)."""
        diagonal = np.diagonal(self._filter[0], axis1=1, axis2=2)[self.valid]  # of inverse Cholesky factors
        return float(np.log1p(self._axes[1] ** 2).sum() - 2 * np.log(diagonal).sum())

    def _calmed(self, z: Array) -> Array:
        """Innovations (..., n) with the variance of the modes taken off their directions."""
        axes, sizes = self._axes
        return np.asarray(z - (z @ axes) * (1 - 1 / np.sqrt(1 + sizes**2)) @ axes.T, float)

    @cached_property
    def _gauge_axes(self) -> tuple[Array, Array]:
        """The gauge's errors (k, n) in whitened values, and what makes orthonormal directions of them (k,
        r)."""
        errors = self._calmed(self._whitened_modes[self.shared :])
        sizes, turn = np.linalg.eigh(errors @ errors.T)
        keep = sizes > 1e-12 * max(float(sizes.max(initial=0.0)), 1e-300)
        return errors, turn[:, keep] / np.sqrt(sizes[keep])

    def along_gauge(self, z: Array) -> tuple[float, int]:
        """The chi2 of whitened values (n,) along the gauge's errors, and its number of values."""
        errors, turn = self._gauge_axes
        return float((((errors @ z) @ turn) ** 2).sum()), turn.shape[1]

    def amplitudes(self, residual: Array, *, bound: float = np.inf) -> Array:
        """Most probable amplitude (k,) of every mode in a residual (s, p, 3) mm, in sds; that of a shared
        mode within +- bound."""
        z = self._innovations(self.pick(residual))
        H, b = np.eye(len(self.modes)) + self._gram, self._whitened_modes @ z
        found = np.asarray(np.linalg.solve(H, b), float)
        return found if np.all(np.abs(found[: self.shared]) <= bound) else _bounded(H, b, self.shared, bound)

    def cleaned(self, residual: Array, *, gauge: bool = False, bound: float = np.inf) -> Array:
        """The residual (s, m) mm without its shared modes, each at most `bound` sds; gauge noise stays unless
        `gauge`; NaN where no data."""
        count, size = len(self.modes) if gauge else self.shared, self.amplitudes(residual, bound=bound)
        left = self.pick(residual) - np.tensordot(size[:count], self.modes[:count], 1)
        return np.where(self.valid, left, np.nan)

    def rms(self, residual: Array, *, gauge: bool = False, bound: float = np.inf) -> float:
        """Root mean square in mm of the cleaned residual."""
        return float(np.sqrt(np.nanmean(self.cleaned(residual, gauge=gauge, bound=bound) ** 2)))

    def error(self, residual: Array) -> float:
        """Root mean square in mm of a residual (s, p, 3) mm as it is drawn, shared errors and all."""
        return float(np.sqrt((self.pick(residual)[self.valid] ** 2).mean()))

    @property
    def noise_sd(self) -> float:
        """Root mean variance in mm of one value: independent noise and the gauge's."""
        variance = self.sd**2 + (self.modes[self.shared :] ** 2).sum(axis=0)
        return float(np.sqrt(variance[self.valid].mean()))

    @property
    def expected(self) -> float:
        """Root mean variance in mm of one value: noise and shared errors together, as `error` would be."""
        variance = self.sd**2 + (self.modes**2).sum(axis=0)
        return float(np.sqrt(variance[self.valid].mean()))


def _bounded(H: Array, b: Array, count: int, bound: float) -> Array:
    """The minimum (k,) of x'Hx - 2 b'x with |x| <= bound for the first `count` entries."""
    own, rest = slice(count), slice(count, None)
    cross = np.linalg.solve(H[rest, rest], np.column_stack([H[rest, own], b[rest]]))
    root = np.linalg.cholesky(H[own, own] - H[own, rest] @ cross[:, :-1]).T
    right = np.linalg.solve(root.T, b[own] - H[own, rest] @ cross[:, -1])
    x = _boxed(np.asarray(root.T @ root, float), np.asarray(root.T @ right, float), bound)
    return np.concatenate([x, cross[:, -1] - cross[:, :-1] @ x])


def _boxed(Q: Array, c: Array, bound: float) -> Array:
    """The minimum (k,) of x'Qx - 2 c'x with |x| <= bound: Newton's method on what is not held at a bound
    (Bertsekas 1982, doi 10.1137/0320018); where that goes in circles, the lowest it came to."""
    x = np.clip(np.linalg.solve(Q, c), -bound, bound)
    best = x
    for _ in range(50):
        slope = Q @ x - c
        held = ((x >= bound) & (slope < 0)) | ((x <= -bound) & (slope > 0))
        new = x.copy()
        new[~held] = np.linalg.solve(Q[np.ix_(~held, ~held)], c[~held] - Q[np.ix_(~held, held)] @ x[held])
        new = np.clip(new, -bound, bound)
        if np.abs(new - x).max(initial=0.0) < 1e-9 * bound:
            return new
        x = new
        best = min(best, x, key=lambda y: float(y @ Q @ y - 2 * c @ y))
    return best


def whitener(
    targets: Targets,
    *,
    prediction_modes: Array,
    gauge: Array,
    points: NDArray[np.bool_] | None = None,
) -> Whitener:
    """The whitener of targets with a model's modes.

    prediction_modes (q, s, p, 3) mm: discretisation errors, 1 sd each. gauge (s, p, 3) mm: the effect on each
    step of 1 sd of its pressure's gauge noise, relative to the reference. points (p,): those whose values are
    data, by default all.
    """
    data = targets.valid & ~targets.held_out[:, None, None]
    if points is not None:
        data = data & points[:, None]
    components = np.argwhere(data.any(axis=0))
    p, i = components.T
    valid = data[:, p, i]
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3)[:, p, i]
    sd = np.sqrt(np.where(valid, variance, 1.0))
    none = np.zeros((len(components), len(components)))
    steady: tuple[Steady, ...] = (Steady(np.diag(sd.min(axis=0) ** 2), none, np.zeros(len(components))),)
    if targets.noise is not None:
        models = targets.noises or (targets.noise,)
        made = [_steady(noise, components) for noise in models]
        steady, more = tuple(one for one, _ in made), np.array([extra for _, extra in made])
        sd = np.sqrt(sd**2 + more[targets.block if targets.noises else np.zeros_like(targets.block)])
    if len(steady) == 1:
        steady *= int(targets.block[-1]) + 1
    shared, single = _gauge_modes(gauge[:, p, i], targets.reference, targets.rests)
    modes = np.concatenate([targets.modes[:, :, p, i], prediction_modes[:, :, p, i], shared])
    modes, single = (np.where(valid, np.nan_to_num(x), 0.0) for x in (modes, single))
    names = *targets.mode_names, *("mesh",) * len(prediction_modes), *("gauge:reference",) * len(shared)
    return Whitener(
        components=components,
        valid=valid,
        sd=sd,
        steady=steady,
        block=targets.block,
        modes=np.concatenate([modes, single]),
        shared=len(modes),
        names=names,
    )


def _steady(noise: Noise, components: NDArray[np.int64]) -> tuple[Steady, Array]:
    """The noise at rest of components (m, 2), and what is added to each one's variance (m,) mm2 for the few
    frames that it was estimated from.

    The inverse of a covariance estimated from n frames is too large by (n - 2) / (n - m - 1) beyond what
    single variances are (Hartlap, Simon & Schneider 2007, doi 10.1051/0004-6361:20066170).
    """
    p, i = components.T
    flat, own, frames = p * 3 + i, noise.sd[p, i], noise.frames
    inflation = (frames - 2) / max(frames - len(components) - 1, 1)
    correlation = shrunk(noise.correlation[np.ix_(flat, flat)], frames, i)
    within = inflation * correlation * np.outer(own, own)
    rho = np.clip(np.nan_to_num(noise.rho[p, i]), 0.0, 0.99)
    return Steady(noise.lasting * within, (1 - noise.lasting) * within, rho), (inflation - 1) * own**2


def _gauge_modes(gauge: Array, reference: NDArray[np.int64], rests: NDArray[np.int64]) -> tuple[Array, Array]:
    """Shared modes (r, s, m) and single modes (k, s, m) of 1 sd, of gauge errors (s, m) mm a step.

    The mean error of a reference moves all other steps of its rest against it by the same; what single steps
    of the reference are off from that mean, and every other step, is on its own. rests (s,): numbers.
    """
    inside = np.isin(np.arange(len(gauge)), reference)
    shared = []
    for rest in np.unique(rests):
        own = reference[rests[reference] == rest]
        moved = (~inside & (rests == rest))[:, None]
        mean = np.where(moved, -gauge[own].mean(axis=0) / np.sqrt(len(own)), 0.0)
        shared += [mean] if mean.any() else []
    steps = np.flatnonzero((gauge != 0).any(axis=1))
    single = np.zeros((len(steps), *gauge.shape))
    for row, step in enumerate(steps):
        single[row, step] = gauge[step]
        if inside[step]:
            own = reference[rests[reference] == rests[step]]
            single[row, own] -= gauge[step] / len(own)
    return np.array(shared).reshape(len(shared), *gauge.shape), single


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
