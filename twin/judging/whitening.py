"""Targets and a model's own errors -> a whitener: residuals in mm become independent values of variance 1.

On top of the noise (`noisefilter`), the gauge's in each step among it, come modes: errors shared by many
values, 1 sd each, and the gauge's errors in the reference, which move its other steps, too.

The solver's own error is left out. Without history it is 5e-8 of the motion (48 levels for 12). With creep,
of three Prony terms on film A with a regulator's ripple, three times as many times change the default finger
by 1.0 um rms, its tip by 2.0 um of 63 mm. In films with noise of 1.5 and 0.8 um that raises chi2 by 50 and
200 of 5000; p falls from 0.24 to 0.09 and 0.02. As white noise it would cost a model with memory 1600 and
3500 of its deviance beside one without, which is the larger error.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from twin.judging.noisefilter import NoiseFilter, noise_filter
from twin.model.discretisation import WALL
from twin.targets import Array, Targets

LAW = "law:"  # and an effect: the name of a mode that is an error of its law
PLAUSIBLE = 3.0  # sd of a shared error beyond which none is taken off: what is left belongs to the model
MESH_MODE = "mesh"  # the name of a mode of the model that has no other
OWN = "gauge:reference"  # the name of a mode that belongs to one film alone
CHUNK = 64  # fields whose noise is in memory at a time


@dataclass(frozen=True)
class Expected:
    """The error in mm of a right model: its root mean square, and the ends of its 95 % band."""

    rms_mm: float
    low_mm: float
    high_mm: float


UNKNOWN = Expected(float("nan"), float("nan"), float("nan"))


@dataclass(frozen=True, eq=False)
class Whitener:
    """The linear map W of residuals in mm to independent values of variance 1, from noise and shared modes.

    The covariance is N + sum of m m' over the modes m, with N of the noise filter. Without modes, innovations
    y = F r have unit covariance. With modes it is I + G'G, where G = F m (k, n). `rewhitened` multiplies by
    the symmetric inverse root of that (Kessy, Lewin & Strimmer 2018, doi 10.1080/00031305.2016.1277159).

    Two steps of a value with noise of sd 1 and a shared error of 1 sd, covariance [[2, 1], [1, 2]]:

    >>> from twin.judging.noisefilter import Steady
    >>> still = Steady(np.eye(1), np.zeros((1, 1)), np.zeros(1))
    >>> block = np.zeros(2, int)
    >>> noise = NoiseFilter(np.array([[0, 0]]), np.ones((2, 1), bool), np.ones((2, 1)), (still,), block)
    >>> w = Whitener(noise, np.ones((1, 2, 1)), 1, ("scale",))
    >>> w.whiten(np.ones((2, 1, 3))).round(3)  # (1, 1) / sqrt(3)
    array([0.577, 0.577])
    >>> round(w.log_det, 3)  # ln 3
    1.099
    """

    noise: NoiseFilter
    modes: Array  # (k, s, m) mm, shared ones first (of the gauge in the mean reference last), then its steps
    shared: int  # how many of the modes are shared
    names: tuple[str, ...]  # (shared,) of the shared modes
    gauge: Array | float = 0.0  # (s, m) mm: what 1 sd of the gauge's noise does to each value

    @property
    def components(self) -> NDArray[np.int64]:
        """Point and axis (m, 2) of each component that is data."""
        return self.noise.components

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Flags (s, m) of the values that are data."""
        return self.noise.valid

    @property
    def sd(self) -> Array:
        """The sd (s, m) mm of the noise of each value."""
        return self.noise.sd

    @property
    def rho(self) -> Array:
        """The lag-1 correlation (m,) of the static part in the first block."""
        return self.noise.steady[0].rho

    @property
    def static(self) -> Array:
        """The covariance (m, m) mm2 of the static part in the first block."""
        return self.noise.steady[0].static

    @property
    def count(self) -> int:
        """Number of values that are data."""
        return int(self.valid.sum())

    @property
    def of_laws(self) -> NDArray[np.bool_]:
        """Flags (shared,) of the shared modes that are errors of the model's laws."""
        return np.array([name.startswith(LAW) for name in self.names], bool)

    def pick(self, field: Array) -> Array:
        """The components (..., s, m) of a field (..., s, p, 3)."""
        return field[..., self.components[:, 0], self.components[:, 1]]

    def innovations(self, field: Array) -> Array:
        """Independent values (..., n) of fields (..., s, p, 3) mm, the modes not yet taken off."""
        return self.noise.innovations(self.pick(field))

    def beside(self, modes: Array, names: Sequence[str]) -> "Whitener":
        """The whitener with more shared modes (k, s, p, 3) mm of these names (k,)."""
        count, more = self.shared, np.where(self.valid, np.nan_to_num(self.pick(modes)), 0.0)
        every = np.concatenate([self.modes[:count], more, self.modes[count:]])
        return replace(self, modes=every, shared=count + len(more), names=(*self.names, *names))

    @cached_property
    def _whitened_modes(self) -> Array:
        """The innovations (k, n) of every mode."""
        return self.noise.innovations(self.modes)

    @property
    def mode_innovations(self) -> Array:
        """The innovations (k, n) of every mode, 1 sd each."""
        return self._whitened_modes

    @cached_property
    def _gram(self) -> Array:
        """The products (k, k) of the modes' innovations."""
        return np.asarray(self._whitened_modes @ self._whitened_modes.T, float)

    @cached_property
    def _spectrum(self) -> tuple[Array, Array]:
        """The variances (r,) that the modes add in orthonormal directions, and what takes them off (k, k): of
        innovations z (n,) and G of the modes, z - G'S G z has variance 1."""
        added, vectors = np.linalg.eigh(self._gram)
        keep = added > 1e-13 * max(added.max(initial=0.0), 1e-300)
        added, vectors = added[keep], vectors[:, keep]
        return added, (vectors * (1 - 1 / np.sqrt(1 + added)) / added) @ vectors.T

    def whiten(self, field: Array) -> Array:
        """W applied to fields (..., s, p, 3) mm: values (..., n) of variance 1 where the field is noise."""
        return self.rewhitened(self.innovations(field))

    @cached_property
    def log_det(self) -> float:
        """ln det of the covariance in mm2 of the values that are data: of their innovations, and what
        the modes add, ln det(1 + G'G) (matrix determinant lemma)."""
        return float(np.log1p(self._spectrum[0]).sum()) + self.noise.log_det

    def rewhitened(self, z: Array) -> Array:
        """Innovations (..., n) with the variance of the modes taken off their directions."""
        G = self._whitened_modes
        return np.asarray(z - (z @ G.T) @ self._spectrum[1] @ G, float)

    def along_gauge(self, z: Array) -> tuple[float, int]:
        """The chi2 of whitened values (n,) along the gauge's errors, one direction a step: that in which they
        are new; and its number of values."""
        along = np.einsum("tij,tj->ti", self.noise.gains[0], np.broadcast_to(self.gauge, self.sd.shape))
        size = np.linalg.norm(along, axis=1)
        sizes = (along * z.reshape(along.shape)).sum(axis=1)[size > 0] / size[size > 0]
        return float(sizes @ sizes), len(sizes)

    def amplitudes(self, residual: Array, *, bound: float = np.inf) -> Array:
        """Most probable amplitude (k,) of every mode in a residual (s, p, 3) mm, in sds; of a shared mode
        within +- bound."""
        z = self.innovations(residual)
        H, b = np.eye(len(self.modes)) + self._gram, self._whitened_modes @ z
        sizes = np.asarray(np.linalg.solve(H, b), float)
        return sizes if np.all(np.abs(sizes[: self.shared]) <= bound) else _bounded(H, b, self.shared, bound)

    def cleaned(self, residual: Array, *, bound: float = np.inf) -> Array:
        """The residual (s, m) mm without its shared modes, each at most `bound` sds; gauge noise stays, and
        law errors, which are no errors of the measurement; NaN where no data."""
        size = self.amplitudes(residual, bound=bound)[: self.shared]
        size[self.of_laws] = 0.0
        cleaned = self.pick(residual) - np.tensordot(size, self.modes[: self.shared], 1)
        return np.where(self.valid, cleaned, np.nan)

    def rms(self, residual: Array, *, bound: float = np.inf) -> float:
        """Root mean square in mm of the cleaned residual."""
        return float(np.sqrt(np.nanmean(self.cleaned(residual, bound=bound) ** 2)))

    def error(self, residual: Array) -> float:
        """Root mean square in mm of a residual (s, p, 3) mm, shared errors included, as drawn."""
        return float(np.sqrt((self.pick(residual)[self.valid] ** 2).mean()))

    def error_beside_walls(self, residual: Array) -> float:
        """As `error`, with the walls that no camera sees as thick as is most probable, within PLAUSIBLE sds;
        as stated, where the model lacks something else and these would make it larger."""
        if not self.of_walls.any():
            return self.error(residual)
        size = self.amplitudes(residual, bound=PLAUSIBLE)[: self.shared][self.of_walls]
        values = self.pick(residual) - np.tensordot(size, self.modes[: self.shared][self.of_walls], 1)
        return min(self.error(residual), float(np.sqrt((values[self.valid] ** 2).mean())))

    @property
    def noise_sds(self) -> Array:
        """The sd (s, m) mm of each value: independent noise and the gauge's."""
        variance = self.sd**2 + np.square(self.noise.gauge) + (self.modes[self.shared :] ** 2).sum(axis=0)
        return np.asarray(np.sqrt(variance), float)

    @property
    def noise_sd(self) -> float:
        """Root mean variance in mm of one value: independent noise and the gauge's."""
        return float(np.sqrt((self.noise_sds[self.valid] ** 2).mean()))

    @cached_property
    def without_laws(self) -> "Whitener":
        """The whitener without the modes that are errors of the model's laws."""
        return self._without(self.of_laws)

    def _without(self, left: NDArray[np.bool_]) -> "Whitener":
        """The whitener without some (shared,) of its shared modes."""
        if not left.any():
            return self
        kept = np.append(~left, np.ones(len(self.modes) - self.shared, bool))
        names = tuple(name for name, gone in zip(self.names, left, strict=True) if not gone)
        return replace(self, modes=self.modes[kept], shared=len(names), names=names)

    @cached_property
    def of_walls(self) -> NDArray[np.bool_]:
        """Flags (shared,) of the modes that are tolerances of walls."""
        return np.array([name.startswith(WALL) for name in self.names], bool)

    def expected_after(self, jacobian: Array) -> "Expected":
        """What `error_beside_walls` would be of a right model after its fit, with derivatives (d, s, p, 3).

        The generalised least-squares residual has the covariance R = Sigma - X C X', with Sigma of noise and
        shared errors (those of laws and walls apart), X of the derivatives and the walls' modes and C = (X'
        Sigma^-1 X + P)^-1, P the prior of the walls (Henderson 1975, doi 10.2307/2529430). Its mean square,
        tr R / n, has the variance 2 tr R^2 / n^2; the band is that of the gamma distribution with these two
        moments (F. E. Satterthwaite, doi 10.2307/3002019).
        """
        w = self.without_laws
        walls, rest = w.modes[: w.shared][w.of_walls], w._without(w.of_walls)
        covariance, _ = rest._estimated(jacobian, w.mode_innovations[: w.shared][w.of_walls])
        fields = rest.modes, w._fields(jacobian), walls
        inner = np.eye(sum(map(len, fields)))
        inner[len(rest.modes) :, len(rest.modes) :] = -covariance
        return rest._spread(fields, inner)

    def expected_unseen(self, fit: "Whitener", jacobian: Array) -> "Expected":
        """What `error` would be of a right model in values that its fit has not seen.

        fit: the whitener of the values that it has seen; jacobian (d, s, p, 3) at both. With A of the modes
        that both share, the error of the prediction is N + M'M - M'A'CJ - J'CAM + J'CJ, A = J Sigma^-1 M'
        over the seen values: what is common to both films is in part already in the constants.
        """
        w, seen = self.without_laws, fit.without_laws
        covariance, columns = seen._estimated(jacobian, np.zeros((0, seen.valid.size)))
        count = len(w.modes)
        inner = np.eye(count + len(jacobian))
        inner[count:, count:] = covariance
        common = [k for k, name in enumerate(w.names) if name != OWN and k < seen.shared]
        taken = covariance @ columns @ seen.rewhitened(seen.mode_innovations[common]).T
        inner[count:, common], inner[np.ix_(common, range(count, len(inner)))] = -taken, -taken.T
        return w._spread((w.modes, w._fields(jacobian)), inner)

    def _fields(self, jacobian: Array) -> Array:
        """The values (d, s, m) mm of derivatives (d, s, p, 3), 0 where no data."""
        return np.where(self.valid, np.nan_to_num(self.pick(jacobian)), 0.0)

    def _estimated(self, jacobian: Array, known: Array) -> tuple[Array, Array]:
        """The covariance (d + k, d + k) of a fit with derivatives (d, s, p, 3) and of `known`, the
        innovations (k, n) of 1 sd of what is stated, and both whitened (d + k, n)."""
        free = self.whiten(jacobian) if len(jacobian) else np.zeros((0, self.valid.size))
        columns = np.concatenate([free, self.rewhitened(known)])
        prior = np.diag(np.append(np.zeros(len(free)), np.ones(len(known))))
        covariance = np.linalg.pinv(columns @ columns.T + prior, rcond=1e-12, hermitian=True)
        return np.asarray(covariance, float), columns

    def _spread(self, fields: Sequence[Array], inner: Array) -> "Expected":
        """The root mean square in mm of values, and its 95 % band.

        Their covariance is N + A' S A: N of the noise, S = inner (k, k) of the fields A (k, s, m) mm, which
        come in parts, and are taken CHUNK at a time, as all of them are large.
        """
        parts = [part.reshape(len(part), self.valid.size) for part in fields]
        columns = [np.zeros((len(inner), 0))]
        for part in fields:
            for chunk in (part[k : k + CHUNK] for k in range(0, len(part), CHUNK)):
                both = np.concatenate([chunk, self.noise.covariance_times(chunk)])
                columns.append(np.concatenate([p @ both.reshape(len(both), -1).T for p in parts]))
        gram = np.concatenate([c[:, : c.shape[1] // 2] for c in columns], axis=1)
        between = np.concatenate([c[:, c.shape[1] // 2 :] for c in columns], axis=1)
        product = inner @ gram
        trace = self.noise.trace + float(np.trace(product))
        square = self.noise.trace_of_square
        square += 2 * float((inner * between.T).sum()) + float((product * product.T).sum())
        mean, variance = trace / self.count, 2 * square / self.count**2
        if min(mean, variance) <= 0.0:  # by rounding: as many constants as values leave nothing
            return Expected(0.0, 0.0, 0.0)
        shape = mean**2 / variance
        low, high = np.sqrt(scipy.special.gammaincinv(shape, np.array([0.025, 0.975])) * mean / shape)
        return Expected(float(np.sqrt(mean)), float(low), float(high))

    @property
    def stated(self) -> float:
        """Root mean variance in mm of one value before any fit: noise and shared errors together."""
        variance = self.noise_sds**2 + (self.modes[: self.shared][~self.of_laws] ** 2).sum(axis=0)
        return float(np.sqrt(variance[self.valid].mean()))


def _bounded(H: Array, b: Array, count: int, bound: float) -> Array:
    """The minimum (k,) of x'Hx - 2 b'x with |x| <= bound for the first `count` entries."""
    bounded, rest = slice(count), slice(count, None)
    cross = np.linalg.solve(H[rest, rest], np.column_stack([H[rest, bounded], b[rest]]))
    root = np.linalg.cholesky(H[bounded, bounded] - H[bounded, rest] @ cross[:, :-1]).T
    right = np.linalg.solve(root.T, b[bounded] - H[bounded, rest] @ cross[:, -1])
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
    names: Sequence[str] = (),
) -> Whitener:
    """The whitener of targets with a model's modes.

    prediction_modes (q, s, p, 3) mm: discretisation errors, 1 sd each, with names (q,) where they have any.
    gauge (s, p, 3) mm: the effect on each step of 1 sd of its pressure's gauge noise, relative to the
    reference. points (p,): those whose values are data, by default all.
    """
    noise = noise_filter(targets, points)
    p, i = noise.components.T
    own = np.nan_to_num(gauge[:, p, i])
    shared, single = _gauge_modes(own, targets.reference, targets.rests)
    parts = (targets.modes[:, :, p, i], prediction_modes[:, :, p, i], shared, single)
    modes, count = np.concatenate(parts), sum(map(len, parts[:3]))
    del parts  # the modes of a film are large
    modes[~(np.isfinite(modes) & noise.valid)] = 0.0
    names = *targets.mode_names, *(names or (MESH_MODE,) * len(prediction_modes)), *(OWN,) * len(shared)
    alone = np.isin(np.arange(len(own)), targets.reference, invert=True)[:, None]
    noise = noise.with_gauge(np.where(alone, own, 0.0))
    return Whitener(noise, modes, count, names, np.where(noise.valid, own, 0.0))


def _gauge_modes(gauge: Array, reference: NDArray[np.int64], rests: NDArray[np.int64]) -> tuple[Array, Array]:
    """Shared modes (r, s, m) and those of single reference steps (k, s, m), 1 sd each, of gauge errors (s, m)
    mm a step.

    The mean error of a reference moves all other steps of its rest against it by the same; beside it stands
    what single steps of the reference are off from that mean. What any other step is off is on its own, and
    noise. rests (s,): numbers.
    """
    inside = np.isin(np.arange(len(gauge)), reference)
    shared = []
    for rest in np.unique(rests):
        steps_of_rest = reference[rests[reference] == rest]
        moved = (~inside & (rests == rest))[:, None]
        mean = np.where(moved, -gauge[steps_of_rest].mean(axis=0) / np.sqrt(len(steps_of_rest)), 0.0)
        shared += [mean] if mean.any() else []
    steps = np.flatnonzero((gauge != 0).any(axis=1) & inside)
    single = np.zeros((len(steps), *gauge.shape))
    for row, step in enumerate(steps):
        steps_of_rest = reference[rests[reference] == rests[step]]
        single[row, step] = gauge[step]
        single[row, steps_of_rest] -= gauge[step] / len(steps_of_rest)
    return np.array(shared).reshape(len(shared), *gauge.shape), single
