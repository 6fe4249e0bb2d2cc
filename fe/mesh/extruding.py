"""Half model with a chamber from the cells of a section extruded along x; some cells are void.

The cells lie in a reference box, where those that share a node have it at one place; a map then brings the
nodes to their places in the body. Notches in the body from outside are left out of the cells.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fe.case import Block, Case, Clamp, Support
from fe.element import FACES, Array, Flags, Integers
from fe.material import Material

Place = Sequence[float]  # (3,) mm
_ON = 1e-6  # mm from a plane


def hollow_case(
    cells: Array,
    solid: Flags,
    *,
    placed: Callable[[Array], Array] = lambda reference: reference,
    material: Material,
    marks: Mapping[int, Place],
) -> Case:
    """The half model y >= 0 of a body from cells (c, 27, 3) of a reference box, clamped at x = 0.

    solid (c,): which cells are material; the others are its chamber, which carries the pressure. placed: from
    reference points (n, 3) to the nodes (n, 3) mm, which keeps the planes x = 0 and y = 0. marks: places
    (3,) mm whose nearest nodes get these labels. Node sets: clamp, symmetry, tip_face; surfaces: chamber (if
    there is one), outside.
    """
    reference, rows = _merge(cells)
    chamber, outside = _interface(rows, solid)
    used, connectivity = np.unique(rows[solid], return_inverse=True)
    reference = reference[used]
    nodes = placed(reference)
    block = Block("hex27", connectivity.reshape(-1, 27))
    face_y = reference[block.connectivity[:, FACES]][..., 1].max(-1)  # (e, 6)
    outside = outside[face_y[outside[:, 0], outside[:, 1]] > 1e-9]
    sets = {
        "clamp": np.flatnonzero(reference[:, 0] < 1e-9),
        "symmetry": np.flatnonzero(reference[:, 1] < 1e-9),
        "tip_face": np.flatnonzero(reference[:, 0] > reference[:, 0].max() - 1e-9),
    }
    inner = {"chamber": chamber} if len(chamber) else {}
    return Case(
        nodes=nodes,
        labels=_labels(nodes, marks),
        blocks=(block,),
        node_sets=sets,
        element_sets={"body": np.arange(int(solid.sum()))},
        surfaces={**inner, "outside": outside},
        materials={"body": material},
        supports=(Support("symmetry", (1,)),),
        clamp=Clamp("clamp", (0.0, float(np.ptp(nodes[sets["clamp"], 2])) / 2)),
        pressurised="chamber" if inner else None,
    )


def between(stops: Sequence[float], counts: Sequence[int]) -> Array:
    """Cell boundaries: every stretch between two stops, divided evenly into its count of cells.

    >>> between([0.0, 1.0, 3.0], [2, 1])
    array([0. , 0.5, 1. , 3. ])
    """
    parts = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(stops[:-1], stops[1:], counts, strict=True)]
    return np.append(np.concatenate(parts), stops[-1])


def facing(case: Case, surface: str, axis: int, place: float) -> Integers:
    """Faces (f, 2) of a surface that lie in the plane x[axis] = place, mm."""
    near = np.abs(case.nodes[case.face_nodes(surface), axis] - place) < _ON
    return np.asarray(case.surfaces[surface][near.all(axis=1)], np.int64)


def box_grid(y: Array, z: Array) -> Array:
    """Quadrilaterals (c, 4, 2) of a section between cell boundaries y and z.

    >>> box_grid(np.array([0.0, 1.0]), np.array([0.0, 2.0]))[0].tolist()
    [[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 2.0]]
    """
    return grid_quads(np.stack(np.meshgrid(y, z, indexing="ij"), axis=-1))


def path(y: Array | float, z: Array | float) -> Array:
    """Points (n, 2) of a section along a line of constant y or z.

    >>> path(np.array([0.0, 1.0]), 5.0).tolist()
    [[0.0, 5.0], [1.0, 5.0]]
    """
    return np.stack(np.broadcast_arrays(np.asarray(y, float), np.asarray(z, float)), axis=-1)


def grid_quads(p: Array) -> Array:
    """Cells (c, 4, 2) of a lattice of points (a, b, 2), in the order (0,0) (1,0) (1,1) (0,1) of its two
    directions."""
    return np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], axis=2).reshape(-1, 4, 2)


def extruded(quads: Array, x: Array) -> Array:
    """Reference positions (stations, c, 27, 3) of tri-quadratic cells; xi runs along x, (eta, zeta) in the
    section.

    >>> quads = box_grid(np.linspace(0.0, 2.0, 3), np.array([0.0, 1.0]))
    >>> extruded(quads, np.linspace(0.0, 9.0, 4)).shape
    (3, 2, 27, 3)
    """
    t = np.array([0.0, 0.5, 1.0])
    eta, zeta = np.meshgrid(t, t, indexing="ij")  # [j, k]
    corner = np.stack([(1 - eta) * (1 - zeta), eta * (1 - zeta), eta * zeta, (1 - eta) * zeta])
    section = np.einsum("vjk,cvd->ckjd", corner, quads)  # (c, k, j, 2)
    along = x[:-1, None] + np.diff(x)[:, None] * t  # (s, i)
    out = np.empty((len(along), len(quads), 3, 3, 3, 3))
    out[..., 0] = along[:, None, None, None, :]
    out[..., 1:] = section[None, :, :, :, None, :]
    return out.reshape(len(along), len(quads), 27, 3)


def _merge(points: Array) -> tuple[Array, Integers]:
    """Distinct points (n, 3), in the order x, y, z, and the rows (e, 27) of `points` (e, 27, 3)."""
    keys = np.round(points.reshape(-1, 3) * 1e6).astype(np.int64)
    _, index, rows = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return points.reshape(-1, 3)[index], rows.reshape(points.shape[:2])


def _interface(cells: Integers, solid: Flags) -> tuple[Integers, Integers]:
    """Faces (f, 2) = (solid element, face) that touch a void cell, and those that touch nothing."""
    faces = np.sort(cells[:, FACES].reshape(-1, 9), axis=1)
    _, group, count = np.unique(faces, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    owner, face = np.repeat(np.arange(len(cells)), 6), np.tile(np.arange(6), len(cells))
    solids = np.bincount(group, weights=solid[owner])[group]
    number = np.cumsum(solid) - 1
    chosen = [solid[owner] & (count[group] == 2) & (solids == 1), solid[owner] & (count[group] == 1)]
    touching, free = (np.stack([number[owner[c]], face[c]], axis=1) for c in chosen)
    return touching, free


def _labels(nodes: Array, marks: Mapping[int, Place]) -> Integers:
    """Node numbers (n,) from 1, exchanged so that the labels in `marks` lie at the nodes nearest to their
    places."""
    n = len(nodes)
    labels = np.arange(1, n + 1)
    for label, position in marks.items():
        row = int(np.argmin(np.linalg.norm(nodes - np.array(position), axis=1)))
        holder = np.flatnonzero(labels == label)
        if len(holder):
            labels[holder[0]] = labels[row]
        labels[row] = label
    return labels
