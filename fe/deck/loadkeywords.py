"""Keywords that state supports and loads."""

import numpy as np

from fe.deck import setnames
from fe.deck.draft import Draft
from fe.deck.keywords import Keyword, Place
from fe.deck.meshkeywords import face
from fe.deck.setnames import small

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
    k.only("OP", "AMPLITUDE")
    if k.parameters.get("OP", "MOD").upper() == "NEW":
        raise k.error("*BOUNDARY, OP=NEW: wanted boundary conditions that stay; leave OP out")
    for line, words in k.data:
        where = _set_of(draft, k, line, words[0])
        if words[1].upper() in NAMED:
            draft.supports += [(where, d, 0.0) for d in NAMED[words[1].upper()]]
            draft.turning += [(where, d, 0.0) for d in TURNING.get(words[1].upper(), ())]
            continue
        low = k.whole(line, words[1], low=1, high=6)
        high = k.whole(line, words[2], low=low, high=6) if len(words) > 2 and words[2] else low
        value = k.numbers(line, words[3:4])[0] if len(words) > 3 else 0.0
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
    table = [v for line, words in k.data for v in k.numbers(line, words)]
    peak = max(table[1::2], key=abs, default=0.0)
    if not peak:
        raise k.error("*AMPLITUDE of nothing but 0: wanted times and values, such as 0., 0., 1., 1.")
    absolute = k.parameters.get("VALUE", "RELATIVE").upper().startswith("ABS")
    draft.amplitudes[small(k.text("NAME"))] = peak, absolute
    draft.tables[small(k.text("NAME"))] = tuple(v / peak if n % 2 else v for n, v in enumerate(table))


def followed(draft: Draft, k: Keyword, value: float) -> float:
    """Value of a load that may follow an amplitude, at the amplitude's peak."""
    amplitude = k.parameters.get("AMPLITUDE", "")
    if not amplitude:
        return value
    if small(amplitude) not in draft.amplitudes:
        raise k.error(f"*{k.name}, AMPLITUDE={amplitude}: not defined above; wanted *AMPLITUDE before it")
    factor, absolute = draft.amplitudes[small(amplitude)]
    draft.remark(f"*{k.name} follows the amplitude {amplitude}: it is read at its largest value, {factor:g}.")
    return factor if absolute else factor * value


def dsload(draft: Draft, k: Keyword) -> None:
    """*DSLOAD, a pressure on a surface."""
    k.only("OP", "AMPLITUDE")
    for line, words in k.data:
        name = setnames.key(draft.mesh.surfaces, words[0])
        if name is None:
            raise k.error(
                f"surface {words[0]}: not defined; wanted one of {', '.join(draft.mesh.surfaces)}", line
            )
        if words[1].upper() != "P":
            raise k.error(f"*DSLOAD {words[1]}: wanted P, a pressure", line)
        _note_pressure(draft, k, name, followed(draft, k, k.numbers(line, words[2:3])[0]))


def dload(draft: Draft, k: Keyword) -> None:
    """*DLOAD: a pressure on faces of elements, or a weight."""
    k.only("OP", "AMPLITUDE")
    for line, words in k.data:
        if words[1].upper() == "GRAV":
            _gravity(draft, k, line, words)
            continue
        side = face(k, line, words[1], "P")
        chosen = setnames.members(draft, k, draft.mesh.element_sets, words[0], line)
        name, value = f"dload_{words[2]}", followed(draft, k, k.numbers(line, words[2:3])[0])
        draft.mesh.surfaces.setdefault(name, []).extend((e, side) for e in chosen)
        _note_pressure(draft, k, name, value)


def _gravity(draft: Draft, k: Keyword, line: Place, words: list[str]) -> None:
    sets, count = draft.mesh.element_sets, len(draft.mesh.elements)
    if words[0] and len(set(setnames.members(draft, k, sets, words[0], line))) < count:
        raise k.error(f"GRAV on {words[0]}, a part of the elements: wanted all of them", line)
    size, *direction = k.numbers(line, words[2:6])
    length = float(np.linalg.norm(direction))
    if len(direction) != 3 or not length:
        raise k.error("GRAV: wanted its size in mm/s2 and a direction of three components", line)
    draft.gravity = size * np.array(direction) / length


def _note_pressure(draft: Draft, k: Keyword, name: str, value: float) -> None:
    """Keep a surface's pressure, what it follows, and all that act in this step, as loads stay."""
    table = draft.tables.get(small(k.parameters.get("AMPLITUDE", "")), ())
    draft.loads[name] = value
    draft.courses.setdefault(name, (draft.steps, table))
    draft.pressed[draft.steps] = k, dict(draft.loads)


def settle(draft: Draft) -> None:
    """Complete the draft's loads after the last step: the pressure of every step, and the share of each
    surface."""
    for k, loads in draft.pressed.values():
        top = max(loads.values(), key=abs)
        draft.pressures.append(top)
        grown = [loads[name] / share for name, share in draft.shares.items() if share]
        if grown and top and not np.allclose(grown, grown[0]):
            raise k.error("pressures in another ratio than in the step before: wanted one ratio in all steps")
        if top:
            draft.shares = {name: value / top for name, value in loads.items()}
    if not set(draft.shares.values()) - {1.0}:
        draft.shares = {}
    if draft.shares:
        listed = ", ".join(f"{share:.4g} on {name}" for name, share in draft.shares.items())
        draft.remark(f"Surfaces carry shares of one pressure, which the log gives: {listed}.")
    if len(set(draft.courses.values())) > 1:
        draft.remark(
            f"{' and '.join(draft.courses)} are not filled at one time in the deck: in the model their "
            "pressures rise together. Where a film fills one and another film the other, state "
            "pressure_shares in each."
        )


def cload(draft: Draft, k: Keyword) -> None:
    """*CLOAD on every node of a set."""
    k.only("OP", "AMPLITUDE")
    for line, words in k.data:
        label = setnames.label(draft, words[0])
        if label is None:
            setnames.known(k, draft.mesh.node_sets, words[0], line)
        where = str(label or setnames.key(draft.mesh.node_sets, words[0]))
        component = k.whole(line, words[1])
        if not 1 <= component <= 3:
            raise k.error(f"*CLOAD in component {component}: wanted 1, 2 or 3", line)
        draft.forces[where, component - 1] = followed(draft, k, k.numbers(line, words[2:3])[0])
