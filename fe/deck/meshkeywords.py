"""Keywords that state a mesh: nodes, elements, sets, surfaces."""

import re
from collections.abc import Callable, Iterable

import numpy as np

from fe.deck import setnames
from fe.deck.draft import Draft
from fe.deck.elementtypes import KINDS, SHEETS, nodes_of
from fe.deck.keywords import Keyword, Place, filled
from fe.deck.setnames import small

FARTHEST = 1e5  # mm from the origin
SKINS = re.compile(r"(CPS|CPE|CAX|T2D|T3D|B2|B3)\d")  # elements that a mesher writes beside the solids
MOST_MEMBERS = 10_000_000  # of a set


def nodes(draft: Draft, k: Keyword) -> None:
    """*NODE."""
    k.only("NSET")
    added: list[int] = []
    for line, words in k.data:
        _, *x = k.numbers(line, filled(words, *[""] * 4))
        label = k.whole(line, words[0], low=1)
        place_node(draft, k, line, label, np.array(x))
        added.append(label)
    if "NSET" in k.parameters:
        join(setnames.opened(draft, "node_sets", k.text("NSET"), []), added)


def place_node(draft: Draft, k: Keyword, line: Place, label: int, x: np.ndarray) -> None:
    """A node at a place (3,). ValueError where it is elsewhere already, or too far."""
    places = draft.here.nodes
    if np.abs(x).max() * draft.units.length > FARTHEST:
        raise k.error(f"node {label} lies farther than {FARTHEST:g} from the origin: wanted mm", line)
    if label in places and not np.array_equal(x, places[label]):
        raise k.error(f"node {label} is defined twice, at different places: wanted it once", line)
    places[label] = x


def join(members: list[int], more: Iterable[int]) -> None:
    """Add to a set what is not in it yet."""
    members[:] = dict.fromkeys([*members, *more])


def elements(draft: Draft, k: Keyword) -> None:
    """*ELEMENT."""
    kind = k.parameters.get("TYPE", "").upper()
    count = nodes_of(kind)
    if SKINS.match(kind):
        draft.remark(f"Elements {kind}, of a plane or a line, are left out: they are no part of the body.")
        skins = [k.wholes(line, words, low=1) for line, words in k.data]
        draft.here.skins.update({e: (kind, row) for e, *row in skins})
        if "ELSET" in k.parameters:
            join(setnames.opened(draft, "element_sets", k.text("ELSET"), []), [row[0] for row in skins])
        return
    if count is None:
        raise k.error(
            f"element type {kind or 'absent'}: wanted one of {', '.join([*KINDS, *SHEETS])}; mesh it with one"
        )
    record, added = list[int](), list[int]()
    for line, words in k.data:
        record += k.wholes(line, words, low=1)
        if len(record) > count + 1:
            raise k.error(f"element {record[0]} has {len(record) - 1} nodes; {kind} wants {count}", line)
        if len(record) == count + 1:
            put_element(draft, k, line, record[0], (kind, record[1:]))
            added.append(record[0])
            record = []
    if record:
        raise k.error(f"element {record[0]} has {len(record) - 1} nodes; {kind} wants {count}")
    if "ELSET" in k.parameters:
        join(setnames.opened(draft, "element_sets", k.text("ELSET"), []), added)


def put_element(draft: Draft, k: Keyword, line: Place, number: int, element: tuple[str, list[int]]) -> None:
    """An element of that number. ValueError where there is another."""
    mesh = draft.here
    same_kind, others = (mesh.sheets, mesh.elements) if element[0] in SHEETS else (mesh.elements, mesh.sheets)
    if number in others or same_kind.setdefault(number, element) != element:
        raise k.error(f"element {number} is defined twice, with other nodes: wanted it once", line)


def reader_of_sets(sets: str, parameter: str) -> Callable[[Draft, Keyword], None]:
    """The reader of *NSET or *ELSET, whose sets are the attribute `sets` of a mesh."""

    def read(draft: Draft, k: Keyword) -> None:
        target: list[int] = setnames.opened(draft, sets, k.text(parameter), [])
        instance = small(k.parameters.get("INSTANCE", ""))
        defined, members = getattr(draft.here, sets), dict.fromkeys(target)
        for line, words in k.data:
            if "GENERATE" in k.parameters:
                more = draft.numbered.get(instance, 0)
                members |= dict.fromkeys(n + more for n in _generated(k, line, words))
                continue
            for word in filter(None, words):
                members |= dict.fromkeys(setnames.members(draft, k, defined, word, line, instance))
        if parameter == "NSET" and "ELSET" in k.parameters:
            chosen = setnames.known(k, draft.here.element_sets, k.text("ELSET"), k.place)
            members |= dict.fromkeys(sorted({n for e in chosen for n in draft.here.element(e)[1]}))
        target[:] = members

    return read


def _generated(k: Keyword, line: Place, words: list[str]) -> range:
    low, high, step = k.wholes(line, filled(words, "", "", "1"), low=1)
    members = range(low, high + 1, step)
    if not 0 < len(members) <= MOST_MEMBERS:
        raise k.error(
            f"{low}, {high}, {step}: wanted first <= last and at most {MOST_MEMBERS} members", line
        )
    return members


def surface(draft: Draft, k: Keyword) -> None:
    """*SURFACE of faces of elements; of shells SPOS and SNEG, face -1."""
    if k.parameters.get("TYPE", "ELEMENT").upper() != "ELEMENT":
        raise k.error(f"*SURFACE of type {k.parameters['TYPE']}: wanted TYPE=ELEMENT with faces S1, S2 ..")
    target: list[tuple[int, int]] = setnames.opened(draft, "surfaces", k.text("NAME"), [])
    instance, faces = small(k.parameters.get("INSTANCE", "")), dict.fromkeys(target)
    for line, words in k.data:
        side = words[1].upper() if len(words) > 1 else ""
        number = -1 if side in ("SPOS", "SNEG") else face(k, line, side, "S")
        chosen = setnames.members(draft, k, draft.here.element_sets, words[0], line, instance)
        faces |= dict.fromkeys((e, number) for e in chosen)
    target[:] = faces


def face(k: Keyword, line: Place, word: str, letter: str) -> int:
    """The number of a face, from 0."""
    match = re.fullmatch(f"{letter}([1-6])", word.upper())
    if not match:
        raise k.error(f"face {word[:20] or 'absent'}: wanted {letter}1, {letter}2 .. {letter}6", line)
    return int(match[1]) - 1
