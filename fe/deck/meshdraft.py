"""The mesh of a deck, or of a part, while it is read, by labels and names; mixed shapes as tetrahedra."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fe.deck.elementtypes import TETRAHEDRA, read_as
from fe.deck.keywords import Place
from fe.element import Array, Integers
from fe.mesh.tetrahedra import SOLIDS, divided

Faces = list[tuple[int, int]]


@dataclass(frozen=True)
class SheetSection:
    """A sheet's material and thickness, and the line that states them."""

    material: str
    thickness: float
    place: Place


@dataclass
class MeshDraft:
    """Mesh of a deck or a part: nodes, elements (type, nodes), sets and sections by labels and names in small
    letters. sheets: shells and membranes; skins: elements of planes and lines, left out. inherited: names
    that came with an instance, and the instance's name."""

    nodes: dict[int, Array] = field(default_factory=dict)
    elements: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    element_sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, Faces] = field(default_factory=dict)
    sections: dict[str, str] = field(default_factory=dict)
    sheets: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    skins: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    sheet_sections: dict[str, SheetSection] = field(default_factory=dict)
    inherited: dict[tuple[str, str], str] = field(default_factory=dict)

    def element(self, number: int) -> tuple[str, list[int]]:
        """The type and the nodes of a solid or a sheet. ValueError where there is none of that number."""
        for elements in (self.sheets, self.elements, self.skins):
            if number in elements:
                return elements[number]
        raise ValueError(f"element {number} is used but not defined; define it or leave it out")

    def nodes_on(self, faces: Faces) -> list[int]:
        """The nodes of faces (element, face) of solids, or of whole sheets, which have the face -1.
        ValueError where an element has no such face."""
        out: dict[int, None] = {}
        for e, f in faces:
            kind, row = self.element(e)
            solid = SOLIDS.get(read_as(kind))
            if solid is not None and not 0 <= f < len(solid.faces):
                raise ValueError(f"element {e}, {kind}, has no face {f + 1}: wanted 1 to {len(solid.faces)}")
            on = range(len(row)) if solid is None else solid.on_face(f)
            out |= dict.fromkeys(row[k] for k in on)
        return list(out)


def rows(file: str, defined: Integers, used: list[int] | Integers, what: str) -> Integers:
    """Rows of the labels `used` among the sorted labels `defined`. ValueError names a label that is not
    defined.

    >>> rows("plate.inp", np.array([1, 4, 9]), [9, 1], "node")
    array([2, 0])
    """
    labels = np.asarray(used, np.int64)
    index = np.minimum(np.searchsorted(defined, labels), len(defined) - 1)
    missing = labels[defined[index] != labels]
    if len(missing):
        raise ValueError(f"{file}: {what} {missing[0]} is used but not defined; define it or leave it out")
    return index


def in_tetrahedra(mesh: MeshDraft, file: str, remark: Callable[[str], None]) -> tuple[MeshDraft, Integers]:
    """A mesh of several shapes of elements as tetrahedra, numbered from 1, and the number (t,) of the element
    that each is part of."""
    numbers = sorted(mesh.elements)
    labels = np.array(sorted(mesh.nodes), np.int64)
    rows(file, labels, [n for e in numbers for n in mesh.elements[e][1]], "node")
    for e in numbers:
        if len(set(mesh.elements[e][1])) < len(mesh.elements[e][1]):
            raise ValueError(
                f"{file}: element {e} has a node more than once; mesh that place with other elements"
            )
    division = divided([(read_as(mesh.elements[e][0]), mesh.elements[e][1]) for e in numbers], mesh.nodes)
    kinds = sorted({kind for kind, _ in mesh.elements.values()})
    count = len(division.parents)
    remark(f"Elements {', '.join(kinds)} become {count} quadratic tetrahedra on the same nodes.")
    parts: dict[int, list[int]] = {e: [] for e in numbers}
    for t, parent in enumerate(division.parents.tolist(), start=1):
        parts[numbers[parent]].append(t)
    on: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for e, f, t, g in division.faces.tolist():
        on.setdefault((numbers[e], f), []).append((t + 1, g))
    sets = {name: list(s) for name, s in mesh.node_sets.items()}
    for members in sets.values():
        member_set = set(members)
        members += [label for label, (_, corners) in division.made.items() if member_set.issuperset(corners)]
    surfaces = {}
    for name, faces in mesh.surfaces.items():
        if any(e in mesh.sheets for e, _ in faces):
            continue
        absent = next((face for face in faces if face not in on), None)
        if absent is not None:
            raise ValueError(f"{file}: surface {name!r}: element {absent[0]} has no face {absent[1] + 1}")
        surfaces[name] = [part for face in faces for part in on[face]]
    changed = MeshDraft(
        nodes=mesh.nodes | {label: place for label, (place, _) in division.made.items()},
        elements={t: (TETRAHEDRA, row) for t, row in enumerate(division.connectivity.tolist(), start=1)},
        node_sets=sets,
        element_sets={
            name: [t for e in s if e not in mesh.sheets | mesh.skins for t in parts.get(e, [-e])]
            for name, s in mesh.element_sets.items()
        },
        surfaces=surfaces,
        sections=mesh.sections,
    )
    return changed, np.array([numbers[p] for p in division.parents.tolist()], np.int64)
