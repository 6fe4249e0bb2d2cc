"""Nodal forces of a unit follower pressure on a surface, and their symmetric tangent.

f_a = - int N_a (x,s x x,t) ds dt per unit pressure, with the normal out of the material. On a closed chamber
(or one closed by symmetry planes) the pressure has the potential p V, so the tangent is symmetric (Bufler
1984, doi 10.1002/zamm.19840640704): the antisymmetric parts of faces cancel but for an integral along edges
that belong to one face alone.
"""

import numpy as np

from fe.element import Array, Element, Flags, Integers, gauss, scatter

FLAT = 1e-6  # of an edge: how far a user's nodes may lie beside their plane of symmetry


class PressureFaces:
    """Faces (f, m) of a pressurised surface in a mesh of `count` nodes; shares (f,) of the pressure, by
    default 1."""

    def __init__(
        self, faces: Integers | None, element: Element, count: int, shares: Array | None = None
    ) -> None:
        width = element.faces.shape[1]
        self.faces = np.empty((0, width), np.int64) if faces is None else faces
        self.dofs = (self.faces[:, :, None] * 3 + np.arange(3)).reshape(-1, 3 * width)
        self._weight = element.face_weights
        self._N, self._dN = element.on_face(element.face_points)
        self._count = count
        # w (N_a dN_b - dN_a N_b) / 2, of the slopes along s and t (2, q, a, b)
        along = np.einsum("q,qa,qbk->kqab", self._weight, self._N, self._dN)
        self._swept = 0.5 * (along - np.swapaxes(along, 2, 3))
        self._shares, self._edge_shares = shares, dict[tuple[int, ...], float]()
        if shares is None:
            self.edges = _edges(self.faces, element)
            return
        edges_of_share = [(s, _edges(self.faces[shares == s], element)) for s in np.unique(shares).tolist()]
        self.edges = np.concatenate([edges for _, edges in edges_of_share])
        self._edge_shares = {tuple(edge): s for s, edges in edges_of_share for edge in edges.tolist()}

    def _tangents(self, x: Array) -> tuple[Array, Array]:
        t = np.einsum("fai,qak->kfqi", x[self.faces], self._dN, optimize=True)
        return t[0], t[1]

    def force(self, x: Array) -> Array:
        """Nodal forces (n, 3) mm2 at deformed positions x (n, 3) mm."""
        s, t = self._tangents(x)
        f = -np.einsum("q,qa,fqi->fai", self._weight, self._N, np.cross(s, t), optimize=True)
        if self._shares is not None:
            f *= self._shares[:, None, None]
        return scatter(self.dofs, f, 3 * self._count).reshape(-1, 3)

    def tangent(self, x: Array) -> Array:
        """Symmetric element tangents (f, 3 m, 3 m) mm, d force / d x, at deformed positions x (n, 3) mm."""
        # d(s x t) = ds x t - dt x s; the symmetric part of N_a dN_b [t]_ij, a matrix of t x, turns a and b
        s, t = self._tangents(x)
        v = np.einsum("kqab,kfqi->ifab", self._swept, np.stack([t, -s]), optimize=True)
        faces, nodes = self.faces.shape
        out = np.zeros((faces, nodes, 3, nodes, 3))
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            out[:, :, i, :, j], out[:, :, j, :, i] = -v[k], v[k]
        if self._shares is not None:
            out *= self._shares[:, None, None, None, None]
        return out.reshape(faces, 3 * nodes, 3 * nodes)

    def open_edges(self, x: Array, free: Flags) -> Integers:
        """Free edges (g, k) of single faces along which the work of the pressure depends on the path; edges
        on held degrees of freedom or in planes of symmetry, to FLAT, are closed. x (n, 3) mm, free (3 n,)."""
        dofs, C = self.antisymmetric(x, self.edges)
        both = free[dofs][:, :, None] & free[dofs][:, None]
        size = np.abs(C)
        return self.edges[(size * both).max(axis=(1, 2), initial=0.0) > FLAT * size.max(initial=0.0)]

    def antisymmetric(self, x: Array, edges: Integers) -> tuple[Integers, Array]:
        """Degrees of freedom (g, 3 k) of edges (g, k), and their unsymmetric tangent (g, 3 k, 3 k) mm at
        deformed positions x (n, 3) mm: half the integral of N_a N_b [dx], [v] being the matrix of v x."""
        (s, w), size = gauss(1), edges.shape[1]
        s = s[:, 0]
        value = [s * (s - 1) / 2, 1 - s * s, s * (s + 1) / 2] if size == 3 else [(1 - s) / 2, (1 + s) / 2]
        slope = [s - 0.5, -2 * s, s + 0.5] if size == 3 else [0 * s - 0.5, 0 * s + 0.5]
        N, dN = np.stack(value, axis=1), np.stack(slope, axis=1)
        turn = _cross_matrix(np.einsum("qa,gai->gqi", dN, x[edges]))
        C = 0.5 * np.einsum("q,qa,qb,gqij->gaibj", w, N, N, turn, optimize=True)
        if self._shares is not None:
            shares = np.array([self._edge_shares[tuple(edge)] for edge in edges.tolist()])
            C *= shares[:, None, None, None, None]
        dofs = (edges[:, :, None] * 3 + np.arange(3)).reshape(len(edges), 3 * size)
        return dofs, C.reshape(len(edges), 3 * size, 3 * size)


def _edges(faces: Integers, element: Element) -> Integers:
    """Edges (g, 2 or 3) of single faces, each from end to end with its middle node, in the faces'
    orientation."""
    places, corners, edge_nodes = element.local[element.faces[0]], element.corners, []
    for a, b in zip(corners, (*corners[1:], corners[0]), strict=True):
        middle = np.flatnonzero(np.abs(places - (places[a] + places[b]) / 2).max(axis=1) < 1e-9)
        edge_nodes.append([a, *middle, b])
    edges = faces[:, edge_nodes].reshape(-1, len(edge_nodes[0]))
    ends = np.sort(edges[:, [0, -1]], axis=1)
    _, rows, count = np.unique(ends, axis=0, return_index=True, return_counts=True)
    return edges[rows[count == 1]]


def _cross_matrix(v: Array) -> Array:
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)
