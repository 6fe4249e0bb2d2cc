"""Fitted values in words: two digits, the unit, and a direction in place of a sign."""

from collections.abc import Sequence

from twin.targets import Array


def number(value: float) -> str:
    """The size of a value with two digits, whole from 100 on.

    >>> number(-0.01234), number(1234.5), percent(0.0347)
    ('0.012', '1234', '3.5 %')
    """
    size = abs(value)
    return f"{size:.0f}" if 99.5 <= size < 1e6 else f"{size:.2g}"


def percent(share: float) -> str:
    """The size of a share in percent."""
    return f"{number(100 * share)} %"


def way(value: float, more: str, less: str) -> str:
    """The word for a value above 0, or below."""
    return more if value >= 0 else less


def listed(parts: Sequence[str]) -> str:
    """Parts as a list in a sentence.

    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    return " and ".join(filter(None, [", ".join(parts[:-1]), *parts[-1:]]))


def felt(values: Sequence[float], part: float = 0.1) -> list[int]:
    """Indices of the values that are at least `part` of the largest, in their order."""
    most = max(map(abs, values), default=0.0)
    return [k for k, value in enumerate(values) if abs(value) >= part * most > 0]


def pull(along: float, up: float, unit: str) -> str:
    """A force in words, by its components along the finger and up.

    >>> pull(0.05, 0.12, "N")
    '0.12 N up and 0.05 N towards the tip'
    """
    parts = [f"{number(up)} {unit} {way(up, 'up', 'down')}",
            f"{number(along)} {unit} {way(along, 'towards the tip', 'towards the clamp')}"]  # fmt: skip
    return listed([parts[k] for k in felt((up, along))]) or f"0 {unit}"


def at_place(share: float) -> str:
    """A place along the finger, from 0 at the clamp to 1 at the tip."""
    return "at its tip" if share > 0.99 else f"at {number(share)} of its length"


def at_ends(base: float, tip: float, unit: str, more: str, less: str) -> str:
    """Deviations at the base and at the tip of a chamber, in words.

    >>> at_ends(0.4, -0.1, "mm", "too high", "too low")
    '0.4 mm too high at its base and 0.1 mm too low at its tip'
    """
    ends = ((base, "at its base"), (tip, "at its tip"))
    return listed([f"{number(off)} {unit} {way(off, more, less)} {place}" for off, place in ends])


def where(place: float) -> str:
    """A place along the finger, from 0 at the clamp to 1 at the tip, in words."""
    if place >= 0.85:
        return "near the tip"
    return "near the clamp" if place <= 0.15 else f"at {place:.2g} of the length from the clamp"


def softer(much: float) -> str:
    """The softening of a material in percent, in words; stiffening where negative."""
    return f"{100 * abs(much):.2g} % {'softer' if much > 0 else 'stiffer'}"


def direction(vector: Array) -> str:
    """The direction of a vector (3,) in words: its largest component, and another of more than half its size.

    >>> import numpy as np
    >>> direction(np.array([0.1, 0.0, -0.3]))
    'down'
    """
    pairs = (("towards the tip", "towards the clamp"), ("to +y", "to -y"), ("up", "down"))
    order = sorted(range(3), key=lambda i: -abs(vector[i]))
    main, second = (pairs[i][int(vector[i] < 0)] for i in order[:2])
    both = abs(vector[order[1]]) > 0.5 * abs(vector[order[0]])
    return f"{main} and {second}" if both else main
