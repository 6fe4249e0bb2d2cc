"""A deck's mesh of several shapes of elements as one of quadratic tetrahedra."""

from collections.abc import Callable

import numpy as np

from fe.deck.kinds import TETRAHEDRA, read_as
from fe.deck.meshdraft import MeshDraft, rows
from fe.element import Integers
from fe.mesh.tetrahedra import divided


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
    found = divided([(read_as(mesh.elements[e][0]), mesh.elements[e][1]) for e in numbers], mesh.nodes)
    kinds = sorted({kind for kind, _ in mesh.elements.values()})
    count = len(found.parents)
    remark(f"Elements {', '.join(kinds)} become {count} quadratic tetrahedra on the same nodes.")
    parts: dict[int, list[int]] = {e: [] for e in numbers}
    for t, parent in enumerate(found.parents.tolist(), start=1):
        parts[numbers[parent]].append(t)
    on: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for e, f, t, g in found.faces.tolist():
        on.setdefault((numbers[e], f), []).append((t + 1, g))
    sets = {name: list(s) for name, s in mesh.node_sets.items()}
    for members in sets.values():
        own = set(members)
        members += [label for label, (_, corners) in found.made.items() if own.issuperset(corners)]
    surfaces = {}
    for name, faces in mesh.surfaces.items():
        if any(e in mesh.sheets for e, _ in faces):
            continue
        absent = next((face for face in faces if face not in on), None)
        if absent is not None:
            raise ValueError(f"{file}: surface {name!r}: element {absent[0]} has no face {absent[1] + 1}")
        surfaces[name] = [part for face in faces for part in on[face]]
    changed = MeshDraft(
        nodes=mesh.nodes | {label: place for label, (place, _) in found.made.items()},
        elements={t: (TETRAHEDRA, row) for t, row in enumerate(found.connectivity.tolist(), start=1)},
        node_sets=sets,
        element_sets={
            name: [t for e in s if e not in mesh.sheets for t in parts.get(e, [-e])]
            for name, s in mesh.element_sets.items()
        },
        surfaces=surfaces,
        sections=mesh.sections,
    )
    return changed, np.array([numbers[p] for p in found.parents.tolist()], np.int64)
