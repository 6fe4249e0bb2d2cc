"""Walls of a mesh: the inner surface moved while the outer one stays, and the surfaces that may touch.

The displacement of the inner surface is extended through the walls as a harmonic field (Laplace's equation on
the mesh itself). No parametric geometry is needed: the walls of any mesh with a named chamber can be changed.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from fe.case import Case, CaseKey, SelfContact, digest
from fe.element import Array, Element, Integers
from fe.kernel.assembly import Geometry
from fe.mesh.refine import free_faces


class Inside:
    """The inner surface of a case: rows (k,) of its nodes, their positions (k, 3) mm and unit normals (k, 3)
    into the chamber."""

    def __init__(self, case: Case) -> None:
        if case.pressurised is None:
            raise ValueError("no pressurised surface: wanted a chamber, whose walls are to change")
        faces = case.face_nodes(case.pressurised)
        self.rows: Integers = np.unique(faces)
        self.position = case.nodes[self.rows]
        held = _held_by_symmetry(case)
        normal = _normals(case.nodes, faces, case.element) * ~held
        self.normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True).clip(1e-12))[self.rows]
        self._fixed = held.copy()
        self._fixed[_outer_nodes(case)] = True
        self._fixed[self.rows] = True
        self._laplace, self._held = _laplacian(case), held
        self._solvers = [splu(self._laplace[~f][:, ~f].tocsc()) for f in self._fixed.T]

    def spread(self, moved: Array) -> Array:
        """Harmonic extension (n, 3) mm of displacements `moved` (k, 3) mm of the inner surface: zero on the
        outer surface, tangential in planes of symmetry."""
        out = np.zeros((len(self._held), 3))
        out[self.rows] = moved
        out[self._held] = 0.0
        for i, (solver, fixed) in enumerate(zip(self._solvers, self._fixed.T, strict=True)):
            out[~fixed, i] = solver.solve(-(self._laplace[~fixed][:, fixed] @ out[fixed, i]))
        return out


def inside(case: Case) -> Inside:
    """Inner surface of a case, cached by mesh. ValueError without a pressurised surface."""
    held = [(s.nodes, s.components, case.node_sets[s.nodes]) for s in case.supports]
    surface = case.surfaces[case.pressurised] if case.pressurised else ()
    parts = [case.element.name, case.nodes, case.connectivity, surface, *(x for h in held for x in h)]
    return _inside(CaseKey(case, digest(*parts)))


@lru_cache(maxsize=4)
def _inside(key: CaseKey) -> Inside:
    return Inside(key.case)


def least_volume_ratio(case: Case, nodes: Array) -> float:
    """Smallest ratio of new to old volume at any quadrature point, with nodes moved to `nodes` (n, 3) mm; not
    positive if an element is inverted."""
    _, dN = case.element.at_points
    jacobian = (
        np.einsum("eai,qaJ->eqiJ", x[case.connectivity], dN, optimize=True) for x in (case.nodes, nodes)
    )
    old, new = (np.linalg.det(j) for j in jacobian)
    return float((new / old).min())


def _laplacian(case: Case) -> sp.csr_matrix:
    g, c = Geometry(case.nodes, case.connectivity, case.element), case.connectivity
    local = np.einsum("eq,eqia,eqib->eab", g.weight, g.G, g.G, optimize=True)
    rows, columns = np.broadcast_arrays(c[:, :, None], c[:, None, :])
    n = len(case.nodes)
    return sp.csr_matrix((local.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n))


def _held_by_symmetry(case: Case) -> Any:
    """Flags (n, 3) of components that supports of a single component hold at zero."""
    held = np.zeros((len(case.nodes), 3), bool)
    for s in case.supports:
        if len(s.components) == 1 and s.value is None:
            held[case.node_sets[s.nodes], s.components[0]] = True
    return held


def _outer_nodes(case: Case) -> Integers:
    """The nodes of the skin but for the chamber's faces and planes of symmetry."""
    _, nodes = _beyond_chamber(case)
    on_plane = _held_by_symmetry(case)[nodes].all(axis=1).any(axis=1)
    return np.unique(nodes[~on_plane])


def _beyond_chamber(case: Case) -> tuple[Integers, Integers]:
    """The free faces (f, 2) but for the chamber's, and their nodes (f, k)."""
    faces, width = free_faces(case), len(case.element.faces)
    if case.pressurised:
        faces = faces[~np.isin(faces @ [width, 1], case.surfaces[case.pressurised] @ [width, 1])]
    return faces, np.take_along_axis(case.connectivity[faces[:, 0]], case.element.faces[faces[:, 1]], axis=1)


def _normals(nodes: Array, faces: Integers, kind: Element) -> Array:
    """The sum (n, 3) of the faces' normals at their nodes, out of the material."""
    local = kind.local[kind.faces[0]]
    p = local[list(kind.corners)]
    if kind.simplex:
        origin, axes = p[0], np.stack([p[1] - p[0], p[2] - p[0]])
    else:
        origin, axes = p.mean(axis=0), np.stack([p[1] - p[0], p[3] - p[0]]) / 2
    st = np.linalg.lstsq(axes.T, (local - origin).T, rcond=None)[0].T
    _, dN = kind.on_face(st)
    s, t = np.einsum("fai,qak->kfqi", nodes[faces], dN, optimize=True)
    normal, out = np.cross(s, t), np.zeros_like(nodes)
    np.add.at(out, faces, normal / np.linalg.norm(normal, axis=2, keepdims=True))
    return out


SKIN = "skin"


def closing(case: Case) -> Case:
    """The case with self-contact: the pressurised faces cannot pass through each other, nor can the other
    free faces (the surface SKIN), except in planes of symmetry and at the clamp."""
    faces, nodes = _beyond_chamber(case)
    held = case.supported
    held[case.clamped] = True
    apart = ~np.any(np.all(held[nodes], axis=1), axis=1)
    pairs = [SelfContact(SKIN, SKIN)]
    if case.pressurised:
        pairs.append(SelfContact(case.pressurised, case.pressurised))
    return replace(case, surfaces={**case.surfaces, SKIN: faces[apart]}, self_contact=tuple(pairs))
