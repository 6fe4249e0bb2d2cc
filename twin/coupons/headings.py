"""Quantity and unit of a column of a tensile tester's export, from its heading."""

import re
from collections.abc import Sequence
from typing import Literal

import numpy as np

from twin.gauge.pressureunits import TIME, in_MPa, in_seconds, is_pressure, time_unit
from twin.gauge.pressureunits import unit_of as pressure_unit

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
# Factor from each unit to mm, N, MPa, s, or a share; stress and time have more, those of pressure logs.
UNITS: dict[Quantity, dict[str, float]] = {
    "strain": {"%": 0.01, "1": 1.0, "mm/mm": 1.0, "m/m": 1.0, "-": 1.0},
    "stretch": {"1": 1.0, "mm/mm": 1.0, "m/m": 1.0, "-": 1.0, "%": 0.01},
    "displacement": {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3, "µm": 1e-3, "in": 25.4},
    "stress": {"MPa": 1.0, "N/mm2": 1.0, "kPa": 1e-3, "Pa": 1e-6, "psi": 0.00689476, "bar": 0.1},
    "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "gf": 0.00980665, "kgf": 9.80665, "lbf": 4.44822},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
}


def factor_of(unit: str, quantity: Quantity) -> float | None:
    """Factor from a unit to mm, N, MPa, s or a share, None for a unit of another quantity.

    >>> factor_of("kN", "force"), factor_of("kgf/cm2", "stress"), factor_of("N", "stress")
    (1000.0, 0.0980665, None)
    """
    if unit in UNITS[quantity]:
        return UNITS[quantity][unit]
    try:
        if quantity == "time" and unit:
            return float(in_seconds(np.ones(1), time_unit(unit, what=""))[0])
        if quantity == "stress" and is_pressure(unit):
            return round(float(in_MPa(np.ones(1), pressure_unit(unit, what=""), line=None)[0]), 12)
    except ValueError:
        pass
    return None


def speaks_of(heading: str, quantity: Quantity) -> bool:
    """True for a heading that names a quantity: Tensile stress (MPa), Standardkraft [N], strain_percent.

    >>> speaks_of("Standardkraft [N]", "force"), speaks_of("Time (s)", "force")
    (True, False)
    """
    words = re.findall(r"[^\W\d_]+", heading.lower())
    own = quantity == "time" and (heading.strip().lower() in TIME or words[:1] == ["elapsed"])
    return own or any(word.endswith(WORDS[quantity]) for word in words)


def of_quantity(headings: Sequence[str], quantities: Sequence[Quantity]) -> list[tuple[str, Quantity]]:
    """The headings that name any of some quantities, each with its quantity."""
    return [(name, q) for name in headings for q in quantities if speaks_of(name, q)]


def own_unit(heading: str, quantity: Quantity, below: str = "") -> str:
    """The unit that a heading states, or the cell below it; "" where neither does.

    >>> own_unit("Tensile stress (MPa)", "stress"), own_unit("strain_percent", "strain")
    ('MPa', '%')
    >>> own_unit("Force", "force", below="[kN]")
    'kN'
    """
    match = re.search(r"[\[(]\s*([^\])]*?)\s*[\])]\s*$|(?:/|\bin)\s*(\S+)$|_([^\W_]+)$", heading.strip())
    unit = next((part for part in match.groups() if part), "") if match else ""
    if unit == "percent":
        unit = "%"
    return next((u for u in (unit, below.strip("[]() ")) if factor_of(u, quantity) is not None), "")


def unit_of(
    heading: str, quantity: Quantity, *, below: str, stated_unit: str | None, where: str, key: str
) -> float:
    """Factor from a column's unit to mm, N, MPa, s or a share.

    below: the cell under the heading; stated_unit: of twin.toml, under a key; where: the column's name in an
    error. ValueError without a unit, for two that differ, or for a unit of another quantity.

    >>> unit_of("Force", "force", below="kN", stated_unit=None, where="pull.csv", key="stress_unit")
    1000.0
    """
    heading_unit, units = own_unit(heading, quantity, below), ", ".join(UNITS[quantity])
    stated = None if stated_unit is None else factor_of(stated_unit, quantity)
    if stated_unit is not None and stated is None:
        raise ValueError(f"{key} = {stated_unit!r}: wanted a unit of {quantity}, one of {units}")
    if stated_unit is not None and heading_unit and factor_of(heading_unit, quantity) != stated:
        raise ValueError(f"{where} says {heading_unit}, {key} of twin.toml says {stated_unit}; wanted one "
                         "unit: correct the heading or the key")  # fmt: skip
    unit = stated_unit or heading_unit
    if not unit and quantity != "stretch":
        raise ValueError(f"{where} has no unit of {quantity}: wanted one of {units}; write {key} = ... in "
                         "[[material_tests]] of twin.toml")  # fmt: skip
    factor = factor_of(unit or "1", quantity)
    assert factor is not None
    return factor
