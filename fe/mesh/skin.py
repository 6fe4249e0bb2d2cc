"""The outer skin of a structure around the x axis, on which a sleeve or fibres lie."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fe.case import Case
from fe.element import Integers
from fe.mesh.mirror import middle_plane, symmetry_support
from fe.mesh.refine import free_faces

AROUND = 0.7  # of a face's unit normal along x, from which it is an end or a flank


def outer_skin(case: Case) -> Integers:
    """Faces (f, 2) around the x axis that can be reached from outside: without the plane of symmetry, ends,
    closed chambers and bores."""
    faces = free_faces(case)
    corners = case.element.faces[:, list(case.element.corners)][faces[:, 1]]
    rows = np.take_along_axis(case.connectivity[faces[:, 0]], corners, axis=1)
    held = symmetry_support(case)
    if held is not None:
        off = ~np.isin(rows, case.node_sets[held.nodes]).all(axis=1)
        faces, rows = faces[off], rows[off]
    x = case.nodes[rows]  # (f, corners, 3)
    middle, normal = x.mean(axis=1), np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    inside = case.nodes[case.connectivity[faces[:, 0]]].mean(axis=1)
    normal *= np.sign(((middle - inside) * normal).sum(axis=1))[:, None]
    axis = np.array([middle_plane(case), (x[..., 2].max() + x[..., 2].min()) / 2])
    away = middle[:, 1:] - axis
    outward = (np.abs(normal[:, 0]) < AROUND) & ((normal[:, 1:] * away).sum(axis=1) > 0)
    links = np.stack([np.repeat(np.arange(len(rows)), rows.shape[1]), rows.ravel()])
    size = len(rows) + len(case.nodes)
    graph = coo_array((np.ones(links.shape[1]), (links[0], len(rows) + links[1])), shape=(size, size))
    part = connected_components(graph, directed=False)[1][: len(rows)]
    outermost = int(np.where(outward, (away**2).sum(axis=1), -1.0).argmax())
    return np.asarray(faces[outward & (part == part[outermost])], np.int64)
