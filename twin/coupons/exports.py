"""An instrument's export -> columns of numbers: lines above the header, a row of units, decimal commas."""

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.coupons.headings import Quantity, of_quantity, unit_of
from twin.csvtable import Sheet
from twin.targets import Array

_NUMBER = re.compile(r"[+-]?[.,]?\d")
LARGEST = 200_000_000  # bytes: an hour at 1 kHz is a third of it


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


def read_export(
    path: Path, required: Sequence[SoughtColumn], *, also: Sequence[SoughtColumn] = ()
) -> list[ExportColumn | None]:
    """The required columns, and the optional ones of `also`, None where one is missing.

    The header is the first line that has them all; lines above it, and one of units below it, are passed
    over. ValueError where no line has them, several columns may be meant, a unit is missing, or a cell is no
    number.
    """
    sheet, units = _sheet(path, required)
    columns: list[ExportColumn | None] = []
    for sought in (*required, *also):
        every = list(dict.fromkeys(sought.among(sheet.header)))
        if len(every) > 1 or (every and sheet.header.count(every[0][0]) > 1):
            names = " and ".join(repr(name) for name, _ in every)
            raise ValueError(f"{path}: {names} may all be meant; say which with {sought.key} = \"...\" in "
                             "[[material_tests]] of twin.toml")  # fmt: skip
        columns.append(_column(sheet, units, sought, *every[0]) if every else None)
    return columns


def _column(
    sheet: Sheet, units: dict[str, str], sought: SoughtColumn, name: str, quantity: Quantity
) -> ExportColumn:
    where = f"{sheet.path}: column {name!r}"
    factor = unit_of(name, quantity, below=units.get(name, ""), stated_unit=sought.unit,
                     where=where, key=sought.unit_key)  # fmt: skip
    values = sheet.table((name,)).numbers(name, unit=f"a unit of {quantity}", most=1e9)
    return ExportColumn(name, quantity, np.asarray(factor * values, float))


def _is_header(row: Sequence[str], required: Sequence[SoughtColumn]) -> bool:
    """True for a line with a heading for every required column."""
    each = [{name for name, _ in sought.among(row)} for sought in required]
    return all(each) and len(set().union(*each)) >= len(required)


def _sheet(path: Path, required: Sequence[SoughtColumn]) -> tuple[Sheet, dict[str, str]]:
    """The sheet below the header of an export, and the units by the headings."""
    text = _text(path)
    for separator in (";", "\t", ","):
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
        try:
            every = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
        except csv.Error as error:
            raise ValueError(f"{path}, line {reader.line_num}: not a row of a CSV file ({error})") from None
        rows = [(line, row) for line, row in every if any(row)]
        header_row = next((k for k, (_, row) in enumerate(rows) if _is_header(row, required)), None)
        if header_row is not None:
            return _below(path, rows[header_row:], separator)
    what = " and ".join(_said(sought) for sought in required)
    raise ValueError(f"{path}: no line has headings of {what}; name the columns in [[material_tests]] of "
                     "twin.toml as they stand in the file")  # fmt: skip


def _said(sought: SoughtColumn) -> str:
    return repr(sought.heading) if sought.heading is not None else " or ".join(sought.quantities)


def _below(path: Path, rows: list[tuple[int, list[str]]], separator: str) -> tuple[Sheet, dict[str, str]]:
    header, units = rows[0][1], dict[str, str]()
    body = [(n, [*row, *[""] * (len(header) - len(row))][: len(header)]) for n, row in rows[1:]]
    if body and not any(_NUMBER.match(cell) for cell in body[0][1]):
        units = dict(zip(header, body[0][1]))
        body = body[1:]
    if len(body) < 2:
        raise ValueError(f"{path}: no rows below the headings {separator.join(header)}; wanted a curve")
    sheet = Sheet(path, tuple(header), [row for _, row in body], [n for n, _ in body], separator)
    return sheet, units


def _text(path: Path) -> str:
    """The text of a file that an instrument's program wrote: UTF-8, UTF-16 or, as of old, Windows-1252."""
    if not path.is_file():
        raise ValueError(f"{path}: {'a folder' if path.is_dir() else 'no such file'}; wanted a CSV file")
    data = path.read_bytes()
    if len(data) > LARGEST:
        size = f"{len(data) / 1e6:.0f} MB; wanted at most {LARGEST / 1e6:.0f}"
        raise ValueError(f"{path}: {size}: export fewer rows")
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")
