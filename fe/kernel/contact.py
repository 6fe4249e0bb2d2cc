"""Forces of a rigid obstacle on a surface, with friction, and their symmetric tangent.

Penalty of pressure type: every mm2 of the surface at rest is pushed out with k s(d), d the depth below the
obstacle's surface, so that the solution converges with the mesh. s(d) is max(d, 0), smoothed by a parabola
over SMOOTH about d = 0: the tangent is continuous, Newton's method converges quadratically, and derivatives
to parameters exist. The pressure forces have a potential; their tangent is symmetric and includes the
rotation of the normal on a round obstacle.

Coulomb friction with an elastic slip: the tangential traction is -k e with the same k, where e is the slip
from an anchor, limited to mu p / k (radial return). The anchor is the position of zero traction; it follows a
point that slides or is off the obstacle, and passes from one equilibrium to the next (`ObstacleFaces.after`).
A negative coefficient occurs only in the neighbours of a derivative at 0; friction is an odd function of it.
`ObstacleFaces.coupling` holds the unsymmetric part of the tangent: sliding friction, whose limit grows with
depth, and on a round obstacle the change of the slip direction.

An obstacle on a spring moves by w along it, where the spring balances all contact forces. w is found at every
state by Newton's method, so that forces depend on the state alone (static condensation). This adds the dyad
-(K a) (a K) / (k + a K a) to the tangent K, a being the spring's direction at every node.
"""

from copy import copy

import numpy as np

from fe.case import Case
from fe.element import Array, Flags, Integers, gauss, scatter
from fe.obstacles import Flat

SMOOTH = 0.01  # mm
POINTS = 4  # of quadrature in each direction of a quadrilateral face: the edge of contact runs inside faces
YIELDS = 60  # steps at most to where a spring balances: near the touch of a soft one each halves the way
SETTLED = 1e-12  # mm, a step that is the last


def off_the_clamp(case: Case, surface: str) -> Flags:
    """Flags (f,) of the faces of a surface that do not touch the clamp."""
    faces = case.face_nodes(surface)
    if case.clamp is None:
        return np.ones(len(faces), bool)
    return np.asarray(~np.isin(faces, case.node_sets[case.clamp.nodes]).any(axis=1))


class ObstacleFaces:
    """Faces of a case's contact surface, except those that touch the clamp; areas are those at rest.

    Private methods take positions relative to the displaced obstacle (`_relative`).
    """

    def __init__(self, case: Case) -> None:
        contact = case.contact
        assert contact is not None
        element, faces = case.element, case.face_nodes(contact.surface)[off_the_clamp(case, contact.surface)]
        rule = (element.face_points, element.face_weights) if element.simplex else gauss(2, POINTS)
        self._N, slopes = element.on_face(rule[0])
        s, t = np.einsum("fai,qak->kfqi", case.nodes[faces], slopes, optimize=True)
        self._area = np.linalg.norm(np.cross(s, t), axis=-1) * rule[1]  # (f, q)
        self.faces, self._count = faces, len(case.nodes)
        self._obstacle, self._stiffness, self._spring = contact.obstacle, contact.stiffness, contact.spring
        self.friction, self._sign = contact.friction, np.sign(contact.friction)
        self._slides: Flags | None = None  # where given, not by how far it has slipped
        self._last_yield: tuple[Array, float] | None = None  # what was last asked of `yielded`
        self._anchor = self._slip_positions(case.nodes) if contact.friction else np.zeros(3)  # (f, q, 3) mm

    def softer(self, factor: float) -> "ObstacleFaces":
        """The obstacle with its contact stiffness multiplied by `factor`."""
        softened = self._copy()
        softened._stiffness = factor * self._stiffness
        return softened

    def _copy(self) -> "ObstacleFaces":
        faces = copy(self)
        faces._last_yield = None
        return faces

    # -- where the obstacle is ------------------------------------------------------------------------------

    @property
    def _axis(self) -> Array:
        """Unit vector (3,) along the obstacle's spring."""
        assert self._spring is not None
        return np.asarray(self._spring.way, float) / np.linalg.norm(self._spring.way)

    def yielded(self, x: Array) -> float:
        """The displacement in mm of the obstacle along its spring at deformed positions x (n, 3) mm: where
        the spring's force k w balances that of the surface."""
        if self._spring is None:
            return 0.0
        if self._last_yield is None or not np.array_equal(self._last_yield[0], x):
            self._last_yield = x.copy(), self._balanced(self._spring.stiffness, x)
        return self._last_yield[1]

    def _balanced(self, stiffness: float, x: Array) -> float:
        w, a = 0.0, self._axis
        for _ in range(YIELDS):
            here = x - w * a
            push = float(self._force(here).sum(axis=0) @ a)
            step = -(stiffness * w + push) / (stiffness + self._by_displacement(here)[2])
            w += step
            if abs(step) < SETTLED:
                break
        return w

    def _by_displacement(self, x: Array) -> tuple[Array, Array, float]:
        """Derivatives of the contact forces by the obstacle's displacement, N/mm: column (3 n,) K a, row (3
        n,) a K, and the scalar a K a."""
        size = 3 * self._count
        a, column, row = np.tile(self._axis, self._count), np.zeros(size), np.zeros(size)
        for dofs, K in filter(None, (self._symmetric(x), self._unsymmetric(x))):
            column += scatter(dofs, K @ a[dofs][..., None], size)
            row += scatter(dofs, a[dofs][:, None] @ K, size)
        return column, row, max(float(a @ column), 0.0)

    def _relative(self, x: Array) -> Array:
        """Positions (n, 3) mm relative to the displaced obstacle, from deformed positions x (n, 3) mm."""
        return x if self._spring is None else x - self.yielded(x) * self._axis

    # -- forces ---------------------------------------------------------------------------------------------

    def depth(self, x: Array) -> Array:
        """Depth (f, q) mm below the obstacle's surface at deformed positions x (n, 3) mm."""
        return self._depth(self._relative(x))

    def touches(self, x: Array) -> bool:
        """True if the obstacle pushes at deformed positions x (n, 3) mm."""
        return bool((self.depth(x) > -SMOOTH / 2).any())

    def force(self, x: Array) -> Array:
        """Forces (n, 3) N of the obstacle on the nodes at deformed positions x (n, 3) mm."""
        return self._force(self._relative(x))

    def resultant(self, x: Array) -> Array:
        """Force (3,) N of the obstacle on the surface at deformed positions x (n, 3) mm."""
        return np.asarray(self.force(x).sum(axis=0))

    def _depth(self, x: Array) -> Array:
        o = self._obstacle
        if isinstance(o, Flat):
            return np.asarray(o.distance - (x @ o.out)[self.faces] @ self._N.T, float)
        return -o.height(self._places(x))

    def _force(self, x: Array) -> Array:
        pressure, obstacle = self._pressure(x), self._obstacle
        if isinstance(obstacle, Flat):
            push = scatter(self.faces, (self._area * pressure) @ self._N, self._count)
            force = push[:, None] * obstacle.out
        else:
            force = self._nodal((self._area * pressure)[..., None] * obstacle.normal(self._places(x)))
        if self.friction:
            drag = -self._sign * self._stiffness * self._area[..., None] * self._slip(x, pressure)[0]
            force += self._nodal(drag)
        return np.asarray(force)

    def _nodal(self, load: Array) -> Array:
        """Nodal forces (n, 3) N of point forces (f, q, 3) N."""
        nodal = np.einsum("fqi,qa->fai", load, self._N, optimize=True)
        return np.stack([scatter(self.faces, nodal[..., i], self._count) for i in range(3)], axis=1)

    def _pressure(self, x: Array) -> Array:
        """Pressure (f, q) MPa of the obstacle."""
        d = np.clip(self._depth(x) + SMOOTH / 2, 0.0, None)
        return np.asarray(self._stiffness * np.where(d < SMOOTH, d**2 / (2 * SMOOTH), d - SMOOTH / 2))

    # -- slip -----------------------------------------------------------------------------------------------

    def _places(self, x: Array) -> Array:
        """Places (f, q, 3) mm of the faces' points."""
        return np.asarray(np.einsum("fai,qa->fqi", x[self.faces], self._N, optimize=True))

    def _slip_positions(self, x: Array) -> Array:
        """Positions (f, q, 3) mm from which slip is measured: on a plane their tangential part."""
        place = self._places(x)
        if not isinstance(self._obstacle, Flat):
            return place
        normal = self._obstacle.out
        return np.asarray(place - (place @ normal)[..., None] * normal)

    def _slip_from_anchor(self, x: Array) -> Array:
        """Tangential displacement (f, q, 3) mm from the anchor."""
        slip = self._slip_positions(x) - self._anchor
        if isinstance(self._obstacle, Flat):
            return np.asarray(slip)
        normal = self._obstacle.normal(self._places(x))
        return np.asarray(slip - (slip * normal).sum(axis=-1, keepdims=True) * normal)

    def _slip(self, x: Array, pressure: Array) -> tuple[Array, Array, Array]:
        """Elastic slip (f, q, 3) mm, its direction (f, q, 3), and its share (f, q) of the slip from the
        anchor: below 1 where the surface slides."""
        slip = self._slip_from_anchor(x)
        length = np.linalg.norm(slip, axis=-1)
        limit = abs(self.friction) * pressure / self._stiffness
        slides = length > limit if self._slides is None else self._slides
        share = np.where(slides, limit / np.maximum(length, 1e-300), 1.0)
        return share[..., None] * slip, slip / np.maximum(length, 1e-300)[..., None], share

    def after(self, x: Array) -> "ObstacleFaces":
        """The obstacle with anchors updated to the equilibrium at deformed positions x (n, 3) mm."""
        if not self.friction:
            return self
        faces, x = self._copy(), self._relative(x)
        faces._anchor = self._slip_positions(x) - self._slip(x, self._pressure(x))[0]
        faces._slides = None
        return faces

    def slides(self, x: Array) -> Flags:
        """Flags (f, q) of points that slide at deformed positions x (n, 3) mm, or are off the obstacle."""
        x = self._relative(x)
        limit = abs(self.friction) * self._pressure(x) / self._stiffness
        return np.asarray(np.linalg.norm(self._slip_from_anchor(x), axis=-1) >= limit)

    def sliding(self, where: Flags) -> "ObstacleFaces":
        """The obstacle with prescribed flags (f, q) of sliding points: a point at rest lies on the kink
        between stick and slip, and both neighbours of a derivative must lie on one side."""
        faces = self._copy()
        faces._slides = where
        return faces

    # -- their derivative -----------------------------------------------------------------------------------

    def tangent(self, x: Array) -> tuple[Integers, Array]:
        """Degrees of freedom (g, 3 m) of the faces in contact and their matrices (g, 3 m, 3 m) N/mm: the
        symmetric part of the derivative of minus their forces; `coupling` is the rest."""
        return self._symmetric(self._relative(x))

    def coupling(self, x: Array) -> list[tuple[Integers, Array]]:
        """Unsymmetric matrices of friction and of a spring, in the form of `tangent`, to be added to it."""
        x = self._relative(x)
        skew = self._unsymmetric(x)
        parts = [] if skew is None else [skew]
        return parts if self._spring is None else [*parts, *self._condensed(x)]

    def change(self, x: Array, du: Array) -> Array:
        """The change (n, 3) N of the forces at deformed positions x (n, 3) mm along du (n, 3) mm."""
        out = np.zeros(du.size)
        for dofs, K in (self.tangent(x), *self.coupling(x)):
            out -= scatter(dofs, (K @ du.ravel()[dofs][..., None])[..., 0], du.size)
        return out.reshape(-1, 3)

    def along(self, x: Array, du: Array) -> Array:
        """Derivative (3,) of `resultant` at deformed positions x (n, 3) mm along du (n, 3) mm."""
        return np.asarray(self.change(x, du).sum(axis=0))

    def _symmetric(self, x: Array) -> tuple[Integers, Array]:
        touching, slope = self._slope(x)
        faces, obstacle = self.faces[touching], self._obstacle
        size = 3 * faces.shape[1]
        if isinstance(obstacle, Flat):
            along = np.einsum("gq,qa,qb->gab", slope, self._N, self._N, optimize=True)
            K = np.einsum("gab,i,j->gaibj", along, obstacle.out, obstacle.out).reshape(len(faces), size, size)
            if self.friction:
                K += self._friction_tangent(x, touching).reshape(K.shape)
        else:
            D = self._round_tangent(x, touching, slope)
            K = self._spread((D + np.swapaxes(D, 2, 3)) / 2)
        return self._dofs(touching), K

    def _dofs(self, touching: Integers) -> Integers:
        faces = self.faces[touching]
        return np.asarray((faces[:, :, None] * 3 + np.arange(3)).reshape(len(faces), 3 * faces.shape[1]))

    def _spread(self, D: Array) -> Array:
        """Face matrices (g, 3 m, 3 m) N/mm of point matrices (g, q, 3, 3) N/mm."""
        size = 3 * self._N.shape[1]
        return np.einsum("gqij,qa,qb->gaibj", D, self._N, self._N, optimize=True).reshape(-1, size, size)

    def _slope(self, x: Array) -> tuple[Integers, Array]:
        """Faces (g,) in contact, and the derivative (g, q) of pressure times area by depth, N/mm."""
        d = self._depth(x) + SMOOTH / 2
        touching = np.flatnonzero((d > 0).any(axis=1))
        return touching, self._stiffness * np.clip(d[touching] / SMOOTH, 0.0, 1.0) * self._area[touching]

    def _friction_tangent(self, x: Array, touching: Integers) -> Array:
        """Derivative (g, m, 3, m, 3) N/mm of minus the friction forces at fixed pressure."""
        assert isinstance(self._obstacle, Flat)
        pressure, normal = self._pressure(x), self._obstacle.out
        _, direction, share = (v[touching] for v in self._slip(x, pressure))
        plane = np.eye(3) - np.outer(normal, normal)
        turn = plane - (share < 1)[..., None, None] * direction[..., :, None] * direction[..., None, :]
        stiff = self._sign * self._stiffness * self._area[touching] * share * (pressure[touching] > 0)
        return np.einsum("gq,gqij,qa,qb->gaibj", stiff, turn, self._N, self._N, optimize=True)

    def _round_tangent(self, x: Array, touching: Integers, slope: Array) -> Array:
        """The derivative (g, q, 3, 3) N/mm of minus the forces at the points of the touching faces."""
        assert not isinstance(self._obstacle, Flat)
        place, pressure = self._places(x)[touching], self._pressure(x)
        n, bend, area = self._obstacle.normal(place), self._obstacle.bend(place), self._area[touching]
        D = slope[..., None, None] * n[..., :, None] * n[..., None, :]
        D -= (area * pressure[touching])[..., None, None] * bend
        if not self.friction:
            return np.asarray(D)
        _, slip_dir, share = (v[touching] for v in self._slip(x, pressure))
        slides, far = share < 1, place - self._anchor[touching]
        height = (far * n).sum(axis=-1)[..., None, None]
        turned = n + np.einsum("gqij,gqj->gqi", bend, far)
        E = np.eye(3) - n[..., :, None] * turned[..., None, :] - height * bend  # of the slip since the anchor
        E -= slides[..., None, None] * slip_dir[..., :, None] * (slip_dir[..., None, :] @ E)
        stiff = self._sign * self._stiffness * area * share * (pressure[touching] > 0)
        limit = self.friction * slope * slides
        return np.asarray(
            D + stiff[..., None, None] * E - limit[..., None, None] * slip_dir[..., :, None] * n[..., None, :]
        )

    def _unsymmetric(self, x: Array) -> tuple[Integers, Array] | None:
        """Unsymmetric part of the friction's tangent, None without one: on a plane the derivative by the
        pressure where the surface slides."""
        if not self.friction:
            return None
        touching, slope = self._slope(x)
        if not isinstance(self._obstacle, Flat):
            D = self._round_tangent(x, touching, slope)
            return self._dofs(touching), self._spread((D - np.swapaxes(D, 2, 3)) / 2)
        _, direction, share = (v[touching] for v in self._slip(x, self._pressure(x)))
        slides = share < 1
        if not (slides & (slope > 0)).any():
            return None
        faces = self.faces[touching]
        size, slope, out = 3 * faces.shape[1], -self.friction * slope * slides, self._obstacle.out
        C = np.einsum("gq,gqi,qa,qb,j->gaibj", slope, direction, self._N, self._N, out, optimize=True)
        return self._dofs(touching), C.reshape(len(faces), size, size)

    def _condensed(self, x: Array) -> list[tuple[Integers, Array]]:
        """Reduction of the tangent by the obstacle's spring: one matrix for all nodes in contact."""
        assert self._spring is not None
        column, row, firm = self._by_displacement(x)
        dofs = np.flatnonzero((column != 0) | (row != 0))
        C = -np.outer(column[dofs], row[dofs]) / (self._spring.stiffness + firm)
        return [(dofs[None], C[None])] if len(dofs) else []
