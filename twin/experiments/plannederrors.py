"""The errors of a planned film, from the errors of the present one; and the separation of two models where
the one, fitted anew, mimics the other.

Per value the noise is the same. What many values share (scale, placement of the tags, reference) is the same
error in both films: each such mode is carried over by how it depends on where its marker is.

The criterion is that of T-optimal experiments (Dette, Melas & Shpilev 2015, doi 10.1214/15-AOS1333): the
truth is one model, and what counts is the non-centrality that the best fit of the other leaves, here to first
order.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from twin.experiments.plannedfilms import Shown
from twin.judging.whitening import Whitener
from twin.targets import Array, Targets

TINY = 1e-9  # of a direction's information, beside which another is none


@dataclass(frozen=True)
class Rows:
    """Data as whitened values: difference (n,) of the truth from the mimic, slopes (n, d) of the mimic's
    parameters, shared (n, k) errors of the measurement that other rows have too, 1 sd each."""

    difference: Array
    slopes: Array
    shared: Array

    def gram(self, shared: int) -> tuple[Array, Array, float]:
        """The normal equations with k = `shared` shared errors, these rows' errors first: matrix (d + k, d +
        k), right side (d + k,), sum of squares."""
        more = np.zeros((len(self.difference), shared - self.shared.shape[1]))
        columns = np.hstack([self.slopes, self.shared, more])
        return columns.T @ columns, columns.T @ self.difference, float(self.difference @ self.difference)


def measured(truth: float, mimic: float, *, sd: float, column: int | None, parameters: int) -> Rows:
    """The row of a quantity that is measured by itself with an sd: its value in the truth and in the mimic,
    whose parameter number `column` of so many it is (None: the mimic cannot change it)."""
    slopes = np.zeros((1, parameters))
    if column is not None:
        slopes[0, column] = 1.0 / sd
    return Rows(np.array([(truth - mimic) / sd]), slopes, np.zeros((1, 0)))


def separation(rows: Sequence[Rows], *, low: Array, high: Array) -> float:
    """The distance in sds that is left of the truth where the mimic's parameters move by low to high (d,).

    The square root of the least |difference - slopes x - shared a|^2 + |a|^2 over x and a.

    >>> rows = Rows(np.array([3.0, 4.0]), np.array([[1.0], [0.0]]), np.zeros((2, 0)))
    >>> round(separation([rows], low=np.array([-9.0]), high=np.array([9.0])), 6)
    4.0
    """
    shared = max(r.shared.shape[1] for r in rows)
    grams = [r.gram(shared) for r in rows]
    matrix, right, total = (sum(g[k] for g in grams) for k in range(3))
    matrix, right = np.asarray(matrix, float), np.asarray(right, float)
    d = len(low)
    matrix[range(d, len(matrix)), range(d, len(matrix))] += 1.0
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    sizes, axes = np.linalg.eigh(matrix / np.outer(scale, scale))
    keep = sizes > TINY * max(float(sizes.max(initial=0.0)), 1e-300)
    root = (np.sqrt(sizes[keep])[:, None] * axes[:, keep].T) * scale  # root' root = matrix
    target = (axes[:, keep].T @ (right / scale)) / np.sqrt(sizes[keep])
    free = np.full(len(matrix) - d, np.inf)
    ends = np.append(low, -free), np.append(high, free)
    solution = scipy.optimize.lsq_linear(root, target, bounds=ends, method="bvls", tol=1e-12)
    distance2 = float(total) - float(target @ target) + 2.0 * float(solution.cost)
    return float(np.sqrt(max(distance2, 0.0)))


OTHER_AXIS = 2.0  # times the noise of the others has an axis that this film does not show


@dataclass(frozen=True)
class Outlook:
    """The known errors: targets with their whitener, and a model's displacements u (s, p, 3) mm in this
    film."""

    targets: Targets
    w: Whitener
    u: Array

    @cached_property
    def _alone(self) -> Whitener:
        """The whitener without shared modes, which rows state by themselves."""
        return replace(self.w, modes=self.w.modes[self.w.shared :], shared=0, names=())

    @cached_property
    def _modes(self) -> Array:
        """The whitened shared modes (k, n) of this film."""
        fields = np.zeros((self.w.shared, *self.u.shape))
        fields[:, :, self.w.components[:, 0], self.w.components[:, 1]] = self.w.modes[: self.w.shared]
        return self._alone.whiten(fields)

    def here(self, difference: Array, jacobian: Array) -> Rows:
        """The rows of this film: truth - mimic (s, p, 3) mm, and the mimic's derivatives (d, s, p, 3)."""
        slopes = self._alone.whiten(jacobian).T if len(jacobian) else np.zeros((self._modes.shape[1], 0))
        return Rows(self._alone.whiten(difference), slopes, self._modes.T)

    def ahead(self, truth: Shown, mimic: Shown, components: NDArray[np.int64]) -> Rows:
        """The rows of another film, at components (c, 2): point and axis. Points beyond those of this film
        are marks beside them, each with errors of its own like those of its nearest."""
        p, i = components.T
        near = self._nearest(truth, p)
        sd, old = self._sd(near, i, truth.interval), p < self.u.shape[1]
        gauge = truth.slope[:, p, i] * float(np.median(self.targets.pressure_error)) / sd
        shared = self._carried(truth, p, near, i)
        both = np.concatenate([np.where(old, shared, 0.0), np.where(old, 0.0, shared)])
        both = both[: len(shared)] if old.all() else both
        return Rows(
            _whitened((truth.u - mimic.u)[:, p, i] / sd, gauge),
            _whitened(mimic.jacobian[:, :, p, i] / sd, gauge).T,
            _whitened(both / sd, gauge).T,
        )

    def _nearest(self, truth: Shown, points: NDArray[np.int64]) -> NDArray[np.int64]:
        """The marker (c,) of this film that moves most like each point (c,)."""
        markers = np.unique(self.w.components[:, 0])
        away = np.linalg.norm(truth.u[:, points, None] - truth.u[:, None, markers], axis=(0, 3))
        return np.where(points < self.u.shape[1], points, markers[away.argmin(axis=1)])

    def _sd(self, point: NDArray[np.int64], axis: NDArray[np.int64], interval: float) -> Array:
        """The noise (c,) mm of a value among its neighbours in time: of an autoregression so much larger as
        their mean is less certain."""
        sd = np.median(self.w.sd, axis=0)
        between = float(np.median(np.diff(self.targets.time)))
        rho = np.clip(self.w.rho, 0.0, 0.99) ** (interval / between)
        sd = sd * np.sqrt((1 + rho) / (1 - rho))
        by_component = {(int(p), int(i)): x for (p, i), x in zip(self.w.components, sd, strict=True)}
        unseen = OTHER_AXIS * float(sd.mean())
        keys = zip(point.tolist(), axis.tolist(), strict=True)
        return np.array([by_component.get(key, unseen) for key in keys])

    def _carried(
        self, truth: Shown, p: NDArray[np.int64], near: NDArray[np.int64], axis: NDArray[np.int64]
    ) -> Array:
        """The shared modes (k, s, c) mm in another film; 0 on an axis that this film does not show."""
        row = {(int(a), int(b)): n for n, (a, b) in enumerate(self.w.components)}
        out = np.zeros((self.w.shared, len(truth.u), len(p)))
        for c in range(len(p)):
            n = row.get((int(near[c]), int(axis[c])))
            if n is not None:
                here, there = _place(self.u[:, near[c]]), _place(truth.u[:, p[c]])
                law = np.linalg.lstsq(here, self.w.modes[: self.w.shared, :, n].T, rcond=1e-8)[0]
                out[:, :, c] = (there @ law).T
        return out


def _place(u: Array) -> Array:
    """Functions (s, 6) of a marker's displacement (s, 3) mm that its shared errors follow."""
    x, z = u[:, 0] / 10.0, u[:, 2] / 10.0  # of the order of 1
    return np.stack([np.ones_like(x), x, z, x * x, x * z, z * z], axis=1)


def _whitened(y: Array, gauge: Array) -> Array:
    """Values (..., s c) of variance 1 of y (..., s, c) in sds, whose steps share a gauge error (s, c)."""
    size = (gauge**2).sum(axis=1, keepdims=True)
    direction = gauge / np.sqrt(np.maximum(size, 1e-300))
    along = (y * direction).sum(axis=-1, keepdims=True) * (1 - 1 / np.sqrt(1 + size))
    return np.asarray((y - along * direction).reshape(*y.shape[:-2], gauge.size), float)
