"""What the headings of a tensile tester's export mean: which quantity a column has, and in which unit."""

import re
from collections.abc import Mapping, Sequence
from typing import Literal

Quantity = Literal["strain", "stretch", "displacement", "stress", "force", "time"]
# How a word of a heading ends that speaks of a quantity, in English and in German.
WORDS: dict[Quantity, tuple[str, ...]] = {
    "strain": ("strain", "dehnung"),
    "stretch": ("stretch", "lambda"),
    "displacement": ("displacement", "extension", "crosshead", "position", "weg"),
    "stress": ("stress", "spannung"),
    "force": ("force", "load", "kraft"),
    "time": ("time", "zeit"),
}
_STRESS = {"MPa": 1.0, "N/mm2": 1.0, "N/mm^2": 1.0, "N/mm²": 1.0, "kPa": 1e-3, "Pa": 1e-6, "psi": 0.00689476,
           "bar": 0.1}  # fmt: skip
# What one of each unit is in mm, N, MPa, s, or as a share.
UNITS: dict[Quantity, dict[str, float]] = {
    "strain": {"%": 0.01, "1": 1.0, "mm/mm": 1.0, "m/m": 1.0, "-": 1.0},
    "stretch": {"1": 1.0, "mm/mm": 1.0, "m/m": 1.0, "-": 1.0, "%": 0.01},
    "displacement": {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3, "µm": 1e-3, "in": 25.4},
    "stress": _STRESS,
    "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "gf": 0.00980665, "kgf": 9.80665, "lbf": 4.44822},
    "time": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0},
}


def speaks_of(heading: str, quantity: Quantity) -> bool:
    """Whether a heading is one of a quantity: Tensile stress (MPa), Standardkraft [N], strain_percent."""
    words = re.findall(r"[^\W\d_]+", heading.lower())
    return any(word.endswith(WORDS[quantity]) for word in words)


def of_quantity(headings: Sequence[str], quantities: Sequence[Quantity]) -> list[tuple[str, Quantity]]:
    """The headings that speak of one of some quantities, with that."""
    return [(name, q) for name in headings for q in quantities if speaks_of(name, q)]


def own_unit(heading: str, quantity: Quantity, below: str = "") -> str:
    """The unit that a heading states, or the cell below it; "" where neither does."""
    stated = re.search(r"[\[(]\s*([^\])]*?)\s*[\])]\s*$|(?:/|\bin)\s*(\S+)$|_([^\W_]+)$", heading.strip())
    found = next((part for part in stated.groups() if part), "") if stated else ""
    if found == "percent":
        found = "%"
    if found in UNITS[quantity]:
        return found
    return below.strip("[]() ") if below.strip("[]() ") in UNITS[quantity] else ""


def unit_of(heading: str, quantity: Quantity, *, below: str, told: str | None, where: str, key: str) -> float:
    """What one of a column's unit is in mm, N, MPa, s or as a share.

    below: the cell under the heading; told: the unit that twin.toml states under a key; where: how an error
    names the column. ValueError where there is none, two that differ, or one that is none of the quantity.
    """
    known: Mapping[str, float] = UNITS[quantity]
    own = own_unit(heading, quantity, below)
    wanted = ", ".join(known)
    if told is not None and told not in known:
        raise ValueError(f"{key} = {told!r}: wanted a unit of {quantity}, one of {wanted}")
    if told is not None and own and known[own] != known[told]:
        raise ValueError(f"{where} says {own}, {key} of twin.toml says {told}; wanted one unit: correct the "
                         "heading or the key")  # fmt: skip
    unit = told or own
    if not unit and quantity != "stretch":
        raise ValueError(f"{where} has no unit of {quantity}: wanted one of {wanted}; write {key} = ... in "
                         "[[material_tests]] of twin.toml")  # fmt: skip
    return known[unit or "1"]
