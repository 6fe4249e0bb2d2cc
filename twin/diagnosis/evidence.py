"""Evidence of a signature in a whitened residual: attainable gain, Bayes factor, and mimicry.

Linear algebra only. z (n,) is a whitened residual and every column (n,) a whitened signature, per one
standard deviation of its parameter's prior, both apart from what was fitted (`apart`).
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from twin.targets import Array


def orthonormal(fitted: Array) -> Array:
    """An orthonormal basis (n, r) of the columns of fitted (n, f)."""
    if not fitted.shape[1]:
        return fitted
    lengths = np.linalg.norm(fitted, axis=0)
    scaled = fitted[:, lengths > 0] / lengths[lengths > 0]
    vectors, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(vectors[:, sizes > 1e-9 * sizes.max(initial=0.0)], float)


def apart(columns: Array, basis: Array) -> Array:
    """Columns (n, k), or one (n,), without their part along an orthonormal basis (n, r)."""
    return np.asarray(columns - basis @ (basis.T @ columns), float)


@dataclass(frozen=True, eq=False)
class Gram:
    """Products of a residual z (n,) and columns (n, k): S = columns' columns (k, k), b = columns' z (k,),
    z'z.

    >>> z, column = np.array([3.0, 4.0]), np.array([[0.0], [2.0]])
    >>> gram = Gram.of(z, column)
    >>> amplitude, fall = gram.attained(np.array([-5.0]), np.array([5.0]))
    >>> amplitude, fall  # z is best with 2 columns; chi2 falls by 16
    (array([2.]), 16.0)
    >>> round(gram.log_bayes(np.array([False])), 3)  # b^2 / (1 + S) - ln(1 + S) = 64 / 5 - ln 5
    11.191
    """

    S: Array
    b: Array
    zz: float

    @staticmethod
    def of(z: Array, columns: Array) -> "Gram":
        """Of a residual and columns, both apart from what was fitted."""
        return Gram(columns.T @ columns, columns.T @ z, float(z @ z))

    def attained(self, low: Array, high: Array) -> tuple[Array, float]:
        """The amplitudes (k,) between low and high that lower chi2 most, and by how much they do; none where
        a signature is not finite, as at a limit point.

        >>> Gram.of(np.ones(2), np.array([[np.inf], [1.0]])).attained(np.zeros(1), np.ones(1))
        (array([0.]), 0.0)
        """
        if not np.isfinite(self.S).all():
            return np.zeros(len(self.b)), 0.0
        sizes, turn = np.linalg.eigh(self.S)
        keep = sizes > 1e-10 * max(float(sizes.max(initial=0.0)), 1e-300)
        if not keep.any():
            return np.zeros(len(self.b)), 0.0
        root = np.sqrt(sizes[keep])[:, None] * turn[:, keep].T  # root' root = S, and root' right = b
        right = (turn[:, keep].T @ self.b) / np.sqrt(sizes[keep])
        inside = np.minimum(low, high - 1e-12), high
        x = scipy.optimize.lsq_linear(
            root, right, bounds=inside, method="bvls" if len(self.b) > 1 else "trf"
        ).x
        if len(self.b) == 1:
            x = np.clip(self.b / self.S[0], low, high)
        return np.asarray(x, float), max(float(2 * x @ self.b - x @ self.S @ x), 0.0)

    def log_bayes(self, one_sided: NDArray[np.bool_]) -> float:
        """2 ln B against no effect; see `log_bayes`."""
        return float(log_bayes(self.S, self.b, one_sided))


def log_bayes(S: Array, b: Array, one_sided: NDArray[np.bool_]) -> Array:
    """2 ln B (...) against no effect of S (..., k, k) and b (..., k), amplitudes a priori standard normal,
    those one-sided (..., k) half-normal: b' (I + S)^-1 b - ln det(I + S), and for a half-normal one the part
    of its posterior above null (one at a time)."""
    if not b.shape[-1]:
        return np.zeros(b.shape[:-1])
    factor = np.linalg.cholesky(np.eye(S.shape[-1]) + S)
    half = np.linalg.solve(factor, b[..., None])
    mean = np.linalg.solve(np.swapaxes(factor, -1, -2), half)[..., 0]
    sd = np.sqrt((np.linalg.inv(factor) ** 2).sum(axis=-2))
    above = np.log(2.0) + scipy.special.log_ndtr(np.clip(mean / sd, -30.0, None))
    size = 2 * np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    return np.asarray((half[..., 0] ** 2).sum(axis=-1) - size + 2 * (above * one_sided).sum(axis=-1))


def occam(amplitudes: Array, S: Array) -> float:
    """Occam factor of a fitted effect, its fall of deviance less its 2 ln B: a' S (I + S)^-1 a + ln det(I +
    S).

    amplitudes (k,): fitted ones in prior sds from the prior's mean; S (k, k): information on them, in the
    same unit, after all other fitted parameters (Laplace's approximation, as in Beck 2010, doi
    10.1002/stc.424).

    >>> round(occam(np.array([2.0]), np.array([[4.0]])), 3)  # 16 / 5 + ln 5
    4.809
    """
    if not len(amplitudes):
        return 0.0
    inner = np.eye(len(S)) + S
    return float(amplitudes @ S @ np.linalg.solve(inner, amplitudes) + np.linalg.slogdet(inner)[1])


def ceiling(signature: Array, others: Array) -> float:
    """The share (0 to 1) of a signature (n,) that combinations of other columns (n, k) mimic: cos2 of the
    angle between them.

    >>> round(ceiling(np.array([1.0, 1.0]), np.array([[1.0], [0.0]])), 6)
    0.5
    """
    size = float(signature @ signature)
    if size <= 0 or not others.shape[1]:
        return 0.0
    basis = orthonormal(others)
    return float(min(1.0, ((basis.T @ signature) ** 2).sum() / size))
