"""The skin of a mesh without groups of faces -> the groups that its shape tells.

A closed skin that the material lies around is a chamber; what lies flat on a side of the box around the mesh
is that side, as a clamp or a plane of symmetry does.
"""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fe.element import ELEMENTS, Array, Integers
from fe.mesh.refine import unshared

FLAT = 1e-6  # of the mesh's extent
SIDES = ("min", "max")


def groups_of_skin(nodes: Array, kind: str, elements: Integers) -> dict[str, Integers]:
    """Groups (k, c) of faces, each by the nodes of its corners. `chamber`: all closed skins inside; each
    alone is `chamber1`, .. where there are several. `xmin` to `zmax`: the flat ends of the outer skin.

    nodes (n, 3) mm; elements (e, m) of one type, kind, an Abaqus name.
    """
    skin = _skin(kind, elements)
    part = _parts(skin, len(nodes))
    filled = np.bincount(part, weights=_under(nodes - nodes.mean(axis=0), skin))
    filled *= np.sign(filled[np.abs(filled).argmax()])  # the largest is an outer one
    found = [skin[part == k] for k in np.flatnonzero(filled < 0)]
    out = {"chamber": np.concatenate(found)} if found else {}
    if len(found) > 1:
        out |= {f"chamber{k}": own for k, own in enumerate(found, start=1)}
    low, high = nodes[skin].min(axis=(0, 1)), nodes[skin].max(axis=(0, 1))
    faces = skin[filled[part] > 0]
    for axis in range(3):
        for side, at in zip(SIDES, (low[axis], high[axis]), strict=True):
            flat = (np.abs(nodes[faces, axis] - at) < FLAT * (high - low).max()).all(axis=1)
            if flat.any():
                out["xyz"[axis] + side] = faces[flat]
    return out


def _skin(kind: str, elements: Integers) -> Integers:
    """The corners (f, c) of the faces that belong to one element alone."""
    element = ELEMENTS[kind]
    own, number = unshared(element, elements).T
    return np.take_along_axis(elements[own], element.faces[number][:, list(element.corners)], axis=1)


def _parts(faces: Integers, nodes: int) -> Integers:
    """The number (f,) of the part of the skin that each face belongs to, parts sharing no node."""
    a, b = np.repeat(faces[:, 0], faces.shape[1]), faces.ravel()
    joined = coo_matrix((np.ones(len(a)), (a, b)), shape=(nodes, nodes))
    _, label = connected_components(joined, directed=False)
    return np.asarray(np.unique(label[faces[:, 0]], return_inverse=True)[1], np.int64)


def _under(nodes: Array, faces: Integers) -> Array:
    """The signed volume (f,) mm3 of the cones of faces from the origin: of a closed skin together what it
    encloses, with one sign where the material lies inside, the other where it lies around."""
    first, middle, last = (nodes[faces[:, k]] for k in (slice(0, 1), slice(1, -1), slice(2, None)))
    return np.asarray(np.einsum("fti,fti->f", first, np.cross(middle, last)) / 6, float)
