"""Separation of two models where the one, fitted anew, mimics the other.

The criterion of T-optimal experiments (Dette, Melas & Shpilev 2015, doi 10.1214/15-AOS1333): the truth is one
model, and what counts is the non-centrality that the best fit of the other leaves, here to first order.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from twin.targets import Array

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
    solution = lsq_linear(root, target, bounds=ends, method="bvls", tol=1e-12)
    distance2 = float(total) - float(target @ target) + 2.0 * float(solution.cost)
    return float(np.sqrt(max(distance2, 0.0)))
