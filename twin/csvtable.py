"""Turn a CSV file with a header into checked columns; every error names file, line, column and value."""

import csv
import io
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

LARGEST = 200_000_000  # bytes: an hour at 1 kHz is a third of it
WRAPS = {"2^16": 2**16, "2^32": 2**32}  # counts after which the clocks of small loggers begin anew
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
        if not falls.size:
            return
        row, before = int(falls[0]) + 1, f"wanted more than the {values[falls[0]]:.10g} {unit} before it"
        if falls.size > len(step) / 2 and step.max() <= 0 > step.min():
            raise self.error(row, column, f"{before}: the rows stand newest first; turn their order round")
        if step[row - 1] < 0:
            raise self.error(
                row, column, f"{before}: {_jumped(-float(step[row - 1]), values, unit, self.lines[row])}"
            )
        way = "remove repeated rows"
        if falls.size > ROUNDED * len(values):
            way = (
                f"{falls.size} of {len(values)} rows repeat the value before them, so it seems to be "
                f"rounded to {step[step > 0].min(initial=np.inf):.3g} {unit}: write it with more digits"
            )
        raise self.error(row, column, f"{before}: {way}")

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
    units: dict[str, str] = field(default_factory=dict)  # by the heading, of a line of units
    again: tuple[int, ...] = ()  # lines on which the header stands again; the rows below them are left out

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
        return replace(table, comma=_has_commas(table) and self.separator != ",")

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
    text = _text(path, wanted)
    separator = _separator(next((line for line in text.splitlines() if line.strip()), ""))
    rows = _rows(path, text, separator, wanted)
    if len(rows) < 2:
        raise ValueError(f"{path}: no rows; wanted a header line {wanted} and rows below it")
    return Sheet(path, tuple(rows[0][1]), [row for _, row in rows[1:]], [n for n, _ in rows[1:]], separator)


def read_recording(
    path: Path, is_header: Callable[[Sequence[str]], bool], *, wanted: str, number: int = 1
) -> Sheet:
    """The sheet of a file that an instrument or a logger wrote, whose columns are parted by semicolons, tabs,
    commas or spaces.

    The header is the first line for which `is_header` is true, with numbers below it; where none is, the line
    above the first numbers. Passed over are the lines above it, those that begin with # or //, a line of
    units below it (it gives `units`) and the stamps of Arduino's monitor.   number: of the recording, where
    the header stands again. ValueError where the first line has numbers already, or no rows are there.
    """
    text = re.sub(r"(?m)^\d{1,2}:\d\d:\d\d[.,]\d{1,6} -> ", "", _text(path, wanted))
    fallback = None
    for separator in (";", "\t", ",", " "):
        every = _rows(path, text, separator, wanted)
        rows = [(line, own) for line, row in every for own in [_uncommented(row)]
                if own[0] == row[0] or is_header(own)]  # fmt: skip
        heads = [k for k, (_, row) in enumerate(rows) if not _numeric(row) and is_header(row)]
        heads = [k for k in heads if any(_numeric(row) for _, row in rows[k + 1 : k + 3])] or heads[:1]
        if separator == " ":
            heads = [k for k in heads if len(rows) > k + 1 and len(rows[k][1]) == len(rows[k + 1][1])]
        if heads:
            break
        least = 1 if separator == "," else 2  # cells: one that reads 0,5 may be two
        first = next((k for k, (_, row) in enumerate(rows) if len(row) >= least and _numeric(row)), None)
        if first is not None and separator != " ":
            fallback = fallback or (rows, [max(first - 1, 0)], separator)
    else:
        if fallback is None:
            return read_sheet(path, wanted=wanted)
        rows, heads, separator = fallback
    line, header = rows[heads[0]]
    if _numeric(header):
        raise ValueError(
            f"{path}: no line has headings of {wanted}, and line {line} has numbers already: write a line of "
            f"headings above it, one for each of {len(header)} columns"
        )
    if number > len(heads):
        raise ValueError(f"{path}: its header stands there {len(heads)} times; wanted {number} of {number}")
    begin, end = heads[number - 1], heads[number] if number < len(heads) else len(rows)
    units = _labview(rows[:begin], header)
    body = rows[begin + 1 : end]
    if body and not any(_NUMBER.match(cell) for cell in body[0][1]):
        units = dict(zip(header, body.pop(0)[1], strict=False))
    if end < len(rows):  # what stands above the next header is its own
        body = body[: 1 + max((k for k, (_, row) in enumerate(body) if _numeric(row)), default=-1)]
    if not body:
        raise ValueError(f"{path}: no rows below the headings {separator.join(header)}; wanted a row or more")
    again = tuple(rows[k][0] for k in heads)
    width = len(header)
    fitted = [[*row[:width], *[""] * (width - len(row)), *([] if not any(row[width:]) else row[width:])]
              for _, row in body]  # fmt: skip
    return Sheet(path, tuple(header), fitted, [n for n, _ in body], separator, units, again)


_NUMBER = re.compile(r"[+-]?[.,]?\d")


def _numeric(row: Sequence[str]) -> bool:
    """True for a row of numbers, two or more of them or nothing else, some of whose cells may be words."""
    count = sum(bool(re.fullmatch(r"[+-]?[.,]?\d[\d.,]*([eE][+-]?\d+)?", cell)) for cell in row)
    return bool(_NUMBER.match(row[0])) and (count >= 2 or count == len([cell for cell in row if cell]))


def _uncommented(row: list[str]) -> list[str]:
    """A row whose first cell has no mark of a comment before it."""
    bare = re.sub(r"^(#|//)+\s*", "", row[0])
    return [bare, *row[1:]] if bare or not row[0] else row[1:] or [""]


def _labview(above: Sequence[tuple[int, list[str]]], header: Sequence[str]) -> dict[str, str]:
    """Units by the headings, of the lines above the header in a measurement file of LabVIEW."""
    said = {row[0]: row[1:] for _, row in above}
    if "LabVIEW Measurement" not in said:
        return {}
    units = dict(zip(header[1:], said.get("Y_Unit_Label", []), strict=False))
    return units | ({header[0]: "s"} if said.get("X_Dimension", ["Time"])[0] == "Time" else {})


def together(path: Path, *parts: Callable[[], object]) -> None:
    """Call each part, and raise one ValueError with the faults of all that raise one, so that all are said at
    once."""
    faults = []
    for part in parts:
        try:
            part()
        except ValueError as error:
            faults.append(str(error))
    if faults:
        rest = [fault.removeprefix(f"{path}: ") for fault in dict.fromkeys(faults)]
        raise ValueError(
            "; and ".join([f"{path}: {rest[0]}" if faults[0] != rest[0] else rest[0], *rest[1:]])
        )


def _text(path: Path, wanted: str) -> str:
    """The text of a file: UTF-8, UTF-16 or, as of old programs, Windows-1252."""
    if not path.is_file():
        what = "a folder" if path.is_dir() else "no such file" if not path.exists() else "a FIFO or a device"
        raise ValueError(f"{path}: {what}; wanted a CSV file with a header line {wanted}")
    if path.stat().st_size > LARGEST:
        size = f"{path.stat().st_size / 1e6:.0f} MB; wanted at most {LARGEST / 1e6:.0f}"
        raise ValueError(f"{path}: {size}: export fewer rows")
    data = path.read_bytes()
    try:
        if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            return data.decode("utf-16")
        return data.decode("utf-8-sig")  # spreadsheets write a byte order mark
    except UnicodeDecodeError:
        if re.search(rb"[\x00-\x08\x0e-\x1f]", data) or data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            raise ValueError(f"{path}: not UTF-8 text; save it as CSV (UTF-8)") from None
        return data.decode("cp1252", errors="replace")


def _rows(path: Path, text: str, separator: str, wanted: str) -> list[tuple[int, list[str]]]:
    """The rows of a text that are not empty, with the line each ends on."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True)
    try:
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except csv.Error as error:  # a cell of more than 131072 characters, or a zero byte
        raise ValueError(
            f"{path}, line {reader.line_num}: not a row of a CSV file ({error}); wanted a header line "
            f"{wanted} and rows below it"
        ) from None
    return [(line, row) for line, row in rows if any(row)]


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


def _jumped(back: float, values: NDArray[np.float64], unit: str, line: int) -> str:
    """The sentence on a clock that jumped back by so much in s, ms, us or another unit."""
    text = f"the clock jumped back by {back:.10g} {unit} at line {line}: "
    tick, step = {"us": 1.0, "ms": 1e3, "s": 1e6}.get(unit, 0.0), float(np.median(np.abs(np.diff(values))))
    for name, counts in WRAPS.items():
        for count, lasts in (("us", counts / (tick or 1.0)), ("ms", 1e3 * counts / (tick or 1.0))):
            if tick and abs(back + step - lasts) <= 2 * step <= 0.2 * lasts:
                way = f"add {lasts:.10g} {unit} to the times from that line on"
                return f"{text}it wrapped after {name} {count}; {way}"
    return f"{text}it wrapped, or the logger restarted; keep the rows of one run, or add what is missing"


def _has_commas(table: Table) -> bool:
    """True where the numbers have decimal commas; ValueError where some have points, or a mark stands
    between thousands."""
    for name, column in table.cells.items():
        whole = next((cell for cell in column if len(cell) == 3 and cell.isdigit()), "")
        for mark in ",." if whole else "":
            rows = [row for row, cell in enumerate(column) if mark in cell]
            form = re.compile(rf"[+-]?[1-9]\d{{0,2}}\{mark}\d{{3}}")
            if len(rows) > 1 and all(form.fullmatch(column[row]) for row in rows):
                likely = f"beside whole numbers such as {whole}: {mark!r} seems to stand between thousands"
                raise table.error(rows[0], name, f"{likely}; wanted none there: export it without")
    commas, points = (
        next(((row, name) for name, column in table.cells.items() for row, cell in enumerate(column)
              if mark in cell and form.fullmatch(cell)), None)
        for mark, form in ((",", _COMMA), (".", _POINT))
    )  # fmt: skip
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
