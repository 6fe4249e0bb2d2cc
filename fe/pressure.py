"""Deformed surface positions -> nodal forces of a unit follower pressure and their symmetric tangent.

f_a = - int N_a (x,s x x,t) ds dt per unit pressure, with the normal out of the material. On a closed chamber
(or one closed by symmetry planes) the pressure has the potential p V, so the tangent is symmetric (Bufler
1984, doi 10.1002/zamm.19840640704); the antisymmetric part of each face cancels in the sum and is dropped.
"""

import numpy as np

from fe.element import Array, Element, Integers, scatter


class PressureFaces:
    """The faces (f, m) of a pressurised surface of a mesh with `count` nodes."""

    def __init__(self, faces: Integers | None, element: Element, count: int) -> None:
        width = element.faces.shape[1]
        self.faces = np.empty((0, width), np.int64) if faces is None else faces
        self.dofs = (self.faces[:, :, None] * 3 + np.arange(3)).reshape(-1, 3 * width)
        self._weight = element.face_weights
        self._N, self._dN = element.on_face(element.face_points)
        self._count = count
        # w (N_a dN_b - dN_a N_b) / 2, of the slopes along s and t (2, q, a, b)
        along = np.einsum("q,qa,qbk->kqab", self._weight, self._N, self._dN)
        self._swept = 0.5 * (along - np.swapaxes(along, 2, 3))

    def _tangents(self, x: Array) -> tuple[Array, Array]:
        t = np.einsum("fai,qak->kfqi", x[self.faces], self._dN, optimize=True)
        return t[0], t[1]

    def force(self, x: Array) -> Array:
        """Nodal forces (n, 3) mm2 at deformed positions x (n, 3) mm."""
        s, t = self._tangents(x)
        f = -np.einsum("q,qa,fqi->fai", self._weight, self._N, np.cross(s, t), optimize=True)
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
        return out.reshape(faces, 3 * nodes, 3 * nodes)
