"""Forces of a rigid plane on a surface that touches it, with friction, and their symmetric tangent.

A penalty of pressure type: every mm2 of the surface at rest is pushed out with k s(d), d the depth below the
plane, so that the answer converges as the mesh is refined. s(d) is max(d, 0) but for a parabola over SMOOTH
about the touch, so that the tangent is continuous, Newton's method quadratic, and derivatives to parameters
are there. The plane's forces have a potential; the tangent is symmetric.

Friction is Coulomb's, elastic below the limit: the traction along the plane is -k e, with the same k, where e
is the slip since the anchor, cut to mu p / k (radial return). An anchor is where a point would be without
traction; it follows where the point slides or is off the plane, and is carried from one equilibrium to the
next (`PlaneFaces.after`). Below 0, where only neighbouring problems of a derivative at 0 are, friction is
odd in its coefficient. As the limit is a pressure too, the answer converges with the mesh. What sliding
adds to the tangent, the limit's change with depth, is not symmetric: it is apart (`PlaneFaces.coupling`).
"""

from copy import copy

import numpy as np

from fe.case import Case
from fe.element import Array, Flags, Integers, gauss, scatter

SMOOTH = 0.01  # mm
POINTS = 4  # of quadrature in each direction of a quadrilateral face: the edge of contact runs inside faces


def off_the_clamp(case: Case, surface: str) -> Flags:
    """Which faces (f,) of a surface do not touch the clamp."""
    faces = case.face_nodes(surface)
    if case.clamp is None:
        return np.ones(len(faces), bool)
    return np.asarray(~np.isin(faces, case.node_sets[case.clamp.nodes]).any(axis=1))


class PlaneFaces:
    """The faces of a case's contact surface, but for those that touch its clamp; their areas are at rest."""

    def __init__(self, case: Case) -> None:
        contact = case.contact
        assert contact is not None
        element, faces = case.element, case.face_nodes(contact.surface)[off_the_clamp(case, contact.surface)]
        rule = (element.face_points, element.face_weights) if element.simplex else gauss(2, POINTS)
        self._N, slopes = element.on_face(rule[0])
        s, t = np.einsum("fai,qak->kfqi", case.nodes[faces], slopes, optimize=True)
        self._area = np.linalg.norm(np.cross(s, t), axis=-1) * rule[1]  # (f, q)
        self.faces, self._count = faces, len(case.nodes)
        self.normal = np.asarray(contact.normal, float) / np.linalg.norm(contact.normal)
        self._distance, self._stiffness = contact.distance, contact.stiffness
        self.friction, self._sign = contact.friction, np.sign(contact.friction)
        self._slides: Flags | None = None  # where given, not by how far it has slipped
        self._anchor = self._along(case.nodes) if contact.friction else np.zeros(3)  # (f, q, 3) mm

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
        pressure = self._pressure(x)
        push = scatter(self.faces, (self._area * pressure) @ self._N, self._count)
        force = push[:, None] * self.normal
        if self.friction:
            drag = -self._sign * self._stiffness * self._area[..., None] * self._slip(x, pressure)[0]
            nodal = np.einsum("fqi,qa->fai", drag, self._N, optimize=True)
            force += np.stack([scatter(self.faces, nodal[..., i], self._count) for i in range(3)], axis=1)
        return np.asarray(force)

    def _pressure(self, x: Array) -> Array:
        """Pressure (f, q) MPa of the plane at deformed positions x (n, 3) mm."""
        d = np.clip(self.depth(x) + SMOOTH / 2, 0.0, None)
        return np.asarray(self._stiffness * np.where(d < SMOOTH, d**2 / (2 * SMOOTH), d - SMOOTH / 2))

    def _along(self, x: Array) -> Array:
        """Places (f, q, 3) mm along the plane at deformed positions x (n, 3) mm."""
        place = np.einsum("fai,qa->fqi", x[self.faces], self._N, optimize=True)
        return np.asarray(place - (place @ self.normal)[..., None] * self.normal)

    def _slip(self, x: Array, pressure: Array) -> tuple[Array, Array, Array]:
        """The elastic slip (f, q, 3) mm, its direction, and its share (f, q) of the slip since the anchor:
        below 1 where the surface slides."""
        slip = self._along(x) - self._anchor
        length = np.linalg.norm(slip, axis=-1)
        limit = abs(self.friction) * pressure / self._stiffness
        slides = length > limit if self._slides is None else self._slides
        share = np.where(slides, limit / np.maximum(length, 1e-300), 1.0)
        return share[..., None] * slip, slip / np.maximum(length, 1e-300)[..., None], share

    def after(self, x: Array) -> "PlaneFaces":
        """The plane as it is met from the equilibrium at deformed positions x (n, 3) mm on."""
        if not self.friction:
            return self
        other = copy(self)
        other._anchor = self._along(x) - self._slip(x, self._pressure(x))[0]
        other._slides = None
        return other

    def slides(self, x: Array) -> Flags:
        """Where (f, q) the surface slides at deformed positions x (n, 3) mm, or is off the plane."""
        limit = abs(self.friction) * self._pressure(x) / self._stiffness
        return np.asarray(np.linalg.norm(self._along(x) - self._anchor, axis=-1) >= limit)

    def sliding(self, where: Flags) -> "PlaneFaces":
        """The same plane, on which the surface slides there (f, q) and nowhere else: what is held lies on the
        kink between stick and slip, and neighbours of a derivative must be on one side of it."""
        other = copy(self)
        other._slides = where
        return other

    def tangent(self, x: Array) -> tuple[Integers, Array]:
        """Degrees of freedom (g, 3 m) of the faces in contact and their matrices (g, 3 m, 3 m) N/mm, the
        derivative of minus their forces but for `coupling`."""
        touching, slope = self._slope(x)
        along = np.einsum("gq,qa,qb->gab", slope, self._N, self._N, optimize=True)
        faces = self.faces[touching]
        size = 3 * faces.shape[1]
        K = np.einsum("gab,i,j->gaibj", along, self.normal, self.normal).reshape(len(faces), size, size)
        if self.friction:
            K += self._dragged(x, touching).reshape(K.shape)
        return (faces[:, :, None] * 3 + np.arange(3)).reshape(len(faces), size), K

    def _slope(self, x: Array) -> tuple[Integers, Array]:
        """The faces (g,) in contact, and their pressures' derivative (g, q) to depth times area, N/mm."""
        d = self.depth(x) + SMOOTH / 2
        touching = np.flatnonzero((d > 0).any(axis=1))
        return touching, self._stiffness * np.clip(d[touching] / SMOOTH, 0.0, 1.0) * self._area[touching]

    def _dragged(self, x: Array, touching: Integers) -> Array:
        """The derivative (g, m, 3, m, 3) N/mm of minus the touching faces' friction at fixed pressure."""
        pressure = self._pressure(x)
        _, way, share = (v[touching] for v in self._slip(x, pressure))
        plane = np.eye(3) - np.outer(self.normal, self.normal)
        turn = plane - (share < 1)[..., None, None] * way[..., :, None] * way[..., None, :]
        stiff = self._sign * self._stiffness * self._area[touching] * share * (pressure[touching] > 0)
        return np.einsum("gq,gqij,qa,qb->gaibj", stiff, turn, self._N, self._N, optimize=True)

    def coupling(self, x: Array) -> tuple[Integers, Array] | None:
        """As `tangent`, what sliding adds to it: minus the friction's derivative to pressure; None where
        nothing slides."""
        if not self.friction:
            return None
        touching, slope = self._slope(x)
        _, way, share = (v[touching] for v in self._slip(x, self._pressure(x)))
        slides = share < 1
        if not (slides & (slope > 0)).any():
            return None
        faces = self.faces[touching]
        size, slope = 3 * faces.shape[1], -self.friction * slope * slides
        C = np.einsum("gq,gqi,qa,qb,j->gaibj", slope, way, self._N, self._N, self.normal, optimize=True)
        dofs = (faces[:, :, None] * 3 + np.arange(3)).reshape(len(faces), size)
        return dofs, C.reshape(len(faces), size, size)
