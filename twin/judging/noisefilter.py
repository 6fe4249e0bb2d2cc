"""The noise of targets at rest -> a Kalman filter: values in mm become independent innovations of variance 1.

The noise is the static film's, whose markers are correlated within a frame: an autoregression of first order
in time, and a white rest; the coding noise of patches that move, white or correlated from step to step; and
the noise of the pressure gauge, one error a step, which moves all values of the step together.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from twin.targets import Array, Noise, Targets

KEPT = 4  # noise filters: of a film, of its fixed markers, of what is held out


@dataclass(frozen=True)
class Steady:
    """The noise at rest of a film: static (m, m) mm2, the covariance within a step of its part that lasts;
    fresh (m, m) mm2, that of its part that is new in each frame; rho (m,), the lag-1 correlation of the
    first; coding, that of what is added where patches move."""

    static: Array
    fresh: Array
    rho: Array
    coding: float = 0.0


@dataclass(frozen=True, eq=False)
class NoiseFilter:
    """The noise of targets and the Kalman filter that whitens it: x_t = rho x_t-1 + w_t, observed with white
    noise (Anderson & Moore 1979, Optimal Filtering). Without `gauge` it knows no model: all models of the
    targets share it."""

    components: NDArray[np.int64]  # (m, 2): point and axis of each component that is data
    valid: NDArray[np.bool_]  # (s, m)
    sd: Array  # (s, m) mm, the gauge's noise aside
    steady: tuple[Steady, ...]  # (blocks,)
    block: NDArray[np.int64]  # (s,)
    gauge: Array | float = 0.0  # (s, m) mm: what 1 sd of the gauge's noise does to each value
    kept: dict[str, Array] = field(default_factory=dict)  # what is made once, by its name

    def with_gauge(self, gauge: Array) -> "NoiseFilter":
        """The noise with that of a gauge (s, m) mm, an error of 1 sd in each step."""
        return replace(self, gauge=np.where(self.valid, gauge, 0.0), kept={})

    @cached_property
    def first(self) -> NDArray[np.bool_]:
        """Flags (s,) of the first step of each block."""
        return np.append(True, np.diff(self.block) > 0)

    @cached_property
    def gains(self) -> tuple[Array, Array]:
        """Values to innovations (s, m, m), and innovations to corrections of x (s, m, m); zeros where there
        is no data."""
        steps, m = self.valid.shape
        turn, gain, P = np.zeros((steps, m, m)), np.zeros((steps, m, m)), self.steady[0].static
        for t, seen in enumerate(self.valid):
            S = self._lasting(t)
            P = S if self.first[t] else S + self._later(t, self._later(t, P - self._lasting(t - 1)).T)
            data = np.ix_(seen, seen)
            turn[t][data] = np.linalg.inv(np.linalg.cholesky((P + self._new(t))[data]))
            gain[t] = P @ turn[t].T
            P = P - gain[t] @ gain[t].T
        return turn, gain

    def _lasting(self, t: int) -> Array:
        """The covariance (m, m) mm2 of what lasts in a step."""
        n = self.steady[self.block[t]]
        return n.static + np.diag(self._added[t]) if n.coding else n.static

    def _later(self, t: int, x: Array) -> Array:
        """What is left (m, k) in a step of what lasted, x (m, k), in the step before."""
        n = self.steady[self.block[t]]
        return self._onward[t] @ x if n.coding else n.rho[:, None] * x

    @cached_property
    def _onward(self) -> Array:
        """The matrices (s, m, m) by which what lasts goes on from the step before, zeros in first steps: as
        the covariance of both steps tells, the sum of that at rest and that of coding."""
        out = np.zeros((len(self.valid), *self.steady[0].static.shape))
        for t in np.flatnonzero(~self.first).tolist():
            n, added = self.steady[self.block[t]], np.sqrt(self._added[t] * self._added[t - 1])
            both = n.rho[:, None] * n.static + n.coding * np.diag(added)
            out[t] = np.linalg.solve(self._lasting(t - 1), both.T).T
        return out

    @cached_property
    def log_det(self) -> float:
        """ln det of the noise's covariance in mm2 of the values that are data."""
        diagonal = np.diagonal(self.gains[0], axis1=1, axis2=2)[self.valid]  # of inverse Cholesky factors
        return float(-2 * np.log(diagonal).sum())

    @cached_property
    def _added(self) -> Array:
        """The variance (s, m) mm2 of each value beyond that of the noise at rest."""
        still = np.array([np.diag(n.static + n.fresh) for n in self.steady])[self.block]
        return np.where(self.valid, np.maximum(self.sd**2 - still, 0.0), 0.0)

    def _new(self, t: int) -> Array:
        """The covariance (m, m) mm2 of what is new in a step: of the noise at rest and of the gauge's, and
        the variance beyond."""
        gauge = np.broadcast_to(self.gauge, self.sd.shape)[t]
        return self.steady[self.block[t]].fresh + np.outer(gauge, gauge) + np.diag(self._white[t])

    @cached_property
    def _white(self) -> Array:
        """The part (s, m) mm2 of that which is new in each step."""
        lasts = np.array([n.coding > 0 for n in self.steady])[self.block]
        return np.where(lasts[:, None], 0.0, self._added)

    @property
    def trace(self) -> float:
        """The sum of the variances in mm2 of all values that are data."""
        still = np.array([np.diag(n.static + n.fresh) for n in self.steady])[self.block]
        return float((self._added + still + np.square(self.gauge))[self.valid].sum())

    @cached_property
    def trace_of_square(self) -> float:
        """The sum of the squares in mm4 of all entries of the covariance N of the values that are data."""
        seen, total = self.valid.astype(float), 0.0
        for t in range(len(seen)):
            lasting = self._lasting(t)
            same = lasting + self._new(t)
            total += float((np.outer(seen[t], seen[t]) * same**2).sum())
            far, least = t + 1, 1e-6 * float((lasting**2).sum())
            while far < len(seen) and not self.first[far] and float((lasting**2).sum()) > least:
                lasting = self._later(far, lasting)
                total += 2 * float((np.outer(seen[far], seen[t]) * lasting**2).sum())
                far += 1
        return total

    def covariance_times(self, y: Array) -> Array:
        """The covariance N of the noise applied to fields y (k, s, m) mm; 0 where no data.

        x_t+n and x_t have the covariance of what lasts of x_t, which two passes over time sum up.
        """
        fields = np.moveaxis(np.where(self.valid, y, 0.0), 0, 2)  # (s, m, k)
        out, carried = np.zeros_like(fields), np.zeros(fields.shape[1:])
        for t, here in enumerate(fields):
            carried = np.zeros_like(carried) if self.first[t] else self._later(t, carried)
            now = self._lasting(t) @ here
            out[t] = carried + now + self._new(t) @ here
            carried = carried + now
        return np.moveaxis(np.where(self.valid[:, :, None], out + self._from_later(fields), 0.0), 2, 0)

    def _from_later(self, fields: Array) -> Array:
        """What the values of later steps add (s, m, k) to the covariance times fields (s, m, k)."""
        out, after = np.zeros_like(fields), np.zeros(fields.shape[1:])
        for t in range(len(fields) - 2, -1, -1):
            n = self.steady[self.block[t + 1]]
            after = after + fields[t + 1]
            back = self._onward[t + 1].T @ after if n.coding else n.rho[:, None] * after
            after = np.zeros_like(after) if self.first[t + 1] else back
            out[t] = self._lasting(t) @ after
        return out

    def innovations(self, y: Array) -> Array:
        """Independent values (..., n) of fields y (..., s, m); 0 where no data."""
        fields = y.reshape(-1, *self.valid.shape)  # (k, s, m): all modes of a film take half of its memory
        out, x = np.empty(fields.shape), np.zeros((fields.shape[2], len(fields)))
        for t, (turn, gain) in enumerate(zip(*self.gains, strict=True)):
            x = np.zeros_like(x) if self.first[t] else self._later(t, x)
            x = np.where(np.abs(x) > 1e-100, x, 0.0)  # of long ago; its squares would underflow
            new = turn @ (np.where(self.valid[t], fields[:, t], 0.0).T - x)
            x = x + gain @ new
            out[:, t] = new.T
        return out.reshape(*y.shape[:-2], self.valid.size)


_made: list[tuple[Targets, NDArray[np.bool_] | None, NoiseFilter]] = []  # the last ones; a fit asks for one


def noise_filter(targets: Targets, points: NDArray[np.bool_] | None) -> NoiseFilter:
    """The noise filter of targets, made once for an object, as every model fitted to it asks again."""
    for of_targets, mask, cached in _made:
        if of_targets is targets and _same(mask, points):
            return cached
    filtered = _filter_of(targets, points)
    _made.append((targets, points, filtered))
    del _made[:-KEPT]
    return filtered


def _same(a: NDArray[np.bool_] | None, b: NDArray[np.bool_] | None) -> bool:
    return a is b if a is None or b is None else np.array_equal(a, b)


def _filter_of(targets: Targets, points: NDArray[np.bool_] | None) -> NoiseFilter:
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
        pairs = [_steady(noise, components) for noise in models]
        steady, more = tuple(state for state, _ in pairs), np.array([extra for _, extra in pairs])
        sd = np.sqrt(sd**2 + more[targets.block if targets.noises else np.zeros_like(targets.block)])
    if len(steady) == 1:
        steady *= int(targets.block[-1]) + 1
    return NoiseFilter(components, valid, sd, steady, targets.block)


def _steady(noise: Noise, components: NDArray[np.int64]) -> tuple[Steady, Array]:
    """The noise at rest of components (m, 2), and what is added to each one's variance (m,) mm2 for the few
    frames that it was estimated from.

    The inverse of a covariance estimated from n frames is too large by (n - 2) / (n - m - 1) beyond what
    single variances are (Hartlap, Simon & Schneider 2007, doi 10.1051/0004-6361:20066170).
    """
    p, i = components.T
    flat, sd, frames = p * 3 + i, noise.sd[p, i], noise.frames
    inflation = (frames - 2) / max(frames - len(components) - 1, 1)
    correlation = shrunk(noise.correlation[np.ix_(flat, flat)], frames, i)
    within = inflation * correlation * np.outer(sd, sd)
    rho = np.clip(np.nan_to_num(noise.rho[p, i]), 0.0, 0.99)
    still = Steady(noise.lasting * within, (1 - noise.lasting) * within, rho, noise.coding_rho)
    return still, (inflation - 1) * sd**2


def shrunk(correlation: Array, frames: int, axis: NDArray[np.int64]) -> Array:
    """The correlation (m, m) estimated from `frames` frames, drawn by its own sampling error towards what all
    components of one axis (m,) share, and independence between axes.

    The weight is the ratio of the sampling variance (1 - r^2)^2 / n to the spread of the off-diagonal values
    about that target (Schaefer & Strimmer 2005, doi 10.2202/1544-6115.1175). Towards plain independence,
    markers that jitter together would lose a part of it, and their mean would be stated too small.

    >>> sample = np.array([[1.0, 0.3, 0.5], [0.3, 1.0, 0.4], [0.5, 0.4, 1.0]])
    >>> shrunk(sample, 1000, np.zeros(3, int)).round(3)
    array([[1.  , 0.31, 0.49],
           [0.31, 1.  , 0.4 ],
           [0.49, 0.4 , 1.  ]])
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
