"""An instrument's export -> columns of numbers: quantity and unit of each from its heading."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from twin.csvtable import Sheet, read_recording, together
from twin.gauge.pressureunits import TIME, in_MPa, in_seconds, is_pressure, time_unit
from twin.gauge.pressureunits import unit_of as pressure_unit
from twin.targets import Array

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


@dataclass(frozen=True)
class SoughtColumn:
    """A column to be found in an export: any of some quantities, by its heading where twin.toml names it.

    key: of twin.toml, for errors; unit: the one that twin.toml states, under unit_key.
    """

    quantities: tuple[Quantity, ...]
    key: str
    heading: str | None = None
    unit: str | None = None
    unit_key: str = ""

    def among(self, headings: Sequence[str]) -> list[tuple[str, Quantity]]:
        """The headings that may be meant, each with its quantity."""
        if self.heading is None:
            return of_quantity(headings, self.quantities)
        spoken = of_quantity([self.heading], self.quantities)
        return [(self.heading, spoken[0][1] if spoken else self.quantities[0])] * headings.count(self.heading)


@dataclass(frozen=True)
class ExportColumn:
    """A column of an export: its heading, its quantity, its values (k,) in mm, N, MPa, s or as a share."""

    heading: str
    quantity: Quantity
    values: Array


@dataclass(frozen=True)
class Export:
    """The columns that were sought in an export, None for an optional one that it has not; and the lines on
    which its header stands, once for each specimen."""

    columns: list[ExportColumn | None]
    headers: tuple[int, ...]


def read_export(
    path: Path, required: Sequence[SoughtColumn], *, also: Sequence[SoughtColumn] = (), number: int = 1
) -> Export:
    """The required columns, and the optional ones of `also`.

    The header is the first line that has them all, or that for a specimen of another number. ValueError with
    all that is wrong: no line has them, several columns may be meant, a unit is missing, a cell is no number.
    """
    what = " and ".join(_said(sought) for sought in required)
    sheet = read_recording(path, lambda row: _is_header(row, required), wanted=what, number=number)
    if not _is_header(sheet.header, required):
        raise ValueError(f"{path}: no line has headings of {what}; name the columns in [[material_tests]] of "
                         "twin.toml as they stand in the file")  # fmt: skip
    columns: list[ExportColumn | None] = []

    def find(sought: SoughtColumn) -> None:
        every = list(dict.fromkeys(sought.among(sheet.header)))
        count = max([len(every), *(sheet.header.count(name) for name, _ in every)])
        way = f"say which with {sought.key} = \"...\" in [[material_tests]] of twin.toml"
        way = way if len(every) > 1 else "rename all but one in the file"
        if count > 1:
            names = " and ".join(repr(name) for name, _ in every)
            times = f" (it stands there {count} times)" if len(every) == 1 else ""
            raise ValueError(f"{path}: {names}{times} may all be meant; {way}")
        columns.append(_column(sheet, sought, *every[0]) if every else None)

    together(path, *(lambda sought=sought: find(sought) for sought in (*required, *also)))
    return Export(columns, sheet.again)


def _column(sheet: Sheet, sought: SoughtColumn, name: str, quantity: Quantity) -> ExportColumn:
    where = f"{sheet.path}: column {name!r}"
    factor = unit_of(name, quantity, below=sheet.units.get(name, ""), stated_unit=sought.unit,
                     where=where, key=sought.unit_key)  # fmt: skip
    values = sheet.table((name,)).numbers(name, unit=f"a unit of {quantity}", most=1e9)
    return ExportColumn(name, quantity, np.asarray(factor * values, float))


def _is_header(row: Sequence[str], required: Sequence[SoughtColumn]) -> bool:
    """True for a line with a heading for every required column."""
    each = [{name for name, _ in sought.among(row)} for sought in required]
    return all(each) and len(set().union(*each)) >= len(required)


def _said(sought: SoughtColumn) -> str:
    return repr(sought.heading) if sought.heading is not None else " or ".join(sought.quantities)
