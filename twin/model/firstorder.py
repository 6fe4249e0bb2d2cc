"""First-order contributions to displacements: markers that slip on the structure, and perturbations of the
case."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fe import Solution, Variation
from fe.case import Case
from fe.mesh.points import interpolation
from twin.effects.protocol import Slip, Test
from twin.targets import Array

BESIDE = 0.1  # mm: how far from a marker its neighbour on the structure is taken


Known = dict[tuple[int, bytes], Array]


def slipped(
    test: Test, displacements: Callable[[Array], Array], *, rigid: bool = True, slopes: Known | None = None
) -> Array:
    """Displacements (.., s, p, 3) mm that a test's slips add; `displacements` (.., s, k, 3) mm gives the
    motion of undeformed points (k, 3) mm.

    A tag that sits s further along e is seen s (e + du/de) further. rigid: False leaves out e itself, as
    derivatives of the displacements want it. slopes: du/de by row and axis, kept between calls.
    """
    slopes = {} if slopes is None else slopes
    out = np.zeros((len(test.path.output), len(test.points), 3))
    for slip in test.slips:
        key = slip.row, slip.axis.tobytes()
        if key not in slopes:
            slopes[key] = _slope(test, slip, displacements)
        added = slip.size * _after(slip, test) * (slopes[key] + rigid * slip.axis)
        if added.ndim > 2 and out.ndim == 3:  # derivatives to several parameters
            out = np.zeros((len(added), *out.shape))
        out[..., slip.row, :] += added
    return out


def _slope(test: Test, slip: Slip, displacements: Callable[[Array], Array]) -> Array:
    """Derivative (.., s, 3) of the displacements along a slip's axis, per mm."""
    pair = beside(test.case, test.points[slip.row], slip.axis)
    u = displacements(pair)
    along = float((pair[1] - pair[0]) @ slip.axis) or 1.0
    return np.asarray((u[..., 1, :] - u[..., 0, :]) / along, float)


def _after(slip: Slip, test: Test) -> Array:
    """1 at the outputs (s, 1) after a slip, else 0."""
    return np.asarray(test.path.output >= slip.time, float)[:, None]


def beside(case: Case, point: Array, axis: Array) -> Array:
    """A point and its neighbour (2, 3) mm along an axis, or against it where the structure ends; the point
    twice where it ends both ways."""
    for sign in (1, -1):
        there = point + sign * BESIDE * axis
        try:
            interpolation(case, there[None])
        except ValueError:
            continue
        return np.stack([point, there])
    return np.stack([point, point])


# -- perturbations of the case, by courses of their own ------------------------------------------------------

@dataclass(frozen=True)
class Paced(Variation):
    """A parameter's direction by a `course` (s,) at every output."""

    course: Array


def directions(test: Test) -> list[Paced]:
    """The directions of a test's perturbations, 1 being what they are."""
    return [
        Paced((q.plus, test.path), (q.minus, test.path), 1.0, q.course)
        for q in test.perturbations
        if q.plus is not q.minus
    ]


def perturbed(test: Test, solution: Solution, points: Array) -> Array:
    """Displacements (s, k, 3) mm of undeformed points (k, 3) mm with a test's perturbations, whose
    `directions` are the last that were solved."""
    u, paths = solution.at(points), directions(test)
    if not paths:
        return u
    return np.asarray(u + paced(solution.variations_at(points)[-len(paths) :], paths).sum(axis=0), float)


def paced(rows: Array, variations: Sequence[Variation]) -> Array:
    """Derivatives (v, s, p, 3) along variations, times the courses of those that have one."""
    courses = [v.course if isinstance(v, Paced) else np.ones(rows.shape[1]) for v in variations]
    return rows * np.reshape(courses, (*rows.shape[:2], 1, 1))
