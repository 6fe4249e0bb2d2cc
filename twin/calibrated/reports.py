"""Reports: results that print as an aligned table, show themselves in a notebook, and become a DataFrame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any

from twin.table import DataTable

if TYPE_CHECKING:
    import pandas


def aligned(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines of a table whose columns are the keys of the first row; numbers to four digits, None as nothing.

    >>> print(*aligned([{"name": "C10", "value": 0.21412}, {"name": "creep.g1", "value": None}]), sep="\\n")
    name       value
    C10       0.2141
    creep.g1
    """
    if not rows:
        return []
    sides = "".join("<" if all(isinstance(row[name], str) for row in rows) else ">" for name in rows[0])
    return DataTable(list(rows[0]), [[_cell(value) for value in row.values()] for row in rows]).lines(sides)


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True, kw_only=True, eq=False)
class Report:
    """Sentences and the rows of a table.

    >>> report = Report(said=("The model fits.",), rows=({"parameter": "C10", "value": 0.2},))
    >>> print(report)
    The model fits.
    parameter  value
    C10          0.2
    >>> report.to_pandas()["value"].tolist()
    [0.2]
    """

    said: tuple[str, ...] = ()
    rows: tuple[Mapping[str, Any], ...] = field(default=(), repr=False)

    def __str__(self) -> str:
        return "\n".join([*self.said, *aligned(self.rows)])

    def _repr_html_(self) -> str:
        return "".join(f"<p>{escape(line)}</p>" for line in self.said) + self.to_pandas().to_html(index=False)

    def to_pandas(self) -> "pandas.DataFrame":
        """The rows as a DataFrame; units stand in the names of the columns."""
        import pandas

        return pandas.DataFrame(list(self.rows))


class Reported:
    """A result that prints, shows and tabulates itself as its report does."""

    @property
    def _report(self) -> Report:
        raise NotImplementedError

    def __str__(self) -> str:
        return str(self._report)

    def _repr_html_(self) -> str:
        return self._report._repr_html_()

    def to_pandas(self) -> "pandas.DataFrame":
        """The rows of the report as a DataFrame; units stand in the names of the columns."""
        return self._report.to_pandas()
