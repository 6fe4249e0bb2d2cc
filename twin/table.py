"""Rows of named columns, as aligned lines for a terminal, as CSV and as a DataFrame."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # pandas takes a second to import: only who asks for a DataFrame pays for it
    import pandas


@dataclass(frozen=True)
class DataTable:
    """Columns by name, and rows of as many cells: text, numbers, truth values, or None for an empty cell.

    >>> table = DataTable(("point", "u3_mm", "beyond"), [("tip", -12.34567, False), ("p1", None, True)])
    >>> print(table.csv(digits=4), end="")
    point,u3_mm,beyond
    tip,-12.35,false
    p1,,true
    >>> table.records[1]
    {'point': 'p1', 'u3_mm': None, 'beyond': True}
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]

    @property
    def records(self) -> list[dict[str, Any]]:
        """The rows, each by column."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]

    def lines(self, align: str = "<") -> list[str]:
        """Aligned lines, the names of the columns first.

        align: `<` or `>` for each column; the last one holds for all that follow.

        >>> DataTable(("", "U1, mm", "U3, mm"), [("tip", "-1.5", "-40.2"), ("p1", "0.1", "-3.0")]).lines("<>")
        ['     U1, mm  U3, mm', 'tip    -1.5   -40.2', 'p1      0.1    -3.0']
        """
        cells = [self.columns, *([_text(cell, None) for cell in row] for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        signs = align.ljust(len(widths), align[-1])
        layout = "  ".join(f"{{:{sign}{width}}}" for sign, width in zip(signs, widths, strict=True))
        return [layout.format(*row).rstrip() for row in cells]

    def csv(self, *, digits: int | None) -> str:
        """The text of a CSV file. digits: significant digits of its numbers; None: all."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([_text(cell, digits) for cell in row] for row in self.rows)
        return out.getvalue()

    @staticmethod
    def read(path: Path, *, text: Sequence[str] = ()) -> "DataTable":
        """The table that `csv` has written: numbers as float, an empty cell as None. text: columns kept."""
        with path.open(encoding="utf-8", newline="") as stream:
            columns, *rows = csv.reader(stream)
        plain = [name in text for name in columns]
        cells = [[c if t else _cell(c) for c, t in zip(row, plain, strict=True)] for row in rows]
        return DataTable(columns, cells)

    def to_pandas(self) -> "pandas.DataFrame":
        """The table as a DataFrame."""
        import pandas

        return pandas.DataFrame(self.records, columns=list(self.columns))


def _text(cell: Any, digits: int | None) -> str:
    if cell is None:
        return ""
    if isinstance(cell, bool):
        return str(cell).lower()
    return f"{cell:.{digits}g}" if isinstance(cell, float) and digits is not None else str(cell)


def _cell(text: str) -> Any:
    if text in ("", "true", "false"):
        return {"": None, "true": True, "false": False}[text]
    try:
        return float(text)
    except ValueError:
        return text
