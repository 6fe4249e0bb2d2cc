"""Shells and membranes of a deck become layers on the faces of solids that they lie on."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import scipy

from fe.case import Case, Layer
from fe.deck.meshdraft import MeshDraft, SheetSection
from fe.element import Array, Integers, triangles

COVERED = 0.05  # of a sheet's area: what the faces under it may have more or less
ALONG = 0.9  # cosine of the angle between a sheet and a face under it


def layers(
    case: Case, mesh: MeshDraft, nodes: Mapping[int, Array], bonded: set[int],
    law: Callable[[SheetSection], tuple[float, float]], remark: Callable[[str], None],
) -> Case:  # fmt: skip
    """A case with the sheets of a mesh as layers on the faces that they lie on.

    nodes: places of labels; bonded: sheets that are tied; law: modulus and Poisson's ratio of a section.
    ValueError for a sheet that does not lie on faces, or that nothing bonds to them.
    """
    if not mesh.sheets:
        return case
    sectioned = {e for name in mesh.sheet_sections for e in mesh.element_sets.get(name, ())}
    loose = sorted(mesh.sheets.keys() - sectioned)
    if loose:
        raise ValueError(f"sheet element {loose[0]} has no *SHELL SECTION or *MEMBRANE SECTION; wanted one")
    faces, surfaces, added = _every_face(case), dict(case.surfaces), list[Layer]()
    used = set(case.labels.tolist())
    for k, (name, section) in enumerate(mesh.sheet_sections.items(), start=1):
        elements = [e for e in mesh.element_sets.get(name, ()) if e in mesh.sheets]
        free = [e for e in elements if e not in bonded and not used.issuperset(mesh.sheets[e][1])]
        if not elements:
            raise ValueError(
                f"{section.place}: {name} has no shells or membranes; wanted some, or no section for it"
            )
        if free:
            raise ValueError(
                f"{section.place}: sheet element {free[0]} of {name} has nodes of its own and no *TIE: it "
                "bonds to nothing; tie its surface to that of the solid, or give it the solid's nodes"
            )
        modulus, poisson = law(section)
        corners = [[nodes[n] for n in mesh.sheets[e][1][: CORNERS[len(mesh.sheets[e][1])]]] for e in elements]
        under, area = _under(case, faces, corners, section.thickness)
        share = area[1] / area[0] - 1
        if abs(share) > COVERED:
            raise ValueError(
                f"{section.place}: the sheet {name} has {area[0]:.4g} mm2, the faces of solids under it "
                f"{area[1]:.4g} mm2; wanted a sheet that lies on whole faces; give it the solid's own nodes"
            )
        surface = f"sheet_{k}"
        surfaces[surface] = under
        added.append(Layer(surface, section.thickness * modulus, poisson))
        remark(
            f"The sheet {name} ({len(elements)} elements) is read as a layer on {len(under)} faces of the "
            "solid. Its thickness x modulus counts, its bending stiffness does not."
        )
    return replace(case, surfaces=surfaces, layers=tuple(added))


CORNERS = {3: 3, 6: 3, 4: 4, 8: 4}  # by the nodes of a sheet's element


def _every_face(case: Case) -> Integers:
    """All faces (f, 2) of a case's elements; a face shared by two neighbours is listed once."""
    kind = case.element
    corners = np.sort(case.connectivity[:, kind.faces[:, list(kind.corners)]], axis=2)
    _, rows = np.unique(corners.reshape(-1, corners.shape[2]), axis=0, return_index=True)
    return np.stack(np.divmod(np.sort(rows), len(kind.faces)), axis=1).astype(np.int64)


def _under(
    case: Case, faces: Integers, sheet: list[list[Array]], reach: float
) -> tuple[Integers, tuple[float, float]]:
    """The faces (f, 2) whose middles lie on a sheet, given by its elements' corners, within `reach`; and the
    areas of sheet and faces in mm2."""
    three = np.array([t for c in sheet for t in ([c[0], c[1], c[2]], [c[0], c[2], c[-1]])[: len(c) - 2]])
    normal = np.cross(three[:, 1] - three[:, 0], three[:, 2] - three[:, 0])
    size = np.linalg.norm(normal, axis=1)
    normal /= size[:, None]
    rows = case.nodes_of_faces(faces)
    corners = case.nodes[rows[:, list(case.element.corners)]]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, -1] - corners[:, 0])
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    middle, tree = corners.mean(axis=1), scipy.spatial.cKDTree(three.mean(axis=1))
    widest = float(np.linalg.norm(three - three.mean(axis=1, keepdims=True), axis=2).max())
    reach = max(reach, 1e-4 * widest)
    chosen = [
        f
        for f, near in enumerate(tree.query_ball_point(middle, widest + reach))
        if near and _on(three[near], normal[near], middle[f], facing[f], reach)
    ]
    return faces[chosen], (float(size.sum()) / 2, _area(case.nodes, rows[chosen]))


def _area(nodes: Array, faces: Integers) -> float:
    """The area of faces (f, m), in mm2."""
    if not len(faces):
        return 0.0
    cut = nodes[triangles(faces)]
    return float(np.linalg.norm(np.cross(cut[:, 1] - cut[:, 0], cut[:, 2] - cut[:, 0]), axis=1).sum()) / 2


def _on(three: Array, normal: Array, x: Array, facing: Array, reach: float) -> bool:
    """True if a point x (3,) on a face with unit normal `facing` lies within `reach` of a parallel triangle;
    triangles (t, 3, 3) with unit normals (t, 3)."""
    height = ((x - three[:, 0]) * normal).sum(axis=1)
    foot = x - height[:, None] * normal
    sides = np.roll(three, -1, axis=1) - three
    inward = np.cross(normal[:, None], sides)
    inside = ((foot[:, None] - three) * inward).sum(axis=2) >= -1e-6 * (sides**2).sum(axis=2)
    return bool((inside.all(axis=1) & (np.abs(height) <= reach) & (np.abs(normal @ facing) > ALONG)).any())
