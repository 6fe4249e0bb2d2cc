"""Forces of a rigid obstacle on a surface that touches it, with friction, and their symmetric tangent.

A penalty of pressure type: every mm2 of the surface at rest is pushed out with k s(d), d the depth below the
obstacle's surface, so that the answer converges as the mesh is refined. s(d) is max(d, 0) but for a parabola
over SMOOTH about the touch, so that the tangent is continuous, Newton's method quadratic, and derivatives to
parameters are there. The pressure's forces have a potential; their tangent is symmetric, on a round obstacle
with the turn of the normal in it.

Friction is Coulomb's, elastic below the limit: the traction along the surface is -k e, with the same k, where
e is the slip since the anchor, cut to mu p / k (radial return). An anchor is where a point would be without
traction; it follows where the point slides or is off the obstacle, and is carried from one equilibrium to the
next (`ObstacleFaces.after`). Below 0, where only neighbouring problems of a derivative at 0 are, friction is
odd in its coefficient. As the limit is a pressure too, the answer converges with the mesh. What of the
tangent is not symmetric is apart (`ObstacleFaces.coupling`): what sliding adds, as its limit changes with
depth, and on a round obstacle the turn of the slip.

An obstacle on a spring is displaced by w along it, at which the spring balances all of its forces: w is found
at every state by Newton's method, so that forces depend on the state alone (static condensation). That adds
to the tangent K the product of two vectors, -(K a) (a K) / (k + a K a), a the spring's way at every node.
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
    """Which faces (f,) of a surface do not touch the clamp."""
    faces = case.face_nodes(surface)
    if case.clamp is None:
        return np.ones(len(faces), bool)
    return np.asarray(~np.isin(faces, case.node_sets[case.clamp.nodes]).any(axis=1))


class ObstacleFaces:
    """The faces of a case's contact surface, but for those that touch its clamp; their areas are at rest.

    What begins with an underscore takes positions relative to an obstacle that has given way (`_met`).
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
        self._known: tuple[Array, float] | None = None  # what was last asked of `yielded`
        self._anchor = self._along(case.nodes) if contact.friction else np.zeros(3)  # (f, q, 3) mm

    def softer(self, factor: float) -> "ObstacleFaces":
        """The same obstacle with `factor` of its surface's stiffness."""
        other = self._copy()
        other._stiffness = factor * self._stiffness
        return other

    def _copy(self) -> "ObstacleFaces":
        other = copy(self)
        other._known = None
        return other

    # -- where the obstacle is ------------------------------------------------------------------------------

    @property
    def _way(self) -> Array:
        """The way (3,) along which the obstacle's spring gives, of length 1."""
        assert self._spring is not None
        return np.asarray(self._spring.way, float) / np.linalg.norm(self._spring.way)

    def yielded(self, x: Array) -> float:
        """The displacement in mm of the obstacle along its spring at deformed positions x (n, 3) mm: where
        the spring's force k w balances that of the surface."""
        if self._spring is None:
            return 0.0
        if self._known is None or not np.array_equal(self._known[0], x):
            self._known = x.copy(), self._balanced(self._spring.stiffness, x)
        return self._known[1]

    def _balanced(self, stiffness: float, x: Array) -> float:
        w, a = 0.0, self._way
        for _ in range(YIELDS):
            here = x - w * a
            push = float(self._force(here).sum(axis=0) @ a)
            step = -(stiffness * w + push) / (stiffness + self._giving(here)[2])
            w += step
            if abs(step) < SETTLED:
                break
        return w

    def _giving(self, x: Array) -> tuple[Array, Array, float]:
        """How the forces fall, N/mm, as the obstacle gives way: those of all nodes (3 n,), their sum along
        the spring as each moves (3 n,), and the sum of it all."""
        size = 3 * self._count
        a, column, row = np.tile(self._way, self._count), np.zeros(size), np.zeros(size)
        for dofs, K in filter(None, (self._symmetric(x), self._skew(x))):
            column += scatter(dofs, K @ a[dofs][..., None], size)
            row += scatter(dofs, a[dofs][:, None] @ K, size)
        return column, row, max(float(a @ column), 0.0)

    def _met(self, x: Array) -> Array:
        """Positions (n, 3) mm as the obstacle at rest meets those that have pushed it away, x (n, 3) mm."""
        return x if self._spring is None else x - self.yielded(x) * self._way

    # -- forces ---------------------------------------------------------------------------------------------

    def depth(self, x: Array) -> Array:
        """Depth (f, q) mm below the obstacle's surface at deformed positions x (n, 3) mm."""
        return self._depth(self._met(x))

    def touches(self, x: Array) -> bool:
        """Whether the obstacle pushes at deformed positions x (n, 3) mm."""
        return bool((self.depth(x) > -SMOOTH / 2).any())

    def force(self, x: Array) -> Array:
        """Forces (n, 3) N of the obstacle on the nodes at deformed positions x (n, 3) mm."""
        return self._force(self._met(x))

    def resultant(self, x: Array) -> Array:
        """The force in N, and its moment about the origin in N mm (6,), of the obstacle on the surface at
        deformed positions x (n, 3) mm."""
        return _summed(self.force(x), x)

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
        """Forces (n, 3) N on the nodes of those (f, q, 3) N at the faces' points."""
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

    def _along(self, x: Array) -> Array:
        """Places (f, q, 3) mm between which a point slips: those along a plane."""
        place = self._places(x)
        if not isinstance(self._obstacle, Flat):
            return place
        normal = self._obstacle.out
        return np.asarray(place - (place @ normal)[..., None] * normal)

    def _since(self, x: Array) -> Array:
        """The way (f, q, 3) mm along the surface from the anchor."""
        way = self._along(x) - self._anchor
        if isinstance(self._obstacle, Flat):
            return np.asarray(way)
        normal = self._obstacle.normal(self._places(x))
        return np.asarray(way - (way * normal).sum(axis=-1, keepdims=True) * normal)

    def _slip(self, x: Array, pressure: Array) -> tuple[Array, Array, Array]:
        """The elastic slip (f, q, 3) mm, its direction, and its share (f, q) of the slip since the anchor:
        below 1 where the surface slides."""
        slip = self._since(x)
        length = np.linalg.norm(slip, axis=-1)
        limit = abs(self.friction) * pressure / self._stiffness
        slides = length > limit if self._slides is None else self._slides
        share = np.where(slides, limit / np.maximum(length, 1e-300), 1.0)
        return share[..., None] * slip, slip / np.maximum(length, 1e-300)[..., None], share

    def after(self, x: Array) -> "ObstacleFaces":
        """The obstacle as it is met from the equilibrium at deformed positions x (n, 3) mm on."""
        if not self.friction:
            return self
        other, x = self._copy(), self._met(x)
        other._anchor = self._along(x) - self._slip(x, self._pressure(x))[0]
        other._slides = None
        return other

    def slides(self, x: Array) -> Flags:
        """Where (f, q) the surface slides at deformed positions x (n, 3) mm, or is off the obstacle."""
        x = self._met(x)
        limit = abs(self.friction) * self._pressure(x) / self._stiffness
        return np.asarray(np.linalg.norm(self._since(x), axis=-1) >= limit)

    def sliding(self, where: Flags) -> "ObstacleFaces":
        """The same obstacle, on which the surface slides there (f, q) and nowhere else: what is held lies on
        the kink between stick and slip, and neighbours of a derivative must be on one side of it."""
        other = self._copy()
        other._slides = where
        return other

    # -- their derivative -----------------------------------------------------------------------------------

    def tangent(self, x: Array) -> tuple[Integers, Array]:
        """Degrees of freedom (g, 3 m) of the faces in contact and their matrices (g, 3 m, 3 m) N/mm, the
        derivative of minus their forces but for `coupling`."""
        return self._symmetric(self._met(x))

    def coupling(self, x: Array) -> list[tuple[Integers, Array]]:
        """As `tangent`, what is to be added to it: of friction, and of a spring."""
        x = self._met(x)
        skew = self._skew(x)
        parts = [] if skew is None else [skew]
        return parts if self._spring is None else [*parts, *self._condensed(x)]

    def change(self, x: Array, du: Array) -> Array:
        """The change (n, 3) N of the forces at deformed positions x (n, 3) mm along du (n, 3) mm."""
        out = np.zeros(du.size)
        for dofs, K in (self.tangent(x), *self.coupling(x)):
            out -= scatter(dofs, (K @ du.ravel()[dofs][..., None])[..., 0], du.size)
        return out.reshape(-1, 3)

    def along(self, x: Array, du: Array) -> Array:
        """The change (6,) of `resultant` at deformed positions x (n, 3) mm along du (n, 3) mm."""
        turned = np.cross(du, self.force(x)).sum(axis=0)
        return _summed(self.change(x, du), x) + np.append(np.zeros(3), turned)

    def _symmetric(self, x: Array) -> tuple[Integers, Array]:
        touching, slope = self._slope(x)
        faces, obstacle = self.faces[touching], self._obstacle
        size = 3 * faces.shape[1]
        if isinstance(obstacle, Flat):
            along = np.einsum("gq,qa,qb->gab", slope, self._N, self._N, optimize=True)
            K = np.einsum("gab,i,j->gaibj", along, obstacle.out, obstacle.out).reshape(len(faces), size, size)
            if self.friction:
                K += self._dragged(x, touching).reshape(K.shape)
        else:
            D = self._round(x, touching, slope)
            K = self._spread((D + np.swapaxes(D, 2, 3)) / 2)
        return self._dofs(touching), K

    def _dofs(self, touching: Integers) -> Integers:
        faces = self.faces[touching]
        return np.asarray((faces[:, :, None] * 3 + np.arange(3)).reshape(len(faces), 3 * faces.shape[1]))

    def _spread(self, D: Array) -> Array:
        """Matrices (g, 3 m, 3 m) N/mm of those (g, q, 3, 3) N/mm at the faces' points."""
        size = 3 * self._N.shape[1]
        return np.einsum("gqij,qa,qb->gaibj", D, self._N, self._N, optimize=True).reshape(-1, size, size)

    def _slope(self, x: Array) -> tuple[Integers, Array]:
        """The faces (g,) in contact, and their pressures' derivative (g, q) to depth times area, N/mm."""
        d = self._depth(x) + SMOOTH / 2
        touching = np.flatnonzero((d > 0).any(axis=1))
        return touching, self._stiffness * np.clip(d[touching] / SMOOTH, 0.0, 1.0) * self._area[touching]

    def _dragged(self, x: Array, touching: Integers) -> Array:
        """The derivative (g, m, 3, m, 3) N/mm of minus the touching faces' friction at fixed pressure."""
        assert isinstance(self._obstacle, Flat)
        pressure, normal = self._pressure(x), self._obstacle.out
        _, way, share = (v[touching] for v in self._slip(x, pressure))
        plane = np.eye(3) - np.outer(normal, normal)
        turn = plane - (share < 1)[..., None, None] * way[..., :, None] * way[..., None, :]
        stiff = self._sign * self._stiffness * self._area[touching] * share * (pressure[touching] > 0)
        return np.einsum("gq,gqij,qa,qb->gaibj", stiff, turn, self._N, self._N, optimize=True)

    def _round(self, x: Array, touching: Integers, slope: Array) -> Array:
        """The derivative (g, q, 3, 3) N/mm of minus the forces at the points of the touching faces."""
        assert not isinstance(self._obstacle, Flat)
        place, pressure = self._places(x)[touching], self._pressure(x)
        n, bend, area = self._obstacle.normal(place), self._obstacle.bend(place), self._area[touching]
        D = slope[..., None, None] * n[..., :, None] * n[..., None, :]
        D -= (area * pressure[touching])[..., None, None] * bend
        if not self.friction:
            return np.asarray(D)
        _, way, share = (v[touching] for v in self._slip(x, pressure))
        slides, far = share < 1, place - self._anchor[touching]
        height = (far * n).sum(axis=-1)[..., None, None]
        turned = n + np.einsum("gqij,gqj->gqi", bend, far)
        E = np.eye(3) - n[..., :, None] * turned[..., None, :] - height * bend  # of the slip since the anchor
        E -= slides[..., None, None] * way[..., :, None] * (way[..., None, :] @ E)
        stiff = self._sign * self._stiffness * area * share * (pressure[touching] > 0)
        limit = self.friction * slope * slides
        return np.asarray(
            D + stiff[..., None, None] * E - limit[..., None, None] * way[..., :, None] * n[..., None, :]
        )

    def _skew(self, x: Array) -> tuple[Integers, Array] | None:
        """What friction adds that is not symmetric; None where there is nothing: on a plane minus the
        derivative to pressure where it slides."""
        if not self.friction:
            return None
        touching, slope = self._slope(x)
        if not isinstance(self._obstacle, Flat):
            D = self._round(x, touching, slope)
            return self._dofs(touching), self._spread((D - np.swapaxes(D, 2, 3)) / 2)
        _, way, share = (v[touching] for v in self._slip(x, self._pressure(x)))
        slides = share < 1
        if not (slides & (slope > 0)).any():
            return None
        faces = self.faces[touching]
        size, slope, out = 3 * faces.shape[1], -self.friction * slope * slides, self._obstacle.out
        C = np.einsum("gq,gqi,qa,qb,j->gaibj", slope, way, self._N, self._N, out, optimize=True)
        return self._dofs(touching), C.reshape(len(faces), size, size)

    def _condensed(self, x: Array) -> list[tuple[Integers, Array]]:
        """What a spring takes off the tangent as the obstacle gives way: one matrix at all nodes in
        contact."""
        assert self._spring is not None
        column, row, firm = self._giving(x)
        own = np.flatnonzero((column != 0) | (row != 0))
        C = -np.outer(column[own], row[own]) / (self._spring.stiffness + firm)
        return [(own[None], C[None])] if len(own) else []


def _summed(force: Array, x: Array) -> Array:
    """Forces (n, 3) N at positions x (n, 3) mm as their sum and their moment about the origin (6,)."""
    return np.concatenate([force.sum(axis=0), np.cross(x, force).sum(axis=0)])
