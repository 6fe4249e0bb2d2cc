"""Frictionless contact between surfaces of one structure, with symmetric tangent.

Penalty as in `contact`: every mm2 of a surface at rest is pushed out of the other with k s(d), d the depth of
its point below the closest point of the other deformed surface, s(d) = max(d, 0) smoothed by a parabola over
SMOOTH about d = 0. Points are quadrature points, not nodes (surface to surface: Fischer & Wriggers 2005, doi
10.1007/s00466-005-0660-z), so that a uniform pressure passes through meshes that do not match. Both surfaces
act as slave and as master, with half of k each: there is no choice to make, and a surface may touch itself.
(Sauer & De Lorenzis 2013, doi 10.1016/j.cma.2012.09.012, use two half passes as well, with forces on the
slave alone; here either half has a potential, which keeps the tangent symmetric.)

The tangent includes the rotation of the normal and the sliding of the closest point (Laursen & Simo 1993, doi
10.1002/nme.1620362005). k is a multiple of the smallest shear modulus, so that displacements remain a
function of pressure over the moduli.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np
import scipy

from fe.case import Case
from fe.element import Array, Flags, Integers, gauss, scatter
from fe.kernel.contact import SMOOTH
from fe.kernel.projection import Candidates, nearest, polynomials, powers

POINTS = 6  # of quadrature in each direction: a uniform stress is met to 0.1 % rms, with 4 to 1.6 %
FACING = 0.2  # cosine between the normals of two faces' middles, at most, where points of theirs may touch
ROOM = 0.1  # of a face's radius: how far it may bend beyond its nodes
GIVE = 1.0  # of the shear modulus: the pressure that a correction may bring about where walls meet
KEPT = 3  # positions of which it is known what touches: a correction asks for both its ends again
MET = 0.2  # mm: how near points are for whose forces the matrix makes room


@dataclass(frozen=True)
class Touching:
    """Contact points (a,): slave face and quadrature point, master face with coordinates s, t, and depth in
    mm."""

    slave: Integers
    point: Integers
    master: Integers
    s: Array
    t: Array
    depth: Array

    @property
    def pairs(self) -> Integers:
        """Slave and master face (g, 2) of every point, in ascending order."""
        return np.sort(np.stack([self.slave, self.master], axis=1), axis=1)


class SelfFaces:
    """Faces of all pairs of surfaces of a case that may touch each other. ValueError for a surface that the
    case does not have, and for a stiffness that is not above 0."""

    def __init__(self, case: Case) -> None:
        _check(case)
        element, pairs = case.element, case.self_contact
        names = sorted({name for p in pairs for name in (p.first, p.second)})
        owned = np.concatenate([case.surfaces[name] for name in names])
        faces, number = np.unique(owned, axis=0, return_inverse=True)
        ends = np.cumsum([len(case.surfaces[name]) for name in names])
        rows = dict(zip(names, np.split(number.ravel(), ends[:-1]), strict=True))
        self.faces = np.take_along_axis(case.connectivity[faces[:, 0]], element.faces[faces[:, 1]], axis=1)
        # which pairs (p, f) a face is of, on either side
        self._sides = np.zeros((2, len(pairs), len(faces)), bool)
        for k, p in enumerate(pairs):
            self._sides[0, k, rows[p.first]] = self._sides[1, k, rows[p.second]] = True
        self._shear = float(case.per_element("shear").min())
        self._stiffness = self._shear * np.array([p.stiffness for p in pairs])
        rule = (element.face_points, element.face_weights) if element.simplex else gauss(2, POINTS)
        self._N, self._slopes = element.on_face(rule[0])
        self._simplex, self._count = element.simplex, len(case.nodes)
        self._shapes = polynomials(element)
        self._rest, self._at_rest, normal = self._shapes @ case.nodes[self.faces], *self._points(case.nodes)
        self._area = np.linalg.norm(normal, axis=-1) * rule[1]  # (f, q) mm2
        self._start = case.nodes
        self._last: list[tuple[Array, Touching]] = []
        self._met = np.empty((0, 2), np.int64)

    def times(self, factor: float) -> "SelfFaces":
        """The faces with stiffness multiplied by `factor`."""
        stiffer = copy(self)
        stiffer._stiffness = factor * self._stiffness
        return stiffer

    @property
    def give(self) -> float:
        """Depth in mm at which the contact pressure equals the shear modulus."""
        return GIVE * self._shear / float(self._stiffness.max())

    def _points(self, x: Array) -> tuple[Array, Array]:
        """Positions (f, q, 3) mm of the points of quadrature, and normals that are as long as their areas."""
        corners = x[self.faces]
        s, t = np.einsum("fai,qak->kfqi", corners, self._slopes, optimize=True)
        return self._N @ corners, np.cross(s, t)

    def touches(self, x: Array) -> bool:
        """True if any point is in contact at deformed positions x (n, 3) mm."""
        return bool(len(self._touching(x).slave))

    def deepest(self, x: Array) -> float:
        """The largest depth in mm at deformed positions x (n, 3) mm."""
        return float(self._touching(x).depth.max(initial=0.0))

    def force(self, x: Array) -> Array:
        """Forces (n, 3) N on the nodes at deformed positions x (n, 3) mm."""
        touching = self._touching(x)
        if not len(touching.slave):
            return np.zeros((self._count, 3))
        push, _ = self._law(touching)
        G = self._directions(x, touching)[:, 0]  # (a, 2 m, 3)
        nodes = np.concatenate([self.faces[touching.slave], self.faces[touching.master]], axis=1)
        nodal = push[:, None, None] * G
        return np.stack([scatter(nodes, nodal[..., i], self._count) for i in range(3)], axis=1)

    def tangent(self, x: Array) -> tuple[Integers, Array]:
        """Degrees of freedom (g, 6 m) of pairs of faces that touch and their matrices (g, 6 m, 6 m) N/mm, the
        derivative of minus their forces."""
        points = self._touching(x)
        pair, group = np.unique(np.stack([points.slave, points.master], axis=1), axis=0, return_inverse=True)
        dofs = self._dofs(pair)
        K = np.zeros((len(pair), dofs.shape[1], dofs.shape[1]))
        V = self._directions(x, points).reshape(len(points.slave), 5, dofs.shape[1])
        CV, order = self._curvature(x, points) @ V, np.argsort(group.ravel(), kind="stable")
        ends = np.searchsorted(group.ravel()[order], np.arange(len(pair) + 1))
        for g, rows in enumerate(np.split(order, ends[1:-1])[: len(pair)]):
            K[g] = np.einsum("aki,akj->ij", V[rows], CV[rows], optimize=True)
        return dofs, K

    def meeting(self, x: Array) -> Integers:
        """Degrees of freedom (g, 6 m) of all pairs of faces that have been in contact. A new contact at
        deformed positions x (n, 3) mm adds all pairs nearer than MET."""
        size, touching = len(self.faces), self._touching(x).pairs
        met = self._met @ [size, 1]
        if not np.isin(touching @ [size, 1], met).all():
            every = np.concatenate([self._met, touching, self._found(x, MET).pairs])
            self._met = np.unique(every, axis=0)
        return self._dofs(self._met)

    def _dofs(self, pair: Integers) -> Integers:
        """Degrees of freedom (g, 6 m) of pairs (g, 2) of faces."""
        dofs = self.faces[pair][..., None] * 3 + np.arange(3)
        return np.asarray(dofs.reshape(len(pair), 6 * self.faces.shape[1]))

    def _law(self, points: Touching) -> tuple[Array, Array]:
        """Forces (a,) N of the points, and their slopes N/mm over the depth."""
        allowed, d = self._allowed(points.slave, points.master), points.depth + SMOOTH / 2
        k = 0.5 * (allowed * self._stiffness[:, None]).max(axis=0) * self._area[points.slave, points.point]
        push = k * np.where(d < SMOOTH, d**2 / (2 * SMOOTH), d - SMOOTH / 2)
        return push, k * np.clip(d / SMOOTH, 0.0, 1.0)

    def _allowed(self, slave: Integers, master: Integers) -> Flags:
        """Flags (p, k): slave and master face belong to pair p of surfaces, in either order."""
        (a, b), (c, d) = self._sides[:, :, slave], self._sides[:, :, master]
        return np.asarray((a & d) | (b & c))

    def _shape(self, touching: Touching) -> tuple[Array, Array]:
        """Shape functions (a, m) of the slave faces; shape functions (6, a, m) of the master faces with their
        derivatives by s, t, ss, st, tt."""
        return self._N[touching.point], powers(touching.s, touching.t) @ self._shapes

    def _directions(self, x: Array, touching: Touching) -> Array:
        """Gradients (a, 5, 2 m, 3) by the nodes of both faces: the gap, the sliding along s and t, and the
        master's rotation about s and t."""
        N_slave, N_master = self._shape(touching)
        y = np.einsum("kam,ami->kai", N_master[:3], x[self.faces[touching.master]])
        n = np.cross(y[1], y[2])
        n /= np.linalg.norm(n, axis=-1, keepdims=True)
        both = np.concatenate([N_slave, -N_master[0]], axis=1)
        turns = np.concatenate([np.zeros((2, *N_slave.shape)), N_master[1:3]], axis=2)
        parts = [(both, n), (both, y[1]), (both, y[2]), (turns[0], n), (turns[1], n)]
        return np.stack([np.einsum("am,ai->ami", N, v) for N, v in parts], axis=1)

    def _curvature(self, x: Array, touching: Touching) -> Array:
        """Second derivative (a, 5, 5) of a point's energy along its directions G, T (2) and N (2): the law's
        slope along G, and with the gap g, the metric m, the curvature c, the force p and H = m - g c, p (T'
        H^-1 N + N' H^-1 T + g N' H^-1 N + T' m^-1 c H^-1 T)."""
        push, slope = self._law(touching)
        y = np.einsum("kam,ami->kai", self._shape(touching)[1], x[self.faces[touching.master]])
        n = np.cross(y[1], y[2])
        n /= np.linalg.norm(n, axis=-1, keepdims=True)
        m = np.einsum("pai,qai->apq", y[1:3], y[1:3])
        c = np.einsum("pai,ai->ap", y[3:], n)[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        inverse = np.linalg.inv(m + touching.depth[:, None, None] * c)
        C = np.zeros((len(push), 5, 5))
        C[:, 0, 0] = slope
        C[:, 1:3, 3:] = C[:, 3:, 1:3] = push[:, None, None] * inverse
        C[:, 3:, 3:] = (-touching.depth * push)[:, None, None] * inverse
        C[:, 1:3, 1:3] = push[:, None, None] * (np.linalg.inv(m) @ c @ inverse)
        return C

    def _touching(self, x: Array) -> Touching:
        """Contact points at deformed positions x (n, 3) mm."""
        for position, touching in self._last:
            if np.array_equal(position, x):
                return touching
        self._last = [(x.copy(), self._found(x, 0.0)), *self._last[: KEPT - 1]]
        return self._last[0][1]

    def _found(self, x: Array, apart: float) -> Touching:
        """Points in contact, or nearer than `apart` mm to it."""
        if not np.isfinite(x).all():  # of a step that has failed
            x = self._start
        balls = self._balls(x)
        slave, master = self._near(x, balls, apart)
        rows, begins = np.unique(slave, return_index=True)
        shape = (len(rows), len(self._N))
        which, st, depth = np.full(shape, -1), np.empty((*shape, 2)), np.empty(shape)
        if len(rows):
            y, normal = self._points(x)
            ends, P = np.append(begins, len(slave)), self._shapes @ x[self.faces]
            near = Candidates(rows, y[rows], normal[rows], self._at_rest[rows], ends, master)
            nearest(near, balls, P, self._rest, self._simplex, apart + SMOOTH / 2, which, st, depth)
        k, q = np.nonzero(which >= 0)
        s, t = st[k, q].T
        return Touching(rows[k], q, which[k, q], s, t, depth[k, q])

    def _balls(self, x: Array) -> Array:
        """Bounding data (f, 8) of every face: middle, unit normal, radius, and height above the middle, with
        a margin ROOM for curvature between nodes."""
        corners = x[self.faces]
        middle = corners.mean(axis=1)
        s, t = np.einsum("am,fmi->afi", self._shapes[[3, 1]], corners)
        n = np.cross(s, t)
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        beside = corners - middle[:, None]
        radius = np.linalg.norm(beside, axis=2).max(axis=1)
        high = np.einsum("fmi,fi->fm", beside, n).max(axis=1)
        return np.column_stack([middle, n, (1 + ROOM) * radius, high + ROOM * radius])

    def _near(self, x: Array, balls: Array, apart: float) -> tuple[Integers, Integers]:
        """Slave and master faces (k,), sorted, with points possibly in contact or within `apart` mm of
        contact."""
        corners, centre, n, radius, top = x[self.faces], balls[:, :3], balls[:, 3:6], balls[:, 6], balls[:, 7]
        tree, reach = scipy.spatial.cKDTree(centre), 2 * radius.max() + apart
        pairs = tree.query_pairs(reach, output_type="ndarray").astype(np.int64)
        a, b = pairs.T

        def kept(mask: Flags) -> tuple[Integers, Integers]:
            return a[mask], b[mask]

        between = centre[a] - centre[b]
        a, b = kept(np.einsum("ki,ki->k", between, between) < (radius[a] + radius[b] + apart) ** 2)
        a, b = kept(np.einsum("ki,ki->k", n[a], n[b]) < FACING)
        a, b = kept(np.asarray(self._allowed(a, b).any(axis=0)))
        a, b = np.concatenate([a, b]), np.concatenate([b, a])
        low = np.einsum("kmi,ki->km", corners[a] - centre[b][:, None], n[b]).min(axis=1)
        a, b = kept(low < top[b] + SMOOTH + apart)
        a, b = kept(~np.any(self.faces[a][:, :, None] == self.faces[b][:, None], axis=(1, 2)))
        order = np.lexsort((b, a))
        return a[order], b[order]


def _check(case: Case) -> None:
    for pair in case.self_contact:
        for name in (pair.first, pair.second):
            if name not in case.surfaces:
                raise ValueError(
                    f"self-contact of surface {name!r}: not in the model, wanted one of its surfaces "
                    f"({', '.join(case.surfaces)}); correct the name"
                )
        if not pair.stiffness > 0:
            raise ValueError(
                f"self-contact of {pair.first} and {pair.second}: stiffness {pair.stiffness:g} 1/mm, wanted "
                "more than 0, such as 20; to let walls pass through each other, leave the pair out"
            )
