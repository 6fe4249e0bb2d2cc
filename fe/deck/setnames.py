"""Names of sets and labels as keywords state them: `12`, `Root`, `Finger-1.Root`, `"A set"`."""

import re
from collections.abc import Mapping
from typing import TypeVar

from fe.deck.draft import Draft
from fe.deck.keywords import Keyword, Place
from fe.deck.meshdraft import MeshDraft

T = TypeVar("T")


def small(text: str) -> str:
    """A name in small letters, without quotation marks, with its instance where stated.

    >>> small('"Finger-1".Root')
    'finger-1.root'
    """
    return text.strip('"').replace('".', ".").replace('."', ".").lower()


def plain(text: str) -> str:
    """A name without the name of its instance.

    >>> plain('"Finger-1".Root')
    'root'
    """
    return small(text).rpartition(".")[2]


def label(draft: Draft, word: str, instance: str = "") -> int | None:
    """The label that a word states, with or without its instance; None for a name."""
    before, _, number = word.rpartition(".")
    if not re.fullmatch("[0-9]{1,10}", number):
        return None
    return int(number) + draft.numbered.get(small(before) or instance, 0)


def key(sets: Mapping[str, T], word: str) -> str | None:
    """The name under which a set is stored: with its instance if two instances have a set so named; None if
    there is no such set."""
    return next((name for name in (small(word), plain(word)) if name in sets), None)


def known(k: Keyword, sets: Mapping[str, T], word: str, line: Place) -> T:
    """The set that a word names. ValueError if it is not defined."""
    name = key(sets, word)
    if name is None:
        raise k.error(
            f"set {word}: not defined above; wanted one of {', '.join(sorted(sets)) or 'none'}", line
        )
    return sets[name]


def members(
    draft: Draft, k: Keyword, sets: dict[str, list[int]], word: str, line: Place, instance: str = ""
) -> list[int]:
    """Labels that a word denotes: the label itself, or the members of a set."""
    number = label(draft, word, instance)
    return known(k, sets, word, line) if number is None else [number]


def opened(draft: Draft, sets: str, word: str, empty: T) -> T:
    """The set of that name, to be filled; a new one if the name came with an instance, whose set is then
    stored under the instance's name."""
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


def renamed(named: dict[str, T], name: str, new_name: str) -> None:
    """Move an entry of a dict from the key `name` to `new_name`, if it exists."""
    if name in named:
        named[new_name] = named.pop(name)
