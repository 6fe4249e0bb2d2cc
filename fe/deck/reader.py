"""The case and the pressure of an Abaqus input deck. What is not understood is named with its line."""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from fe.case import Case
from fe.deck.draft import Draft
from fe.deck.hyperelastic import read_law
from fe.deck.keywords import Keyword, Place, read_keywords
from fe.deck.soundness import check_collapsed, check_turned
from fe.element import ELEMENTS, Array, Integers
from fe.laws import Material

# Read over: they change no displacement of a static solution.
SILENT = {
    "HEADING", "PREPRINT", "RESTART", "OUTPUT", "NODE OUTPUT", "ELEMENT OUTPUT", "CONTACT OUTPUT",
    "ENERGY OUTPUT", "NODE FILE", "EL FILE", "NODE PRINT", "EL PRINT", "ENERGY PRINT", "MONITOR", "PRINT",
    "STATIC", "END STEP", "END PART", "ASSEMBLY", "END ASSEMBLY", "END INSTANCE",
    "FILE FORMAT", "CONTROLS",
}  # fmt: skip
FARTHEST = 1e5  # mm from the origin
MOST_MEMBERS = 10_000_000  # of a set
HEAVIEST = 3e-8  # tonne/mm3: more than osmium
NAMED = {"ENCASTRE": (0, 1, 2), "PINNED": (0, 1, 2), "XSYMM": (0,), "YSYMM": (1,), "ZSYMM": (2,)}


@dataclass(frozen=True)
class Deck:
    """A structure, the follower pressure in MPa on its pressurised surface at the end of each step, and the
    gravity (3,) mm/s2 that its weight feels, the files that were read, and the numbers (e,) of its elements.
    """

    case: Case
    pressures: tuple[float, ...]
    gravity: Array
    files: tuple[Path, ...]
    elements: Integers


def read_deck(path: str | Path) -> Deck:
    """The case of a deck (its units are taken for mm, N, MPa), names of sets in small letters.

    Raises ValueError, with the line, for what is not supported or not complete; FileNotFoundError where there
    is no such file.
    """
    path = Path(path)
    text = read_keywords(path)
    keywords = text.keywords
    unknown = [k for k in keywords if k.name not in _READERS and k.name not in SILENT]
    if unknown:
        named = ", ".join(f"*{k.name} ({_where(k, path)})" for k in unknown)
        raise ValueError(
            f"{path}: not supported: {named}; wanted {', '.join('*' + n for n in _READERS)}; remove them or "
            "express them by these"
        )
    draft = Draft(str(path))
    for keyword in keywords:
        if keyword.name in _READERS:
            try:
                _READERS[keyword.name](draft, keyword)
            except IndexError:
                raise keyword.error(f"*{keyword.name}: its data lines hold too little; complete it") from None
    case = draft.case()
    numbers = np.array(sorted(draft.elements), np.int64)
    for check in (check_collapsed, check_turned):
        check(case, numbers, str(path))
    return Deck(case, tuple(draft.pressures) or (0.0,), draft.gravity, text.files, numbers)


def _where(k: Keyword, deck: Path) -> str:
    return f"line {k.place.line}" + ("" if k.place.file == deck else f" of {k.place.file}")


def _name(text: str) -> str:
    return text.strip('"').rpartition(".")[2].lower()


def _label(word: str) -> int | None:
    """The number that a word is, with or without the name of its instance, or None."""
    number = word.rpartition(".")[2]
    return int(number) if re.fullmatch("[0-9]{1,10}", number) else None


def _part(draft: Draft, k: Keyword) -> None:
    draft.parts += 1
    if draft.parts > 1:
        raise k.error("a second *PART: wanted one, as labels of two may be the same; merge the parts")


def _nodes(draft: Draft, k: Keyword) -> None:
    k.only("NSET")
    added: list[int] = []
    for line, words in k.data:
        _, *given = k.numbers(line, words[:4])
        label, x = k.whole(line, words[0], low=1), np.array([*given, 0.0, 0.0, 0.0][:3])
        if np.abs(x).max() > FARTHEST:
            raise k.error(f"node {label} lies farther than {FARTHEST:g} from the origin: wanted mm", line)
        if label in draft.nodes and not np.array_equal(x, draft.nodes[label]):
            raise k.error(f"node {label} is defined twice, at different places: wanted it once", line)
        draft.nodes[label] = x
        added.append(label)
    if "NSET" in k.parameters:
        _join(draft.node_sets.setdefault(_name(k.text("NSET")), []), added)


def _join(members: list[int], more: Iterable[int]) -> None:
    """Add to a set what is not in it yet."""
    members[:] = dict.fromkeys([*members, *more])


def _elements(draft: Draft, k: Keyword) -> None:
    kind = k.parameters.get("TYPE", "").upper()
    if kind not in ELEMENTS:
        wanted = ", ".join(name for name in ELEMENTS if name != "hex27")
        raise k.error(f"element type {kind or 'absent'}: wanted one of {wanted}; mesh it with one")
    count, record, added = len(ELEMENTS[kind].local), list[int](), list[int]()
    for line, words in k.data:
        record += k.wholes(line, [w for w in words if w], low=1)
        if len(record) > count + 1:
            raise k.error(f"element {record[0]} has {len(record) - 1} nodes; {kind} wants {count}", line)
        if len(record) == count + 1:
            if draft.elements.setdefault(record[0], (kind, record[1:])) != (kind, record[1:]):
                raise k.error(f"element {record[0]} is defined twice, with other nodes: wanted it once", line)
            added.append(record[0])
            record = []
    if record:
        raise k.error(f"element {record[0]} has {len(record) - 1} nodes; {kind} wants {count}")
    if "ELSET" in k.parameters:
        _join(draft.element_sets.setdefault(_name(k.text("ELSET")), []), added)


def _set(sets: str, parameter: str) -> Callable[[Draft, Keyword], None]:
    def read(draft: Draft, k: Keyword) -> None:
        known = getattr(draft, sets)
        members = dict.fromkeys(known.setdefault(_name(k.text(parameter)), []))
        for line, words in k.data:
            given = [w for w in words if w]
            if "GENERATE" in k.parameters:
                members |= dict.fromkeys(_generated(k, line, given))
                continue
            for word in given:
                members |= dict.fromkeys(_members(k, known, word, line))
        if parameter == "NSET" and "ELSET" in k.parameters:
            elements = _known(k, draft.element_sets, k.text("ELSET"), k.place)
            members |= dict.fromkeys(sorted({n for e in elements for n in draft.elements[e][1]}))
        known[_name(k.text(parameter))] = list(members)

    return read


def _generated(k: Keyword, line: Place, words: list[str]) -> range:
    first, last, step = k.wholes(line, [*words, "1"][:3], low=1)
    members = range(first, last + 1, step)
    if not 0 < len(members) <= MOST_MEMBERS:
        raise k.error(
            f"{first}, {last}, {step}: wanted first <= last and at most {MOST_MEMBERS} members", line
        )
    return members


def _known(k: Keyword, sets: dict[str, list[int]], word: str, line: Place) -> list[int]:
    if _name(word) not in sets:
        raise k.error(
            f"set {word}: not defined above; wanted one of {', '.join(sorted(sets)) or 'none'}", line
        )
    return sets[_name(word)]


def _members(k: Keyword, sets: dict[str, list[int]], word: str, line: Place) -> list[int]:
    label = _label(word)
    return _known(k, sets, word, line) if label is None else [label]


def _surface(draft: Draft, k: Keyword) -> None:
    if k.parameters.get("TYPE", "ELEMENT").upper() != "ELEMENT":
        raise k.error(f"*SURFACE of type {k.parameters['TYPE']}: wanted TYPE=ELEMENT with faces S1, S2 ..")
    faces = dict.fromkeys(draft.surfaces.setdefault(_name(k.text("NAME")), []))
    for line, words in k.data:
        face = _face(k, line, words[1] if len(words) > 1 else "", "S")
        faces |= dict.fromkeys((e, face) for e in _members(k, draft.element_sets, words[0], line))
    draft.surfaces[_name(k.text("NAME"))] = list(faces)


def _face(k: Keyword, line: Place, word: str, letter: str) -> int:
    found = re.fullmatch(f"{letter}([1-6])", word.upper())
    if not found:
        raise k.error(f"face {word[:20] or 'absent'}: wanted {letter}1, {letter}2 .. {letter}6", line)
    return int(found[1]) - 1


def _material(draft: Draft, k: Keyword) -> None:
    draft.material = _name(k.text("NAME"))


def _hyperelastic(draft: Draft, k: Keyword) -> None:
    _add(draft, read_law(k))


def _mullins(draft: Draft, k: Keyword) -> None:
    if k.parameters:
        raise k.error(
            f"*MULLINS EFFECT, {', '.join(k.parameters)}: wanted constants; let Abaqus print its fit"
        )
    if draft.material not in draft.materials:
        raise k.error("*MULLINS EFFECT before *HYPERELASTIC: wanted it below; move it")
    line, words = k.data[0]
    r, m, beta = (*k.numbers(line, [w for w in words if w]), 0.0, 0.0, 0.0)[:3]
    if r <= 1 or m < 0 or beta < 0 or m + beta <= 0:
        raise k.error(f"*MULLINS EFFECT r {r:g}, m {m:g}, beta {beta:g}: wanted r > 1 and m, beta >= 0", line)
    draft.materials[draft.material] = replace(draft.materials[draft.material], mullins=(1 / r, m, beta))


def _add(draft: Draft, law: Material) -> None:
    """The law of the material that is being read; its density may stand before it."""
    draft.materials[draft.material] = replace(law, density=draft.densities.get(draft.material, 0.0))


def _density(draft: Draft, k: Keyword) -> None:
    line, words = k.data[0]
    (density,) = k.numbers(line, words[:1])
    if not 0 <= density <= HEAVIEST:
        raise k.error(f"*DENSITY {density:g}: wanted tonne/mm3, such as 1.07e-09 for 1070 kg/m3", line)
    draft.densities[draft.material] = density
    if draft.material in draft.materials:
        _add(draft, draft.materials[draft.material])


def _section(draft: Draft, k: Keyword) -> None:
    draft.sections[_name(k.text("ELSET"))] = _name(k.text("MATERIAL"))


def _instance(draft: Draft, k: Keyword) -> None:
    draft.instances += 1
    if draft.instances > 1:
        raise k.error("a second *INSTANCE: wanted one; merge the parts in the assembly")
    moved = [k.numbers(line, [w for w in words if w]) for line, words in k.data]
    if any(any(row) for row in moved) and not draft.nodes:
        raise k.error("an *INSTANCE that is moved and has its own nodes: wanted one in place")
    draft.nodes = {label: _placed(x, moved) for label, x in draft.nodes.items()}


def _placed(x: Array, moved: list[list[float]]) -> Array:
    """Where an instance puts a node: translated, then turned about an axis through two points, in degrees."""
    if moved:
        x = x + np.array([*moved[0], 0.0, 0.0, 0.0][:3])
    if len(moved) > 1:
        a, b, degrees = np.array(moved[1][:3]), np.array(moved[1][3:6]), moved[1][6]
        if np.array_equal(a, b):
            raise IndexError  # no axis: too few numbers
        turn = Rotation.from_rotvec(np.radians(degrees) * (b - a) / np.linalg.norm(b - a))
        x = a + turn.apply(x - a)
    return np.asarray(x, float)


def _boundary(draft: Draft, k: Keyword) -> None:
    k.only("OP")
    if k.parameters.get("OP", "MOD").upper() == "NEW":
        raise k.error("*BOUNDARY, OP=NEW: wanted boundary conditions that stay; leave OP out")
    for line, words in k.data:
        where, label = _name(words[0]), _label(words[0])
        if label is not None:
            where = f"node_{label}"
            draft.node_sets.setdefault(where, [label])
        else:
            _known(k, draft.node_sets, where, line)
        if words[1].upper() in NAMED:
            draft.supports += [(where, d, 0.0) for d in NAMED[words[1].upper()]]
            continue
        first = k.whole(line, words[1], low=1, high=6)
        last = k.whole(line, words[2], low=first, high=6) if len(words) > 2 and words[2] else first
        value = k.numbers(line, words[3:4])[0] if len(words) > 3 else 0.0
        draft.supports += [(where, d - 1, value) for d in range(first, last + 1) if d <= 3]  # no rotations


def _step(draft: Draft, k: Keyword) -> None:
    if k.parameters.get("NLGEOM", "NO" if "NLGEOM" not in k.parameters else "YES").upper() == "NO":
        raise k.error("*STEP without NLGEOM: wanted NLGEOM=YES, as displacements are large here")


def _dsload(draft: Draft, k: Keyword) -> None:
    k.only("OP")
    for line, words in k.data:
        name = _name(words[0])
        if name not in draft.surfaces:
            raise k.error(f"surface {words[0]}: not defined; wanted one of {', '.join(draft.surfaces)}", line)
        if words[1].upper() != "P":
            raise k.error(f"*DSLOAD {words[1]}: wanted P, a pressure", line)
        draft.loads[name] = k.numbers(line, words[2:3])[0]
    _note_pressure(draft, k)


def _dload(draft: Draft, k: Keyword) -> None:
    k.only("OP")
    for line, words in k.data:
        if words[1].upper() == "GRAV":
            _gravity(draft, k, line, words)
            continue
        face = _face(k, line, words[1], "P")
        members = [(e, face) for e in _members(k, draft.element_sets, words[0], line)]
        name, value = f"dload_{words[2]}", k.numbers(line, words[2:3])[0]
        draft.surfaces.setdefault(name, []).extend(members)
        draft.loads[name] = value
    if any(words[1].upper() != "GRAV" for _, words in k.data):
        _note_pressure(draft, k)


def _gravity(draft: Draft, k: Keyword, line: Place, words: list[str]) -> None:
    if words[0] and len(set(_members(k, draft.element_sets, words[0], line))) < len(draft.elements):
        raise k.error(f"GRAV on {words[0]}, a part of the elements: wanted all of them", line)
    size, *direction = k.numbers(line, words[2:6])
    length = float(np.linalg.norm(direction))
    if len(direction) != 3 or not length:
        raise k.error("GRAV: wanted its size in mm/s2 and a direction of three components", line)
    draft.gravity = size * np.array(direction) / length


def _note_pressure(draft: Draft, k: Keyword) -> None:
    values = sorted(set(draft.loads.values()))
    if len(values) > 1:
        raise k.error(f"pressures of {', '.join(f'{v:g}' for v in values)} MPa at once: wanted one pressure")
    draft.pressures.append(values[0])


def _cload(draft: Draft, k: Keyword) -> None:
    k.only("OP")
    for line, words in k.data:
        where, label = _name(words[0]), _label(words[0])
        if label is None:
            _known(k, draft.node_sets, where, line)
        component = k.whole(line, words[1])
        if not 1 <= component <= 3:
            raise k.error(f"*CLOAD in component {component}: wanted 1, 2 or 3", line)
        draft.forces[where if label is None else str(label), component - 1] = k.numbers(line, words[2:3])[0]


_READERS: dict[str, Callable[[Draft, Keyword], None]] = {
    "PART": _part,
    "NODE": _nodes,
    "ELEMENT": _elements,
    "NSET": _set("node_sets", "NSET"),
    "ELSET": _set("element_sets", "ELSET"),
    "SURFACE": _surface,
    "MATERIAL": _material,
    "HYPERELASTIC": _hyperelastic,
    "MULLINS EFFECT": _mullins,
    "DENSITY": _density,
    "SOLID SECTION": _section,
    "BOUNDARY": _boundary,
    "STEP": _step,
    "DSLOAD": _dsload,
    "DLOAD": _dload,
    "CLOAD": _cload,
    "INSTANCE": _instance,
}
