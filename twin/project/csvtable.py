"""Turn a CSV file with a header into checked columns; every error names file, line, column and value."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Table:
    """The cells of a CSV file as text, with the line of the file each row stands on."""

    path: Path
    cells: dict[str, list[str]]  # column -> one text a row
    lines: list[int]

    def __len__(self) -> int:
        return len(self.lines)

    def error(self, row: int, column: str, wanted: str) -> ValueError:
        """The error that names the cell, its value and what was wanted."""
        value = self.cells[column][row]
        return ValueError(f"{self.path}, line {self.lines[row]}, column {column}: {value!r}: {wanted}")

    def numbers(self, column: str, *, unit: str, empty: bool = False) -> NDArray[np.float64]:
        """A column (rows,) of finite numbers; where `empty` is allowed an empty cell is NaN."""
        wanted = f"wanted a finite number in {unit}" + (" or an empty cell (not observed)" if empty else "")
        return np.array([self._number(row, column, wanted, empty) for row in range(len(self))], dtype=float)

    def integers(self, column: str) -> NDArray[np.int64]:
        """A column (rows,) of whole numbers."""
        try:
            return np.array([int(text) for text in self.cells[column]], dtype=np.int64)
        except ValueError:
            bad = next(row for row, text in enumerate(self.cells[column]) if not _is_integer(text))
            raise self.error(bad, column, "wanted a whole number") from None

    def flags(self, column: str) -> NDArray[np.bool_]:
        """A column (rows,) of 1 / 0 or true / false."""
        words = {"1": True, "true": True, "0": False, "false": False}
        for row, text in enumerate(self.cells[column]):
            if text.lower() not in words:
                raise self.error(row, column, "wanted 1 (use it) or 0 (leave it out)")
        return np.array([words[text.lower()] for text in self.cells[column]], dtype=bool)

    def increasing(self, column: str, values: NDArray[np.float64], *, unit: str) -> None:
        """Raise ValueError at the first value that is not larger than the one before it."""
        falls = np.flatnonzero(np.diff(values) <= 0)
        if falls.size:
            row = int(falls[0]) + 1
            raise self.error(
                row,
                column,
                f"wanted more than the {values[row - 1]:g} {unit} before it: "
                "sort the rows by time and remove repeated ones",
            )

    def _number(self, row: int, column: str, wanted: str, empty: bool) -> float:
        text = self.cells[column][row]
        if empty and not text:
            return math.nan
        try:
            value = float(text)
        except ValueError:
            raise self.error(row, column, wanted) from None
        if not math.isfinite(value):
            raise self.error(row, column, wanted)
        return value


def read_table(path: Path, columns: Sequence[str], *, also: Sequence[str] = ()) -> Table:
    """The named columns of a CSV file, and those of `also` that it has.

    ValueError if a column or cells are missing or all rows.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not UTF-8 text; save it as CSV (UTF-8)") from None
    reader = csv.reader(text.splitlines())
    rows = [
        (reader.line_num, [cell.strip() for cell in row]) for row in reader if any(c.strip() for c in row)
    ]
    if len(rows) < 2:
        raise ValueError(f"{path}: no rows; wanted a header line {','.join(columns)} and rows below it")
    header = rows[0][1]
    for name in columns:
        _check_header(path, header, name, [other for other in header if other not in columns])
    for line, row in rows[1:]:
        if len(row) != len(header):
            raise ValueError(
                f"{path}, line {line}: {len(row)} cells; wanted {len(header)}, one for each column"
            )
    at = {name: header.index(name) for name in (*columns, *also) if name in header}
    cells = {name: [row[i] for _, row in rows[1:]] for name, i in at.items()}
    return Table(path, cells, [line for line, _ in rows[1:]])


def _check_header(path: Path, header: list[str], name: str, spare: list[str]) -> None:
    if header.count(name) == 1:
        return
    near = get_close_matches(name, spare, n=1)
    hint = f"; rename {near[0]!r} if that is it" if near and name not in header else ""
    found = f"the header is {','.join(header)}"
    raise ValueError(
        f"{path}: column {name} is {'there twice' if name in header else 'missing'}: {found}{hint}"
    )


def _is_integer(text: str) -> bool:
    try:
        int(text)
    except ValueError:
        return False
    return True
