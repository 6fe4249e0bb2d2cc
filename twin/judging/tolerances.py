"""Dimensions that no camera sees, and how much of a fit's intervals comes from their tolerances."""

from collections.abc import Sequence

import numpy as np

from twin.judging.whitening import Whitener
from twin.model.discretisation import WALL
from twin.targets import Array

MUCH = 0.1  # of the variance of a parameter, from which on a dimension is named


def leaning(w: Whitener, jacobian: Array, names: Sequence[str]) -> list[tuple[str, str, float]]:
    """Dimension, parameter and the share of the parameter's variance that comes from the dimension's
    tolerance, the largest of each dimension, where it is MUCH; largest first.

    jacobian (f, s, p, 3): derivatives by the fitted parameters of these names (f,). The variance of a
    generalised least-squares fit is the sum of what each independent error of 1 sd moves it by, squared.
    """
    rows = np.flatnonzero(w.of_walls)
    if not len(rows) or not len(jacobian):
        return []
    columns = w.whiten(jacobian)
    covariance = np.linalg.pinv(columns @ columns.T, rcond=1e-12, hermitian=True)
    moved = covariance @ columns @ w.rewhitened(w.mode_innovations[rows]).T  # (f, d)
    share = moved**2 / np.maximum(np.diag(covariance), 1e-300)[:, None]
    worst = share.argmax(axis=0)
    found = [(w.names[k].removeprefix(WALL), names[f], float(share[f, d]))
             for d, (k, f) in enumerate(zip(rows, worst, strict=True)) if share[f, d] > MUCH]  # fmt: skip
    return sorted(found, key=lambda row: -row[2])


def leaning_in_words(rows: Sequence[tuple[str, str, float]]) -> str:
    """A sentence on the dimensions that a result leans on; nothing where it leans on none.

    >>> leaning_in_words([("bottom_wall_mm", "C10", 0.414)])
    'It leans on dimensions that no camera sees: 41 % of the variance of C10 is from bottom_wall_mm.'
    """
    if not rows:
        return ""
    clauses = [f"{100 * share:.0f} % of the variance of {name} is from {wall}" for wall, name, share in rows]
    listed = " and ".join(filter(None, [", ".join(clauses[:-1]), clauses[-1]]))
    return f"It leans on dimensions that no camera sees: {listed}."
