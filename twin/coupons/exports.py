"""An instrument's export -> columns of numbers, by their headings."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.coupons.headings import Quantity, of_quantity, unit_of
from twin.csvtable import Sheet, read_recording, together
from twin.targets import Array


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
