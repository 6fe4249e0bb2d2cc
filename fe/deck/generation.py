"""Keywords that make nodes and elements out of a few: *NGEN, *NFILL, *NCOPY, *ELGEN."""

from itertools import product

import numpy as np

from fe.deck import setnames
from fe.deck.draft import Draft
from fe.deck.keywords import Keyword, Place, filled
from fe.deck.meshkeywords import MOST_MEMBERS, join, place_node, put_element
from fe.element import Array

TWO = "wanted nodes that are defined above"


def ngen(draft: Draft, k: Keyword) -> None:
    """*NGEN: nodes at equal distances on the straight line between two."""
    k.only("NSET")
    added: list[int] = []
    for line, words in k.data:
        start, end, step = k.wholes(line, filled(words, "", "", "1"), low=1)
        if (end - start) % step or not 0 < end - start < MOST_MEMBERS:
            raise k.error(f"{start}, {end}, {step}: wanted first < last, whole steps apart", line)
        a, b = (_node(draft, k, line, n) for n in (start, end))
        for n in range(start + step, end, step):
            place_node(draft, k, line, n, a + (b - a) * (n - start) / (end - start))
        added += range(start, end + 1, step)
    if "NSET" in k.parameters:
        join(setnames.opened(draft, "node_sets", k.text("NSET"), []), added)


def _node(draft: Draft, k: Keyword, line: Place, label: int) -> Array:
    if label not in draft.here.nodes:
        raise k.error(f"node {label}: not defined; {TWO}", line)
    return draft.here.nodes[label]


def nfill(draft: Draft, k: Keyword) -> None:
    """*NFILL: nodes at equal distances on the lines between the nodes of two sets, in their order."""
    k.only("NSET")
    added: list[int] = []
    for line, words in k.data:
        starts, ends = (setnames.known(k, draft.here.node_sets, w, line) for w in filled(words, "", ""))
        count, step = k.wholes(line, filled(words[2:], "", "1"), low=1)
        if len(starts) != len(ends) or len(starts) * count > MOST_MEMBERS:
            raise k.error(f"sets of {len(starts)} and {len(ends)} nodes: wanted two of one size", line)
        for a, b in zip(starts, ends, strict=True):
            x, y = (_node(draft, k, line, n) for n in (a, b))
            for i in range(1, count):
                place_node(draft, k, line, a + i * step, x + (y - x) * i / count)
            added += [*range(a, a + count * step, step), b]
    if "NSET" in k.parameters:
        join(setnames.opened(draft, "node_sets", k.text("NSET"), []), added)


def ncopy(draft: Draft, k: Keyword) -> None:
    """*NCOPY, SHIFT: a set of nodes once more, translated."""
    k.only("OLD SET", "CHANGE NUMBER", "SHIFT", "NEW SET")
    if "SHIFT" not in k.parameters:
        raise k.error("*NCOPY without SHIFT: wanted *NCOPY, SHIFT and a translation")
    more, old = k.whole(k.place, k.text("CHANGE NUMBER")), k.text("OLD SET")
    shifts = [k.numbers(line, filled(words, *[""] * 7)) for line, words in k.data]
    if any(any(row) for row in shifts[1:]):
        raise k.error("*NCOPY with a rotation: wanted a translation alone; write the nodes out", k.data[1][0])
    shift = np.array(shifts[0][:3]) if shifts else np.zeros(3)
    chosen = setnames.known(k, draft.here.node_sets, old, k.place)
    for n in list(chosen):
        place_node(draft, k, k.place, n + more, _node(draft, k, k.place, n) + shift)
    if "NEW SET" in k.parameters:
        join(setnames.opened(draft, "node_sets", k.text("NEW SET"), []), [n + more for n in chosen])


def elgen(draft: Draft, k: Keyword) -> None:
    """*ELGEN: elements in rows, rows in layers, from one that is there: for each of the three how many, and
    what is added to the numbers of nodes and elements."""
    k.only("ELSET")
    added: list[int] = []
    for line, words in k.data:
        if words[0] == "ALL NODES":
            raise k.error("*ELGEN with ALL NODES: wanted it without", line)
        numbers = k.wholes(line, [w or "1" for w in words])
        start, runs = numbers[0], [numbers[i : i + 3] for i in range(1, len(numbers), 3)]
        runs = [[*run, 1, 1][:3] for run in runs if run]
        counts = [run[0] for run in runs]
        if start not in draft.here.elements or min(counts, default=0) < 1:
            raise k.error(f"element {start}: wanted one that is defined above, and counts of 1 or more", line)
        if np.prod(counts, dtype=float) > MOST_MEMBERS:
            raise k.error(f"more than {MOST_MEMBERS} elements: wanted fewer", line)
        kind, row = draft.here.elements[start]
        for index in product(*(range(c) for c in counts)):
            more, number = (sum(i * run[j] for i, run in zip(index, runs, strict=True)) for j in (1, 2))
            put_element(draft, k, line, start + number, (kind, [n + more for n in row]))
            added.append(start + number)
    if "ELSET" in k.parameters:
        join(setnames.opened(draft, "element_sets", k.text("ELSET"), []), added)
