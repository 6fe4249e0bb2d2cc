"""Material points that are known by where they are seen at rest, as the model sags there.

A marker is seen at P = X + u(X) at rest; X is on the body that is free of stress. Its displacements are those
of X, which moves by -du(X) where a parameter changes the sag.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fe.mesh.points import nearest
from twin.effects.protocol import Test
from twin.targets import Array

Field = Callable[[Array], Array]
NONE_MM = 1e-3  # a sag below it moves no material point that anything could tell
TURNS = 4  # to the point whose sag leads to where it is seen: each leaves a strain of the step before
BESIDE = 0.25  # mm: how far from a point its neighbours are taken


def material_points(test: Test, displacements: Field) -> Array:
    """The material points (m, 3) mm of a test's moving ones; `displacements` (s, k, 3) mm gives the motion of
    points (k, 3)."""
    points = test.points[test.moving]
    if test.rest is None:
        return points
    seen, rows = test.rest.places[test.moving], _rows(test)
    if np.abs(displacements(points)[test.rest.steps][:, rows]).max(initial=0.0) < NONE_MM:
        return points
    points = points.copy()
    for _ in range(TURNS):
        sag = displacements(points)[test.rest.steps].mean(axis=0)
        for p in rows:
            x, _, z = seen[p] - sag[p]
            points[p] = nearest(test.case, np.array([x, points[p, 1], z]))
    return points


def moved_along(test: Test, points: Array, displacements: Field, derivatives: Array) -> Array:
    """What derivatives (v, s, m, 3) of displacements at material points (m, 3) gain as these points move by
    the derivative of the sag."""
    if test.rest is None or np.array_equal(points, test.points[test.moving]):
        return derivatives
    rows, out = _rows(test), derivatives.copy()
    sag = derivatives[:, test.rest.steps].mean(axis=1)
    for axis in (0, 2):
        way = BESIDE * np.eye(3)[axis]
        ends = [np.array([nearest(test.case, x + side * way) for x in points[rows]]) for side in (1, -1)]
        apart = (ends[0] - ends[1])[:, axis]
        slope = (displacements(ends[0]) - displacements(ends[1])) / np.where(apart, apart, np.inf)[:, None]
        out[:, :, rows] -= slope * sag[:, None, rows, axis, None]
    return out


def _rows(test: Test) -> NDArray[np.intp]:
    assert test.rest is not None
    return np.flatnonzero(np.isfinite(test.rest.places[test.moving, 0]))
