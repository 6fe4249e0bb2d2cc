"""Forces of an elastic sheet that is bonded to a surface, and their tangent.

A membrane without bending stiffness, of stiffness thickness x modulus: St Venant-Kirchhoff in plane stress
(or fibres alone, in one direction), S = D E with the surface's own Green-Lagrange strain E in its
coordinates (Ciarlet 2005, An Introduction to Differential Geometry with Applications to Elasticity, section
4.1). It is free of stress as it is meshed.
"""

import numpy as np

from fe.case import Case, Layer
from fe.element import Array, Integers, scatter

LEAST = 1e-6  # sine of the angle between a surface's normal and x, below which nothing winds around it
_AB = ((0, 0), (1, 1), (0, 1))  # components of a symmetric surface tensor; the last one counts twice


class LayerFaces:
    """The faces of a layer of a case."""

    def __init__(self, case: Case, layer: Layer) -> None:
        element, self.faces = case.element, case.face_nodes(layer.surface)
        _, self._dN = element.on_face(element.face_points)
        A = self._tangents(case.nodes)
        self._metric = A @ np.swapaxes(A, 2, 3)  # (f, q, 2, 2)
        self._area = np.sqrt(np.linalg.det(self._metric)) * element.face_weights
        dual = np.asarray(np.linalg.inv(self._metric), float)
        D = _wound(A, dual, np.radians(layer.angle)) if layer.wound else _plane_stress(dual, layer.poisson)
        self._D = layer.per_face(case)[:, None, None, None] * D
        self.dofs = (self.faces[:, :, None] * 3 + np.arange(3)).reshape(len(self.faces), -1)

    def _tangents(self, x: Array) -> Array:
        """Vectors (f, q, 2, 3) along the surface's coordinates, at positions x (n, 3) mm."""
        return np.einsum("fai,qak->fqki", x[self.faces], self._dN, optimize=True)

    def _stress(self, a: Array) -> Array:
        """Second Piola-Kirchhoff stress (f, q, 3) N/mm of tangents (f, q, 2, 3)."""
        strain = 0.5 * (a @ np.swapaxes(a, 2, 3) - self._metric)
        voigt = np.stack([strain[..., 0, 0], strain[..., 1, 1], 2 * strain[..., 0, 1]], axis=-1)
        return np.asarray((self._D @ voigt[..., None])[..., 0], float)

    def _strain_of(self, a: Array) -> Array:
        """Derivative (f, q, 3, 3 m) of the strain by the displacements of the faces' nodes."""
        rows = []
        for k, j in _AB:
            row = np.einsum("qm,fqi->fqmi", self._dN[..., k], a[:, :, j])
            row = row if k == j else row + np.einsum("qm,fqi->fqmi", self._dN[..., j], a[:, :, k])
            rows.append(row.reshape(*row.shape[:2], -1))
        return np.stack(rows, axis=2)

    def force(self, x: Array) -> Array:
        """Forces (n, 3) N of the layer on the nodes at deformed positions x (n, 3) mm."""
        a = self._tangents(x)
        flux = self._area[..., None] * self._stress(a)
        inner = np.einsum("fqsd,fqs->fd", self._strain_of(a), flux, optimize=True)
        return -scatter(self.dofs, inner, x.size).reshape(-1, 3)

    def tangent(self, x: Array) -> tuple[Integers, Array]:
        """Degrees of freedom (f, 3 m) and matrices (f, 3 m, 3 m) N/mm, the derivative of minus the forces."""
        a = self._tangents(x)
        B, S = self._strain_of(a), self._area[..., None] * self._stress(a)
        K = np.einsum("fqsd,fqst,fqte->fde", B, self._area[..., None, None] * self._D, B, optimize=True)
        full = np.stack([S[..., 0], S[..., 2], S[..., 2], S[..., 1]], axis=-1).reshape(*S.shape[:2], 2, 2)
        along = np.einsum("qmk,fqkl,qnl->fmn", self._dN, full, self._dN, optimize=True)
        size = K.shape[1]
        return self.dofs, K + np.einsum("fmn,ij->fminj", along, np.eye(3)).reshape(-1, size, size)


def _plane_stress(g: Array, poisson: float) -> Array:
    """D (f, q, 3, 3) of an isotropic sheet of stiffness 1, by the contravariant metric g (f, q, 2, 2)."""
    D = np.empty((*g.shape[:2], 3, 3))
    for s, (a, b) in enumerate(_AB):
        for t, (c, d) in enumerate(_AB):
            shear = g[..., a, c] * g[..., b, d] + g[..., a, d] * g[..., b, c]
            D[..., s, t] = poisson * g[..., a, b] * g[..., c, d] + (1 - poisson) / 2 * shear
    return D / (1 - poisson**2)


def _wound(A: Array, g: Array, angle: float) -> Array:
    """D (f, q, 3, 3) of fibres of stiffness 1 around the x axis, S = t t (t E t) with their unit tangent t,
    half of them turned by an angle in rad to either side, by vectors A (f, q, 2, 3) along the surface's
    coordinates and its contravariant metric g (f, q, 2, 2). None where the surface faces along x."""
    normal = np.cross(A[..., 0, :], A[..., 1, :])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    around = np.cross(normal, [1.0, 0.0, 0.0])
    length = np.linalg.norm(around, axis=-1, keepdims=True)
    around = np.where(length > LEAST, around / np.maximum(length, LEAST), 0.0)
    along = np.cross(around, normal)
    families = [np.cos(angle) * around + side * np.sin(angle) * along for side in (-1.0, 1.0)]
    return np.asarray(sum(_along(A, g, t) for t in families) / 2, float)


def _along(A: Array, g: Array, t: Array) -> Array:
    """D (f, q, 3, 3) of fibres of stiffness 1 along unit tangents t (f, q, 3)."""
    components = np.einsum("fqab,fqbi,fqi->fqa", g, A, t)
    both = np.stack([components[..., a] * components[..., b] for a, b in _AB], axis=-1)
    return np.asarray(both[..., :, None] * both[..., None, :], float)
