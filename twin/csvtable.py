"""Turn a CSV file with a header into checked columns; every error names file, line, column and value."""

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROUNDED = 0.2  # share of the rows that repeat the one before where times are rounded, and none falls


@dataclass(frozen=True)
class Table:
    """The cells of a CSV file as text, with the line of the file each row stands on."""

    path: Path
    cells: dict[str, list[str]]  # column -> one text a row
    lines: list[int]
    comma: bool = False  # the decimal mark is a comma

    def __len__(self) -> int:
        return len(self.lines)

    def error(self, row: int, column: str, message: str) -> ValueError:
        """A ValueError that names the cell, its value and what was wanted (`message`)."""
        value = self.cells[column][row]
        excerpt = repr(value if len(value) <= 60 else value[:57] + "...")
        return ValueError(f"{self.path}, line {self.lines[row]}, column {column}: {excerpt}: {message}")

    def numbers(
        self, column: str, *, unit: str, empty: bool = False, most: float = math.inf
    ) -> NDArray[np.float64]:
        """A column (rows,) of finite numbers, of the size `most` at most; where `empty` is allowed an empty
        cell is NaN."""
        message = f"wanted a finite number in {unit}" + (" or an empty cell (not observed)" if empty else "")
        numbers = (self._number(row, column, message, empty) for row in range(len(self)))
        values = np.fromiter(numbers, dtype=float, count=len(self))
        for row in np.flatnonzero(np.abs(values) > most)[:1].tolist():
            raise self.error(row, column, f"wanted a number in {unit}, of {most:g} at most; correct its unit")
        return values

    def integers(self, column: str) -> NDArray[np.int64]:
        """A column (rows,) of whole numbers."""
        for row, text in enumerate(self.cells[column]):
            if not re.fullmatch(r"[+-]?[0-9]{1,15}", text):
                raise self.error(row, column, "wanted a whole number, of 15 digits at most")
        return np.array([int(text) for text in self.cells[column]], dtype=np.int64)

    def flags(self, column: str) -> NDArray[np.bool_]:
        """A column (rows,) of 1 / 0 or true / false."""
        words = {"1": True, "true": True, "0": False, "false": False}
        for row, text in enumerate(self.cells[column]):
            if text.lower() not in words:
                raise self.error(row, column, "wanted 1 (use it) or 0 (leave it out)")
        return np.array([words[text.lower()] for text in self.cells[column]], dtype=bool)

    def increasing(self, column: str, values: NDArray[np.float64], *, unit: str) -> None:
        """Raise ValueError at the first value that is not larger than the one before it."""
        step = np.diff(values)
        falls = np.flatnonzero(step <= 0)
        if falls.size:
            row, advice = int(falls[0]) + 1, "sort the rows by time and remove repeated ones"
            if step.min() == 0 and falls.size > ROUNDED * len(values):
                advice = (
                    f"{falls.size} of {len(values)} rows repeat the value before them, so it seems to be "
                    f"rounded to {step[step > 0].min(initial=np.inf):.3g} {unit}: write it with more digits"
                )
            before = f"{values[row - 1]:g} {unit}"
            raise self.error(row, column, f"wanted more than the {before} before it: {advice}")

    def _number(self, row: int, column: str, message: str, empty: bool) -> float:
        text = self.cells[column][row]
        if empty and not text:
            return math.nan
        try:
            value = float(text.replace(",", ".") if self.comma else text)
            if "_" in text or not text.isascii():  # which Python reads as digits
                raise ValueError
        except ValueError:
            raise self.error(row, column, f"{message}{_of_marks(text)}") from None
        if not math.isfinite(value):
            raise self.error(row, column, message)
        return value


@dataclass(frozen=True)
class Sheet:
    """A CSV file as text: its header, its rows, and how its numbers are written."""

    path: Path
    header: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]  # of the file, one a row
    separator: str

    def table(self, columns: Sequence[str], *, also: Sequence[str] = ()) -> Table:
        """A table of the named columns, with the columns of `also` that the file has.

        ValueError where one is missing or there twice, a row has more or fewer cells than the header, or
        decimal commas and decimal points are mixed.
        """
        for name in columns:
            _check_header(self.path, self.header, name, [n for n in self.header if n not in columns])
        for line, row in zip(self.lines, self.rows, strict=True):
            if len(row) != len(self.header):
                raise ValueError(
                    f"{self.path}, line {line}: {len(row)} cells; wanted {len(self.header)}, one for each "
                    f"column{self._hint(row)}"
                )
        positions = {name: self.header.index(name) for name in (*columns, *also) if name in self.header}
        cells = {name: [row[i] for row in self.rows] for name, i in positions.items()}
        table = Table(self.path, cells, self.lines)
        return table if self.separator == "," else replace(table, comma=_has_commas(table))

    def _hint(self, row: Sequence[str]) -> str:
        commas = self.separator == "," and len(row) == 2 * len(self.header)
        return _DECIMAL_COMMAS if commas else ""


_DECIMAL_COMMAS = (
    "; if the numbers have decimal commas, save the file with semicolons between the columns or with "
    "decimal points"
)
_COMMA, _POINT = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?"), re.compile(r"[+-]?\d*\.\d*([eE][+-]?\d+)?")


def as_text(cell: str) -> str:
    """A cell of text that a spreadsheet does not take for a formula: an apostrophe is put before its sign.

    >>> as_text("=1+2"), as_text("tip")
    ("'=1+2", 'tip')
    """
    return f"'{cell}" if cell[:1] in (*"=+-@\t\r\n",) else cell


def read_sheet(path: Path, *, wanted: str) -> Sheet:
    """A CSV file whose columns are parted by commas, semicolons or tabs, as its first line tells.

    ValueError where it is not there, is not UTF-8 or has no rows; `wanted` says what the header should be.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise ValueError(f"{path}: a folder; wanted a CSV file with a header line {wanted}") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not UTF-8 text; save it as CSV (UTF-8)") from None
    separator = _separator(next((line for line in text.splitlines() if line.strip()), ""))
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        rows = [
            (reader.line_num, [cell.strip() for cell in row]) for row in reader if any(c.strip() for c in row)
        ]
    except csv.Error as error:  # a cell of more than 131072 characters, or a zero byte
        raise ValueError(
            f"{path}, line {reader.line_num}: not a row of a CSV file ({error}); wanted a header line "
            f"{wanted} and rows below it"
        ) from None
    if len(rows) < 2:
        raise ValueError(f"{path}: no rows; wanted a header line {wanted} and rows below it")
    return Sheet(path, tuple(rows[0][1]), [row for _, row in rows[1:]], [n for n, _ in rows[1:]], separator)


def read_table(path: Path, columns: Sequence[str], *, also: Sequence[str] = ()) -> Table:
    """A table of the named columns of a CSV file, with the columns of `also` that it has.

    ValueError if a column or cells are missing or all rows.
    """
    return read_sheet(path, wanted=",".join(columns)).table(columns, also=also)


def _separator(line: str) -> str:
    """The column separator of a header line: a semicolon or a tab where there is one, else a comma.

    >>> _separator("time_s;tip_x_mm")
    ';'
    """
    return next((mark for mark in (";", "\t") if mark in line), ",")


def _has_commas(table: Table) -> bool:
    """True where the numbers have decimal commas; ValueError where some have points."""
    places = [(row, name) for name, column in table.cells.items() for row in range(len(column))]
    commas = next((p for p in places if _COMMA.fullmatch(table.cells[p[1]][p[0]])), None)
    points = next((p for p in places if _POINT.fullmatch(table.cells[p[1]][p[0]])), None)
    if commas is not None and points is not None:
        raise table.error(
            *commas,
            f"it has a comma, {table.cells[points[1]][points[0]]!r} in line {table.lines[points[0]]} a "
            "point; wanted one decimal mark in the whole file, and no mark between thousands",
        )
    return commas is not None


def _of_marks(text: str) -> str:
    """Advice on a text with a comma that is no number; "" without a comma."""
    return "; write a decimal point, and no mark between thousands" if "," in text else ""


def _check_header(path: Path, header: Sequence[str], name: str, spare: list[str]) -> None:
    if header.count(name) == 1:
        return
    near = get_close_matches(name, spare, n=1)
    hint = f"; rename {near[0]!r} if that is it" if near and name not in header else ""
    description = f"the header is {','.join(header)}"
    raise ValueError(
        f"{path}: column {name} is {'there twice' if name in header else 'missing'}: {description}{hint}"
    )
