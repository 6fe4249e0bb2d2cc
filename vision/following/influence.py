"""Influence of the quarters of a patch on its centre: glare, cover or the edge of a shadow on a mark.

Such a thing pulls the fit aside and leaves a residual that noise does not explain. Its pull shows when a
quarter of the patch is left out: the centre then moves by more than noise moves it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.following.registration import Templates

# Times the mark's usual strength; 0.05 % of drawn marks of 20 to 60 px with nothing on them reach it.
UNEVEN = 6.0
ALIKE = 3.0  # a mark's usual strength is at most so many times that of all marks
# A place is given up where the two estimates differ by so much, and the sd is not small: nineteen of twenty
# marks of which a strip covers 3 to 15 %, one of five with glare or the edge of a shadow. Of strips that pass
# the lower of the two shows little: with the geometric mean they have pulls of 1.7
# (docs/records/marker-accuracy.md).
APART, SMALL_PX = 3.0, 0.1


@dataclass(frozen=True)
class Quarters:
    """Linear maps from the sums (40,) over the quarters of a patch to moves of its centre, local units."""

    without: Array  # (p,8,40) centre of the whole patch minus that without a quarter, two rows a quarter
    within: Array  # (p,8,40) what the residual of a quarter moves the centre of the whole patch by
    weight: Array  # (p,4,2,2) inverse covariance of the former for noise of unit variance per point


def quarters(reference: Templates) -> Quarters:
    """The linear maps of reference patches, exact for small moves.

    J is the design (warp, contrast, brightness), M_q = J_q'J_q that of a quarter, and r_q its residual. The
    fit without the quarter differs by (J'J - M_q)^-1 J_q'r_q, with the covariance (J'J - M_q)^-1 - (J'J)^-1
    (Cook & Weisberg 1982, Residuals and Influence in Regression).
    """
    points = reference.grid.shape[1]
    information = np.linalg.inv(reference.covariance)
    constant = np.full((*reference.grey.shape, 1), points**-0.5)
    design = np.concatenate([reference.step @ information, reference.grey[..., None], constant], axis=2)
    quarter = _quarter_of(points)
    normal = np.stack([_square(design[:, quarter == q]) for q in range(4)], axis=1)  # M_q
    covariance, covariance_without = _covariances(normal)
    to_columns = np.zeros((len(design), 10, 10))  # from sums with `step`, grey and 1 to J'r
    to_columns[:, :8, :8], to_columns[:, 8, 8], to_columns[:, 9, 9] = information, 1.0, points**-0.5
    residual = np.eye(4)[:, None, :, None] * np.eye(10)[:, None] - (normal @ covariance)[:, :, :, None, :]
    residual = np.einsum("pqirj,pjk->pqirk", residual, to_columns).reshape(len(design), 4, 10, 40)
    return Quarters(
        (covariance_without @ residual)[:, :, [2, 5]].reshape(-1, 8, 40),
        (covariance @ residual)[:, :, [2, 5]].reshape(-1, 8, 40),
        np.asarray(np.linalg.inv((covariance_without - covariance)[:, :, [[2], [5]], [[2, 5]]])),
    )


def lean(maps: Quarters, rows: NDArray[np.intp], sums: Array, linear: Array) -> Array:
    """Strength and variance px2 (m,2) of what lies unevenly on some marks.

    rows: (m,) of the patches.   sums: (m,4,10) from `register_quarters`.   linear: (m,2,2) px per local unit.

    Strength is the largest squared move of the centre without a quarter, over its variance for noise of unit
    variance. The variance sums the squares over the quarters, as the jackknife does; it is the geometric mean
    of that with and without the leverage of each: the one states too much, the other too little. Where they
    are far apart it is the larger, and inf where it would not be small.
    """
    stacked = sums.reshape(len(rows), 40, 1)
    without, within = ((take[rows] @ stacked).reshape(-1, 4, 2, 1) for take in (maps.without, maps.within))
    return _leaning(without, within, maps.weight[rows], linear)


def lean_of(design: Array, residual: Array, linear: Array) -> Array:
    """Strength and variance (2,) for a single fit, as in `lean`.

    design: (n,k), its columns 2 and 5 are the centre's.   residual: (n,).   linear: (2,2) px per local unit.
    """
    quarter = _quarter_of(len(design))
    normal = np.stack([design[quarter == q].T @ design[quarter == q] for q in range(4)])
    covariance, covariance_without = (each[0] for each in _covariances(normal[None]))
    pull = np.stack([design[quarter == q].T @ residual[quarter == q] for q in range(4)])[..., None]
    without, within = (covariance_without @ pull)[:, [2, 5]], (covariance @ pull)[:, [2, 5]]
    weight = np.linalg.inv((covariance_without - covariance)[:, [[2], [5]], [[2, 5]]])
    return np.asarray(_leaning(without[None], within[None], weight[None], linear[None])[0])


def _covariances(normal: Array) -> tuple[Array, Array]:
    """(J'J)^-1 (p,1,k,k) and, without each quarter, (J'J - M_q)^-1 (p,4,k,k), from M_q (p,4,k,k)."""
    total = normal.sum(axis=1)[:, None]
    return np.linalg.inv(total), np.linalg.inv(total - normal)


def _leaning(without: Array, within: Array, weight: Array, linear: Array) -> Array:
    """`lean` from the moves (m,4,2,1) of the centres without a quarter, and by its residual."""
    strength = (np.swapaxes(without, 2, 3) @ weight @ without)[..., 0, 0].max(axis=1)
    above, below = (0.5 * np.sum((linear[:, None] @ move) ** 2, axis=(1, 2, 3)) for move in (without, within))
    middle, apart = np.sqrt(above * below), above > APART**2 * below
    small = np.where(apart, above, middle)
    return np.stack([strength, np.where(apart & (middle > SMALL_PX**2), np.inf, small)], axis=1)


def _quarter_of(points: int) -> NDArray[np.intp]:
    """Quarter (n,) of each point of a square patch."""
    side = round(float(np.sqrt(points)))
    low = (np.arange(side) >= side // 2).astype(np.intp)
    return np.asarray((2 * low[:, None] + low[None]).ravel())


def extra_variance(leaning: Array, plain: NDArray[np.bool_]) -> Array:
    """Variance (t,p) px2 that the centres have more: 0 where the residual is usual, inf for one to give up.

    leaning: (t,p,2) from `lean`.   plain: (t,p) whether the mark was registered.

    Usual is the mark's median over the film, unless that is far above the other marks'.
    """
    strength = leaning[..., 0]
    both = zip(strength.T, plain.T, strict=True)
    usual = np.array([np.median(x[s]) if s.any() else np.nan for x, s in both])
    most = ALIKE * np.nanmedian(usual) if plain.any() else np.inf
    uneven = plain & (strength > UNEVEN * np.fmin(usual, most))
    return np.where(uneven, leaning[..., 1], 0.0)


def _square(design: Array) -> Array:
    return np.asarray(np.swapaxes(design, 1, 2) @ design)
