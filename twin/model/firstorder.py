"""First-order contributions to displacements: markers that slip on the structure, and perturbations of the
case."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fe import Solution, Variation
from fe.case import Case
from fe.element import Integers
from fe.mesh.points import interpolation, nearest
from twin.effects.protocol import Slip, Test
from twin.targets import Array, Targets

BESIDE = 0.1  # mm: how far from a marker its neighbour on the structure is taken
PATCH_MM = 0.5  # mm: how far from one off the surface those are whose turn it follows
NUDGE_MM = 1e-4  # of these points, for differencing that turn
ALWAYS = -np.inf  # s: since when a marker stands off the surface


Field = Callable[[Array], Array]
Known = dict[tuple[int, bool, bytes], Array]


def standoffs(targets: Targets) -> tuple[Slip, ...]:
    """The slips of the markers that targets have off the surface."""
    every = [(row, np.array(p.off)) for row, p in enumerate(targets.points) if p.off is not None]
    return tuple(
        Slip(row, ALWAYS, size, off / size, turns=True)
        for row, off in every
        for size in [float(np.linalg.norm(off))]
    )


def slipped(
    test: Test, displacements: Field, *, motion: Field | None = None, slopes: Known | None = None
) -> Array:
    """Displacements (.., s, p, 3) mm that a test's slips add; `displacements` (.., s, k, 3) mm gives the
    motion of undeformed points (k, 3) mm.

    A tag that sits s further along e is seen s (e + du/de) further; one that stands off the surface, by s e,
    is seen s R e off it. motion: where `displacements` are derivatives, those that they are of; e itself is
    then left out. slopes: du/de, or (R - 1) e, by row and axis, kept between calls.
    """
    slopes = {} if slopes is None else slopes
    out = np.zeros((len(test.path.output), len(test.points), 3))
    for slip in test.slips:
        key = slip.row, slip.turns, slip.axis.tobytes()
        if key not in slopes:
            way = _turn if slip.turns else _slope
            slopes[key] = way(test, slip, displacements, motion)
        added = slip.size * _after(slip, test) * (slopes[key] + (motion is None) * slip.axis)
        if added.ndim > 2 and out.ndim == 3:  # derivatives to several parameters
            out = np.zeros((len(added), *out.shape))
        out[..., slip.row, :] += added
    return out


@dataclass(frozen=True)
class MarkerPoints:
    """Points whose motion tells that of markers: their own material points (p, 3) mm first, and three for
    each marker that stands off the surface, by `slips`."""

    points: Array
    slips: tuple[Slip, ...]

    @staticmethod
    def of(targets: Targets, case: Case, rows: Integers) -> "MarkerPoints":
        """Those of rows of the targets."""
        points = targets.places(case.position)[rows]
        at = {int(row): k for k, row in enumerate(rows)}
        slips = tuple(replace(s, row=at[s.row]) for s in standoffs(targets) if s.row in at)
        patches = [patch(case, points[s.row], s.axis) for s in slips]
        return MarkerPoints(np.concatenate([points, *patches]), slips)

    def seen(self, u: Array) -> Array:
        """Displacements (s, p, 3) mm of the markers, of those (s, k, 3) mm of the points."""
        count = len(self.points) - 3 * len(self.slips)
        out = u[:, :count].copy()
        for k, slip in enumerate(self.slips):
            three = slice(count + 3 * k, count + 3 * k + 3)
            out[:, slip.row] += slip.size * swung(slip.axis, self.points[three], u[:, three])
        return out


def _turn(test: Test, slip: Slip, displacements: Field, motion: Field | None) -> Array:
    """(R - 1) e (.., s, 3) of a slip's axis e, R being the turn of the surface there; its derivative where
    `displacements` are those of `motion`."""
    x = patch(test.case, test.points[slip.row], slip.axis)
    if motion is None:
        return swung(slip.axis, x, displacements(x))
    u, du = motion(x), displacements(x)
    h = NUDGE_MM / max(float(np.abs(du).max()), NUDGE_MM)
    return np.asarray((swung(slip.axis, x, u + h * du) - swung(slip.axis, x, u - h * du)) / (2 * h), float)


def swung(axis: Array, x: Array, u: Array) -> Array:
    """(R - 1) e (.., 3) of an axis e (3,), where three points x (3, 3) mm of a surface that it stands on move
    by u (.., 3, 3) mm: R turns the triad of x to that of x + u.

    >>> x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> swung(np.array([0.0, 0, 1]), x, np.array([[0.0, 0, 0], [-1, 0, -1], [0, 0, 0]]))
    array([ 1.,  0., -1.])
    """
    return np.asarray(np.einsum("...ki,k->...i", _triad(x + u), _triad(x) @ axis) - axis, float)


def _triad(x: Array) -> Array:
    """Unit vectors (.., 3, 3) of the first of three points (.., 3, 3): to the second, across, and up."""
    a, b = x[..., 1, :] - x[..., 0, :], x[..., 2, :] - x[..., 0, :]
    up = np.cross(a, b)
    rows = np.stack([a, np.cross(up, a), up], axis=-2)
    return np.asarray(rows / np.linalg.norm(rows, axis=-1, keepdims=True), float)


def patch(case: Case, point: Array, axis: Array) -> Array:
    """A point of the surface and two neighbours (3, 3) mm across an axis (3,) that stands on it there."""
    first = np.eye(3)[int(np.abs(axis).argmin())]
    out = [nearest(case, point)]
    for way in (np.cross(axis, first), np.cross(axis, np.cross(axis, first))):
        ways = [nearest(case, point + sign * PATCH_MM * way) for sign in (1, -1)]
        out.append(max(ways, key=lambda x: abs(float((x - out[0]) @ way))))
    return np.array(out)


def _slope(test: Test, slip: Slip, displacements: Field, _motion: Field | None) -> Array:
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
