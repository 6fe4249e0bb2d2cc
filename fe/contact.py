"""Deformed surface positions -> the forces of a rigid plane on a surface, and their symmetric tangent.

A penalty of pressure type: every mm2 of the surface at rest is pushed out with k s(d), d the depth below the
plane, so that the answer converges as the mesh is refined. s(d) is max(d, 0) but for a parabola over SMOOTH
about the touch, so that the tangent is continuous, Newton's method quadratic, and derivatives to parameters
are there. The plane's forces have a potential; the tangent is symmetric.
"""

from copy import copy

import numpy as np

from fe.case import Case
from fe.element import Array, Integers, gauss, scatter

SMOOTH = 0.01  # mm
POINTS = 4  # of quadrature in each direction of a quadrilateral face: the edge of contact runs inside faces


class PlaneFaces:
    """The faces of a case's contact surface, but for those that touch its clamp; their areas are at rest."""

    def __init__(self, case: Case) -> None:
        contact = case.contact
        assert contact is not None
        element, faces = case.element, case.face_nodes(contact.surface)
        if case.clamp:
            faces = faces[~np.isin(faces, case.node_sets[case.clamp.nodes]).any(axis=1)]
        rule = (element.face_points, element.face_weights) if element.simplex else gauss(2, POINTS)
        self._N, slopes = element.on_face(rule[0])
        s, t = np.einsum("fai,qak->kfqi", case.nodes[faces], slopes, optimize=True)
        self._area = np.linalg.norm(np.cross(s, t), axis=-1) * rule[1]  # (f, q)
        self.faces, self._count = faces, len(case.nodes)
        self.normal = np.asarray(contact.normal, float) / np.linalg.norm(contact.normal)
        self._distance, self._stiffness = contact.distance, contact.stiffness

    def softer(self, factor: float) -> "PlaneFaces":
        """The same plane with `factor` of its stiffness."""
        other = copy(self)
        other._stiffness = factor * self._stiffness
        return other

    def depth(self, x: Array) -> Array:
        """Depth (f, q) mm below the plane at deformed positions x (n, 3) mm."""
        return np.asarray(self._distance - (x @ self.normal)[self.faces] @ self._N.T, float)

    def touches(self, x: Array) -> bool:
        """Whether the plane pushes at deformed positions x (n, 3) mm."""
        return bool((self.depth(x) > -SMOOTH / 2).any())

    def force(self, x: Array) -> Array:
        """Forces (n, 3) N of the plane on the nodes at deformed positions x (n, 3) mm."""
        d = np.clip(self.depth(x) + SMOOTH / 2, 0.0, None)
        pressure = self._stiffness * np.where(d < SMOOTH, d**2 / (2 * SMOOTH), d - SMOOTH / 2)
        push = scatter(self.faces, (self._area * pressure) @ self._N, self._count)
        return push[:, None] * self.normal

    def tangent(self, x: Array) -> tuple[Integers, Array]:
        """Degrees of freedom (g, 3 m) of the faces in contact and their matrices (g, 3 m, 3 m) N/mm, the
        derivative of minus their forces."""
        d = self.depth(x) + SMOOTH / 2
        touching = np.flatnonzero((d > 0).any(axis=1))
        slope = self._stiffness * np.clip(d[touching] / SMOOTH, 0.0, 1.0) * self._area[touching]
        along = np.einsum("gq,qa,qb->gab", slope, self._N, self._N, optimize=True)
        faces = self.faces[touching]
        size = 3 * faces.shape[1]
        K = np.einsum("gab,i,j->gaibj", along, self.normal, self.normal).reshape(len(faces), size, size)
        return (faces[:, :, None] * 3 + np.arange(3)).reshape(len(faces), size), K
