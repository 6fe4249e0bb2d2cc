"""Measures of the shape of a mesh's elements: Jacobian ratio, edge ratio, angles."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from fe.case import Case
from fe.element import Array, Element, Integers


@dataclass(frozen=True)
class Measure:
    """One measure of shape: its value (e,) for every element, and where it becomes poor."""

    name: str
    unit: str
    values: Array
    limit: float
    large: bool  # whether large values are the poor ones

    @property
    def poor(self) -> Integers:
        """The rows of the elements beyond the limit, the worst first."""
        order = np.argsort(-self.values if self.large else self.values, kind="stable")
        beyond = self.values[order] > self.limit if self.large else self.values[order] < self.limit
        return np.asarray(order[beyond], np.int64)

    @property
    def worst(self) -> int:
        """The row of the worst element."""
        return int(self.values.argmax() if self.large else self.values.argmin())


def quality(case: Case) -> tuple[Measure, ...]:
    """Ratio of Jacobians, ratio of edges, smallest and largest angle of the faces, of every element.

    The limits are those at which Abaqus/CAE warns by default (angles 10 and 160 degrees, edges 10), and 0.2
    for the Jacobian's smallest over its largest value at integration points and nodes.
    """
    X, kind = case.nodes[case.connectivity], case.element
    points = np.concatenate([kind.points, kind.local])
    J = np.linalg.det(np.einsum("eai,qaJ->eqiJ", X, kind.shape(points)[1], optimize=True))
    edges = np.stack([np.linalg.norm(X[:, a] - X[:, b], axis=1) for a, b in _edges(kind)], axis=1)
    angles = _angles(X, kind)
    return (
        Measure("Jacobian, smallest over largest", "", J.min(axis=1) / J.max(axis=1), 0.2, large=False),
        Measure("longest over shortest edge", "", edges.max(axis=1) / edges.min(axis=1), 10.0, large=True),
        Measure("smallest angle", "degrees", angles.min(axis=1), 10.0, large=False),
        Measure("largest angle", "degrees", angles.max(axis=1), 160.0, large=True),
    )


def _edges(kind: Element) -> list[tuple[int, int]]:
    """Edges of an element by their end corners: pairs of corners that two faces share."""
    faces = [set(face[list(kind.corners)].tolist()) for face in kind.faces]
    shared = {frozenset(a & b) for a, b in combinations(faces, 2)}
    return [(min(pair), max(pair)) for pair in sorted(shared, key=sorted) if len(pair) == 2]


def _angles(X: Array, kind: Element) -> Array:
    """The angles (e, k) at the corners of all faces, degrees."""
    angles = []
    for face in kind.faces:
        ring = face[list(kind.corners)]
        for before, here, after in zip(np.roll(ring, 1), ring, np.roll(ring, -1), strict=True):
            a, b = X[:, before] - X[:, here], X[:, after] - X[:, here]
            cosine = (a * b).sum(axis=1) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1))
            angles.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return np.stack(angles, axis=1)
