"""The mesh that a deck, or one of its parts, said so far, by labels and names."""

from dataclasses import dataclass, field

import numpy as np

from fe.deck.keywords import Place
from fe.deck.kinds import read_as
from fe.element import Array, Integers
from fe.mesh.tetrahedra import SOLIDS

Faces = list[tuple[int, int]]


@dataclass(frozen=True)
class SheetSection:
    """A sheet's material and thickness, and the line that states them."""

    material: str
    thickness: float
    place: Place


@dataclass
class MeshDraft:
    """Nodes, elements (type, nodes), sets and sections of a deck or of one of its parts, by labels and names
    in small letters; sheets: shells and membranes; inherited: the names that came with an instance, and with
    which."""

    nodes: dict[int, Array] = field(default_factory=dict)
    elements: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    element_sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, Faces] = field(default_factory=dict)
    sections: dict[str, str] = field(default_factory=dict)
    sheets: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    sheet_sections: dict[str, SheetSection] = field(default_factory=dict)
    inherited: dict[tuple[str, str], str] = field(default_factory=dict)

    def element(self, number: int) -> tuple[str, list[int]]:
        """The type and the nodes of a solid or a sheet. ValueError where there is none of that number."""
        for own in (self.sheets, self.elements):
            if number in own:
                return own[number]
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


def rows(file: str, known: Integers, wanted: list[int] | Integers, what: str) -> Integers:
    """The rows of labels among those known, in order. ValueError names one that is not there."""
    found = np.asarray(wanted, np.int64)
    at = np.minimum(np.searchsorted(known, found), len(known) - 1)
    missing = found[known[at] != found]
    if len(missing):
        raise ValueError(f"{file}: {what} {missing[0]} is used but not defined; define it or leave it out")
    return at
