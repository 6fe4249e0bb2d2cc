"""Parts and instances: each instance puts a copy of its part into the mesh, under its own labels and names.

The first instance keeps its labels. A later one gets a power of ten added; a set name that two instances
share gets the instance's name before it.
"""

from copy import deepcopy

import numpy as np
import scipy

from fe.deck.draft import Draft
from fe.deck.keywords import Keyword, filled
from fe.deck.meshdraft import MeshDraft
from fe.deck.setnames import apart, renamed, small
from fe.element import Array


def part(draft: Draft, k: Keyword) -> None:
    """*PART: what follows belongs to it."""
    if draft.instance is not None:
        raise k.error("*PART within an *INSTANCE: wanted *END INSTANCE before it")
    name = small(k.parameters.get("NAME", ""))
    if name in draft.parts:
        raise k.error(f"*PART, NAME={name}: a second part of that name; wanted another")
    draft.here = draft.parts.setdefault(name, MeshDraft())


def end_part(draft: Draft, k: Keyword) -> None:
    """*END PART."""
    if draft.instance is not None:
        raise k.error("*END PART within an *INSTANCE: wanted *END INSTANCE, and *PART before its *END PART")
    draft.here = draft.mesh


def instance(draft: Draft, k: Keyword) -> None:
    """*INSTANCE: a copy of a part, and what follows up to *END INSTANCE."""
    part_name, name = small(k.parameters.get("PART", "")), small(k.parameters.get("NAME", ""))
    if part_name not in draft.parts and draft.parts and part_name:
        raise k.error(f"*INSTANCE, PART={part_name}: no such part; wanted one of {', '.join(draft.parts)}")
    source = draft.parts.get(part_name, MeshDraft())
    moved = [k.numbers(line, filled(words, *[""] * 7)) for line, words in k.data]
    if any(any(row) for row in moved) and not source.nodes:
        raise k.error("an *INSTANCE that is moved and has its own nodes: wanted one in place")
    if name in draft.numbered:
        raise k.error(f"*INSTANCE, NAME={name}: a second one of that name; wanted another")
    draft.here = deepcopy(source)
    draft.instance = name, moved
    if len(moved) > 1:
        _turn(moved[1])  # an axis that is none is told here


SETS = ("node_sets", "element_sets", "surfaces")


def end_instance(draft: Draft, k: Keyword) -> None:
    """*END INSTANCE: it goes into the mesh."""
    if draft.instance is None:
        return
    (name, moved), copy, mesh = draft.instance, draft.here, draft.mesh
    draft.here, draft.instance = mesh, None
    top = max([0, *mesh.nodes, *mesh.elements, *mesh.sheets, *mesh.skins])
    more = 10 ** len(str(top)) if top else 0
    draft.numbered[name] = more
    if more:
        draft.remark(f"Nodes and elements of the instance {name} have {more} added to their labels.")
    mesh.nodes |= {n + more: _placed(x, moved) for n, x in copy.nodes.items()}
    for elements in ("elements", "sheets", "skins"):
        copied = {e + more: (k, [n + more for n in row]) for e, (k, row) in getattr(copy, elements).items()}
        getattr(mesh, elements).update(copied)
    sections, sheets = dict(copy.sections), dict(copy.sheet_sections)
    for sets in SETS:
        there = getattr(mesh, sets)
        for set_name, rows in getattr(copy, sets).items():
            shifted = [(r[0] + more, r[1]) for r in rows] if sets == "surfaces" else [r + more for r in rows]
            if set_name not in there and not any(n.endswith(f".{set_name}") for n in there):
                there[set_name], mesh.inherited[sets, set_name] = shifted, name
                continue
            there[f"{name}.{set_name}"] = shifted
            if sets == "element_sets":
                renamed(sections, set_name, f"{name}.{set_name}")
                renamed(sheets, set_name, f"{name}.{set_name}")
            before = mesh.inherited.get((sets, set_name))
            if before is not None and f"{before}.{set_name}" not in there:
                apart(mesh, sets, set_name, before)
                del mesh.inherited[sets, set_name]
    mesh.sections |= sections
    mesh.sheet_sections |= sheets


def _turn(row: list[float]) -> "tuple[Array, scipy.spatial.transform.Rotation]":
    a, b, degrees = np.array(row[:3]), np.array(row[3:6]), row[6]
    if np.array_equal(a, b):
        raise IndexError  # no axis: too few numbers
    axis = (b - a) / np.linalg.norm(b - a)
    return a, scipy.spatial.transform.Rotation.from_rotvec(np.radians(degrees) * axis)


def _placed(x: Array, moved: list[list[float]]) -> Array:
    """Position (3,) of an instance's node: translated, then rotated about an axis through two points, in
    degrees."""
    if moved:
        x = x + np.array(moved[0][:3])
    if len(moved) > 1:
        a, turn = _turn(moved[1])
        x = a + turn.apply(x - a)
    return np.asarray(x, float)
