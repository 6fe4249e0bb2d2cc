"""The element that each Abaqus type of a deck is read as, and the one type that a case has."""

from collections.abc import Callable

from fe.element import ELEMENTS

KINDS = {name: len(e.local) for name, e in ELEMENTS.items() if name != "hex27"}  # and their nodes


def nodes_of(kind: str) -> int | None:
    """How many nodes an element of that type has; None where it cannot be read."""
    return KINDS.get(kind)


def one_type(found: set[str], file: str, remark: Callable[[str], None]) -> str:
    """The one type of element that those found become. ValueError where they are of several."""
    kind, *others = sorted(found)
    if others:
        raise ValueError(
            f"{file}: elements of the types {', '.join([kind, *others])} in one model: wanted one "
            "type; mesh it with one"
        )
    return kind
