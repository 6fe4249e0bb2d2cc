"""What joins parts of a deck: nodes of ties that coincide become one, other tied nodes follow the master's
faces, and sheets become layers on the faces that they lie on."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from fe.case import Case, Layer, Tie
from fe.deck.meshdraft import MeshDraft, SheetSection
from fe.deck.rigid import TieDraft
from fe.element import Array, Integers, triangles
from fe.kernel.tying import slaves

COINCIDENT = 1e-5  # of the longest side: nodes nearer to each other are one place
NEAR = 0.05  # of a master face's size: how far tied nodes may lie apart, as in Abaqus
COVERED = 0.05  # of a sheet's area: what the faces under it may have more or less
ALONG = 0.9  # cosine of the angle between a sheet and a face under it


def of_sheets(mesh: MeshDraft, tie: TieDraft) -> set[int]:
    """The sheets that a tie bonds, none where it ties solids."""
    return {e for name in (tie.slave, tie.master) for e, _ in mesh.surfaces[name] if e in mesh.sheets}


def merged(mesh: MeshDraft, ties: Iterable[TieDraft]) -> dict[int, int]:
    """Nodes of slave surfaces that lie on nodes of their master {slave: master}: they become one there."""
    every = np.array(list(mesh.nodes.values()))
    near, same = COINCIDENT * float(np.ptp(every, axis=0).max()), dict[int, int]()
    for tie in ties:
        first, second = (np.array(mesh.nodes_on(mesh.surfaces[name])) for name in (tie.slave, tie.master))
        places = [np.array([mesh.nodes[n] for n in own.tolist()]) for own in (first, second)]
        away, at = (np.asarray(x) for x in cKDTree(places[1]).query(places[0]))
        for a, b in zip(first[away <= near].tolist(), second[at[away <= near]].tolist(), strict=True):
            a, b = _last(same, a), _last(same, b)
            if a != b:
                same[a] = b
    return {a: _last(same, a) for a in same}


def _last(same: Mapping[int, int], label: int) -> int:
    while label in same:
        label = same[label]
    return label


def with_one_node(mesh: MeshDraft, same: Mapping[int, int]) -> None:
    """Put a mesh's nodes that are one in the place of each other."""
    for elements in (mesh.elements, mesh.sheets):
        for e, (kind, row) in elements.items():
            if not same.keys().isdisjoint(row):
                elements[e] = kind, [same.get(n, n) for n in row]
    for members in mesh.node_sets.values():
        members[:] = dict.fromkeys(same.get(n, n) for n in members)


def tied(case: Case, ties: Sequence[TieDraft]) -> Case:
    """A case with those of its ties that coinciding nodes leave, whose slave nodes are put onto the master.
    ValueError where nothing of a tie is near enough, which nodes do not join already."""
    for tie in ties:
        faces = case.face_nodes(tie.master)
        own = np.unique(case.face_nodes(tie.slave))
        rest = np.setdiff1d(own, faces)
        if not len(rest):
            continue
        corners = case.nodes[faces[:, list(case.element.corners)]]
        size = float(np.linalg.norm(np.ptp(corners, axis=1), axis=1).mean())
        reach = NEAR * size if tie.tolerance is None else tie.tolerance
        whole = Tie(tie.slave, tie.master, reach)
        found, _, _, places = slaves(case, whole)
        if not len(found):
            if len(rest) < len(own):
                continue
            raise ValueError(
                f"{tie.place}: *TIE of {tie.slave} to {tie.master}: no slave node lies within {reach:.3g} of "
                "the master; wanted surfaces that touch; state POSITION TOLERANCE, or move the part"
            )
        nodes = case.nodes.copy()
        nodes[found] = places
        # places on a curved face move a little with each search: what follows must be found again
        case = replace(case, nodes=nodes, ties=(*case.ties, whole))
    return case


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
        own = [e for e in mesh.element_sets.get(name, ()) if e in mesh.sheets]
        free = [e for e in own if e not in bonded and not used.issuperset(mesh.sheets[e][1])]
        if not own:
            raise ValueError(
                f"{section.place}: {name} has no shells or membranes; wanted some, or no section for it"
            )
        if free:
            raise ValueError(
                f"{section.place}: sheet element {free[0]} of {name} has nodes of its own and no *TIE: it "
                "bonds to nothing; tie its surface to that of the solid, or give it the solid's nodes"
            )
        modulus, poisson = law(section)
        corners = [[nodes[n] for n in mesh.sheets[e][1][: CORNERS[len(mesh.sheets[e][1])]]] for e in own]
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
            f"The sheet {name} ({len(own)} elements) is read as a layer on {len(under)} faces of the solid. "
            "Its thickness x modulus counts, its bending stiffness does not."
        )
    return replace(case, surfaces=surfaces, layers=tuple(added))


CORNERS = {3: 3, 6: 3, 4: 4, 8: 4}  # by the nodes of a sheet's element


def _every_face(case: Case) -> Integers:
    """All faces (f, 2) of a case's elements, one of two that neighbours share."""
    kind = case.element
    corners = np.sort(case.connectivity[:, kind.faces[:, list(kind.corners)]], axis=2)
    _, first = np.unique(corners.reshape(-1, corners.shape[2]), axis=0, return_index=True)
    return np.stack(np.divmod(np.sort(first), len(kind.faces)), axis=1).astype(np.int64)


def _under(
    case: Case, faces: Integers, sheet: list[list[Array]], reach: float
) -> tuple[Integers, tuple[float, float]]:
    """The faces (f, 2) whose middles lie on a sheet, given by its elements' corners, within `reach`; and the
    areas of sheet and faces."""
    three = np.array([t for c in sheet for t in ([c[0], c[1], c[2]], [c[0], c[2], c[-1]])[: len(c) - 2]])
    normal = np.cross(three[:, 1] - three[:, 0], three[:, 2] - three[:, 0])
    size = np.linalg.norm(normal, axis=1)
    kind, (element, face) = case.element, faces.T
    rows = np.take_along_axis(case.connectivity[element], kind.faces[face], axis=1)
    middle = case.nodes[rows[:, list(kind.corners)]].mean(axis=1)
    widest = float(np.linalg.norm(three - three.mean(axis=1, keepdims=True), axis=2).max())
    found = []
    for f, near in enumerate(cKDTree(three.mean(axis=1)).query_ball_point(middle, widest + reach)):
        if near and _on(three[near], normal[near] / size[near, None], middle[f], max(reach, 1e-4 * widest)):
            found.append(f)
    own = rows[found]
    cut = case.nodes[triangles(own)] if len(found) else np.empty((0, 3, 3))
    areas = np.cross(cut[:, 1] - cut[:, 0], cut[:, 2] - cut[:, 0])
    across = case.nodes[own[:, list(kind.corners)]] if len(found) else np.empty((0, 3, 3))
    facing = np.cross(across[:, 1] - across[:, 0], across[:, -1] - across[:, 0])
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-300)
    nearest = cKDTree(three.mean(axis=1)).query(middle[found])[1] if len(found) else np.empty(0, int)
    along = np.abs((facing * normal[nearest]).sum(axis=1)) > ALONG * size[nearest]
    per = len(cut) // max(len(found), 1)
    covered = float(np.linalg.norm(areas, axis=1).reshape(-1, max(per, 1)).sum(axis=1)[along].sum()) / 2
    return faces[np.array(found, np.int64)[along]], (float(size.sum()) / 2, covered)


def _on(three: Array, normal: Array, x: Array, reach: float) -> bool:
    """Whether a place (3,) lies over one of triangles (t, 3, 3) of unit normals (t, 3), within `reach`."""
    height = ((x - three[:, 0]) * normal).sum(axis=1)
    foot = x - height[:, None] * normal
    sides = np.roll(three, -1, axis=1) - three
    inward = np.cross(normal[:, None], sides)
    inside = ((foot[:, None] - three) * inward).sum(axis=2) >= -1e-6 * (sides**2).sum(axis=2)
    return bool((inside.all(axis=1) & (np.abs(height) <= reach)).any())
