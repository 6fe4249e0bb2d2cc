"""What perturbs a test to first order, by a course of its own: what it adds, and its derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fe import Solution, Variation
from twin.effects.protocol import Test
from twin.targets import Array


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
    u, own = solution.at(points), directions(test)
    if not own:
        return u
    return np.asarray(u + paced(solution.variations_at(points)[-len(own) :], own).sum(axis=0), float)


def paced(rows: Array, variations: Sequence[Variation]) -> Array:
    """Derivatives (v, s, p, 3) along variations, times the courses of those that have one."""
    courses = [v.course if isinstance(v, Paced) else np.ones(rows.shape[1]) for v in variations]
    return rows * np.reshape(courses, (*rows.shape[:2], 1, 1))
