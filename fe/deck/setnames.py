"""Labels and names as keywords state them: `12`, `Root`, `Finger-1.Root`, `"A set"`."""

import re
from collections.abc import Mapping
from typing import TypeVar

from fe.deck.draft import Draft
from fe.deck.keywords import Keyword, Place
from fe.deck.meshdraft import MeshDraft

T = TypeVar("T")


def small(text: str) -> str:
    """A name in small letters, without quotation marks, with the instance before it if that is stated."""
    return text.strip('"').replace('".', ".").replace('."', ".").lower()


def plain(text: str) -> str:
    """A name without that of its instance."""
    return small(text).rpartition(".")[2]


def label(draft: Draft, word: str, instance: str = "") -> int | None:
    """The label that a word is, with or without the name of its instance before it, or None."""
    before, _, number = word.rpartition(".")
    if not re.fullmatch("[0-9]{1,10}", number):
        return None
    return int(number) + draft.numbered.get(small(before) or instance, 0)


def key(sets: Mapping[str, T], word: str) -> str | None:
    """The name under which a set is known: with its instance where two have it, else without; or None."""
    return next((name for name in (small(word), plain(word)) if name in sets), None)


def known(k: Keyword, sets: Mapping[str, T], word: str, line: Place) -> T:
    """The set that a word names. ValueError where it is not defined above."""
    found = key(sets, word)
    if found is None:
        raise k.error(
            f"set {word}: not defined above; wanted one of {', '.join(sorted(sets)) or 'none'}", line
        )
    return sets[found]


def members(
    draft: Draft, k: Keyword, sets: dict[str, list[int]], word: str, line: Place, instance: str = ""
) -> list[int]:
    """The labels that a word means: its own, or those of the set that it names."""
    found = label(draft, word, instance)
    return known(k, sets, word, line) if found is None else [found]


def opened(draft: Draft, sets: str, word: str, empty: T) -> T:
    """The set of that name, to be filled: a new one where the name came with an instance, whose own set then
    goes by the instance's name."""
    mesh, name = draft.here, plain(word)
    named: dict[str, T] = getattr(mesh, sets)
    instance = mesh.inherited.pop((sets, name), None)
    if instance is not None:
        apart(mesh, sets, name, instance)
    return named.setdefault(name, empty)


def apart(mesh: MeshDraft, sets: str, name: str, instance: str) -> None:
    """Give a set, and the section that stands on it, the name of its instance."""
    stays = getattr(mesh, sets)
    stays[f"{instance}.{name}"] = stays.pop(name)
    if sets == "element_sets":
        renamed(mesh.sections, name, f"{instance}.{name}")
        renamed(mesh.sheet_sections, name, f"{instance}.{name}")


def renamed(named: dict[str, T], name: str, other: str) -> None:
    """Give what goes by a name another one."""
    if name in named:
        named[other] = named.pop(name)
