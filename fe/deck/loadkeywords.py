"""Keywords that state supports and loads."""

from collections.abc import Iterable
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from fe.deck import setnames
from fe.deck.draft import Acting, Draft
from fe.deck.keywords import Keyword, Place, filled
from fe.deck.meshdraft import Faces
from fe.deck.meshkeywords import face
from fe.deck.setnames import small

T = TypeVar("T")
NAMED = {"ENCASTRE": (0, 1, 2), "PINNED": (0, 1, 2), "XSYMM": (0,), "YSYMM": (1,), "ZSYMM": (2,)}
TURNING = {"ENCASTRE": (3, 4, 5), "XSYMM": (4, 5), "YSYMM": (3, 5), "ZSYMM": (3, 4)}


def _set_of(draft: Draft, k: Keyword, line: Place, word: str) -> str:
    """The name of a node set, or of a new one for a label."""
    label = setnames.label(draft, word)
    if label is not None:
        draft.mesh.node_sets.setdefault(f"node_{label}", [label])
        return f"node_{label}"
    setnames.known(k, draft.mesh.node_sets, word, line)
    return str(setnames.key(draft.mesh.node_sets, word))


def boundary(draft: Draft, k: Keyword) -> None:
    """*BOUNDARY."""
    _renew(draft, k, draft.supports, draft.turning)
    for line, words in k.data:
        where = _set_of(draft, k, line, words[0])
        if words[1].upper() in NAMED:
            draft.supports += [(where, d, 0.0) for d in NAMED[words[1].upper()]]
            draft.turning += [(where, d, 0.0) for d in TURNING.get(words[1].upper(), ())]
            continue
        low = k.whole(line, words[1], low=1, high=6)
        high = k.whole(line, filled(words[2:], words[1])[0], low=low, high=6)
        (value,) = k.numbers(line, filled(words[3:], ""))
        value = followed(draft, k, value) if value else value
        draft.supports += [(where, d - 1, value) for d in range(low, high + 1) if d <= 3]
        draft.turning += [(where, d - 1, value) for d in range(low, high + 1) if d > 3]


def step(draft: Draft, k: Keyword) -> None:
    """*STEP."""
    if k.parameters.get("NLGEOM", "NO" if "NLGEOM" not in k.parameters else "YES").upper() == "NO":
        raise k.error("*STEP without NLGEOM: wanted NLGEOM=YES, as displacements are large here")
    draft.steps += 1


def amplitude(draft: Draft, k: Keyword) -> None:
    """*AMPLITUDE, a table of times and values: its value that is largest in size."""
    if k.parameters.get("DEFINITION", "TABULAR").upper() not in ("TABULAR", "SMOOTH STEP"):
        raise k.error(f"*AMPLITUDE, DEFINITION={k.parameters['DEFINITION']}: wanted a table of times, values")
    rows = k.rows(8, "numbers")
    pairs = [(line, row[n : n + 2]) for line, row in rows for n in range(0, 8, 2) if any(row[n : n + 2])]
    table = [v for line, pair in pairs for v in k.numbers(line, pair)]
    if any(b <= a for a, b in pairwise(table[::2])):
        raise k.error("*AMPLITUDE with times that do not increase: wanted time, value, time, value ..")
    peak = max(table[1::2], key=abs, default=0.0)
    if not peak:
        raise k.error("*AMPLITUDE of nothing but 0: wanted times and values, such as 0., 0., 1., 1.")
    absolute = k.parameters.get("VALUE", "RELATIVE").upper().startswith("ABS")
    course = tuple(v / peak if n % 2 else v for n, v in enumerate(table))
    draft.amplitudes[small(k.text("NAME"))] = peak, absolute, course


def followed(draft: Draft, k: Keyword, value: float) -> float:
    """Value of a load that may follow an amplitude, at the amplitude's peak."""
    amplitude = k.parameters.get("AMPLITUDE", "")
    if not amplitude:
        return value
    if small(amplitude) not in draft.amplitudes:
        raise k.error(f"*{k.name}, AMPLITUDE={amplitude}: not defined above; wanted *AMPLITUDE before it")
    factor, absolute, _ = draft.amplitudes[small(amplitude)]
    draft.remark(f"*{k.name} follows the amplitude {amplitude}: it is read at its largest value, {factor:g}.")
    return factor if absolute else factor * value


def _renew(draft: Draft, k: Keyword, *loads: list[Any] | dict[Any, Any]) -> None:
    """Take off what was stated before, by the first OP=NEW of a step."""
    k.only("OP", "AMPLITUDE")
    if (op := k.parameters.get("OP", "MOD").upper()) not in ("MOD", "NEW"):
        raise k.error(f"*{k.name}, OP={op}: wanted OP=NEW, or OP=MOD, the default")
    kind = k.name.replace("DSLOAD", "DLOAD")
    if op == "NEW" and draft.renewed.get(kind) != draft.steps:
        draft.renewed[kind] = draft.steps
        for stated in loads:
            stated.clear()


def _put(draft: Draft, loads: dict[T, Acting], key: T, value: float) -> bool:
    """State a load, which adds to that of the same step and replaces that of an earlier one. True if it
    adds."""
    step, before = loads.get(key, (-1, 0.0))
    loads[key] = draft.steps, value + (before if step == draft.steps else 0.0)
    return step == draft.steps


def dsload(draft: Draft, k: Keyword) -> None:
    """*DSLOAD, a pressure on a surface."""
    _renew(draft, k, draft.faces, draft.weights)
    for line, words in k.data:
        name = setnames.key(draft.mesh.surfaces, words[0])
        if name is None:
            raise k.error(
                f"surface {words[0]}: not defined; wanted one of {', '.join(draft.mesh.surfaces)}", line
            )
        if words[1].upper() != "P":
            raise k.error(f"*DSLOAD {words[1]}: wanted P, a pressure", line)
        _press(draft, k, line, words, name, draft.mesh.surfaces[name])
    draft.pressed[draft.steps] = k, dict(draft.faces)


def dload(draft: Draft, k: Keyword) -> None:
    """*DLOAD: a pressure on faces of elements, or a weight."""
    _renew(draft, k, draft.faces, draft.weights)
    for line, words in k.data:
        if words[1].upper() == "GRAV":
            _gravity(draft, k, line, words)
            continue
        side = face(k, line, words[1], "P")
        chosen = setnames.members(draft, k, draft.mesh.element_sets, words[0], line)
        _press(draft, k, line, words, f"dload_{filled(words[2:], '0')[0]}", [(e, side) for e in chosen])
    if draft.named:
        draft.pressed[draft.steps] = k, dict(draft.faces)


def _gravity(draft: Draft, k: Keyword, line: Place, words: list[str]) -> None:
    sets, count = draft.mesh.element_sets, len(draft.mesh.elements)
    if words[0] and len(set(setnames.members(draft, k, sets, words[0], line))) < count:
        raise k.error(f"GRAV on {words[0]}, a part of the elements: wanted all of them", line)
    size, *direction = k.numbers(line, filled(words[2:], "", "", "", ""))
    length = float(np.linalg.norm(direction))
    if not length:
        raise k.error("GRAV: wanted its size in mm/s2 and a direction of three components", line)
    _put(draft, draft.weights, tuple(x / length for x in direction), followed(draft, k, size))


def _press(
    draft: Draft, k: Keyword, line: Place, words: list[str], name: str, faces: Iterable[tuple[int, int]]
) -> None:
    """A pressure on faces (element, face), under the name of a load."""
    value = followed(draft, k, *k.numbers(line, filled(words[2:], "")))
    *_, table = draft.amplitudes.get(small(k.parameters.get("AMPLITUDE", "")), ((),))
    for at in dict.fromkeys(faces):
        adds = _put(draft, draft.faces, at, value)
        draft.named[at] = tuple(dict.fromkeys((*(draft.named[at] if adds else ()), name)))
        draft.courses.setdefault(at, (draft.steps, table))
        if adds:
            draft.remark(f"Pressures of {' and '.join(draft.named[at])} add up where they act on one face.")


def settle(draft: Draft) -> None:
    """Complete the draft's loads after the last step: gravity, the pressure of every step, and the surfaces
    under pressure, one for each course of it, with their shares."""
    draft.gravity = sum((g * np.array(way) for way, (_, g) in draft.weights.items()), np.zeros(3))
    alike: dict[tuple[Any, ...], Faces] = {}
    for at, names in draft.named.items():
        values = [acting.get(at, (0, 0.0))[1] for _, acting in draft.pressed.values()]
        alike.setdefault((names, draft.courses[at], *values), []).append(at)
    loads, courses = list[tuple[str, list[float]]](), dict[str, Any]()
    for (names, course, *values), faces in alike.items():
        name, number = "+".join(names), 1
        while name in courses or set(draft.mesh.surfaces.get(name, faces)) != set(faces):
            name, number = f"{'+'.join(names)}_{number + 1}", number + 1
        draft.mesh.surfaces[name], courses[name] = faces, course
        loads.append((name, values))
    draft.loaded = list(courses)
    for n, (k, _) in enumerate(draft.pressed.values()):
        now = {name: values[n] for name, values in loads}
        top = max(now.values(), key=abs, default=0.0)
        draft.pressures.append(top)
        grown = [now[name] / share for name, share in draft.shares.items() if share]
        if grown and top and not (grown[0] and np.allclose(grown, grown[0])):
            raise k.error("pressures in another ratio than in the step before: wanted one ratio in all steps")
        if top:
            draft.shares = {name: value / top for name, value in now.items()}
    if not set(draft.shares.values()) - {1.0}:
        draft.shares = {}
    if draft.shares:
        listed = ", ".join(f"{share:.4g} on {name}" for name, share in draft.shares.items())
        draft.remark(f"Surfaces carry shares of one pressure, which the log gives: {listed}.")
    if len(set(courses.values())) > 1:
        draft.remark(
            f"{' and '.join(courses)} are not filled at one time in the deck: in the model their "
            "pressures rise together. Where a film fills one and another film the other, state "
            "pressure_shares in each."
        )


def cload(draft: Draft, k: Keyword) -> None:
    """*CLOAD on every node of a set."""
    _renew(draft, k, draft.forces)
    sets, earlier = draft.mesh.node_sets, dict[tuple[int, int], list[str]]()  # forces by node and component
    for (name, d), (at, _) in draft.forces.items():
        for n in setnames.members(draft, k, sets, name, k.place) if at != draft.steps else ():
            earlier.setdefault((n, d), []).append(name)
    for line, words in k.data:
        chosen = dict.fromkeys(setnames.members(draft, k, sets, words[0], line))
        where = str(setnames.label(draft, words[0]) or setnames.key(sets, words[0]))
        component = k.whole(line, words[1])
        if not 1 <= component <= 3:
            raise k.error(f"*CLOAD in component {component}: wanted 1, 2 or 3", line)
        (value,) = k.numbers(line, filled(words[2:], ""))
        replaced = dict.fromkeys(name for n in chosen for name in earlier.pop((n, component - 1), ()))
        for name in (name for name in replaced if name != where):
            if not chosen.keys() >= set(setnames.members(draft, k, sets, name, line)):
                raise k.error(
                    f"*CLOAD replaces the force of an earlier step on a part of {name} alone: wanted the "
                    "sets of that step, or OP=NEW with all forces", line,
                )  # fmt: skip
            del draft.forces[name, component - 1]
        _put(draft, draft.forces, (where, component - 1), followed(draft, k, value))
