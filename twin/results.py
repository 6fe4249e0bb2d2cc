"""Results of commands in Python: summary, messages, and the table as a pandas DataFrame."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin import files
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.diagnosis.explanation import EvidenceRecord
from twin.judging.fitrecord import ComparisonRecord, FitRecord, Interval
from twin.study.record import Study, page_facts
from twin.table import DataTable

if TYPE_CHECKING:  # pandas takes a second to import: only who asks for a table pays for it
    import pandas

Row = dict[str, Any]
SHOWN = 20  # rows of a table in a cell; to_pandas() has all


@dataclass(frozen=True)
class StageResult:
    """Result of a stage."""

    stage: str
    summary: Mapping[str, Any] = field(repr=False)  # what `--json` prints: verdict, chi2, where, ...
    said: tuple[str, ...] = field(repr=False)  # what the command prints, a sentence or more each
    folder: Path | None = None  # of its run; None where it has none (check, list)
    rows: tuple[Row, ...] = field(default=(), repr=False)

    def __str__(self) -> str:
        return "\n".join(self.said)

    def _repr_html_(self) -> str:
        """HTML of a notebook's cell: messages and table."""
        lines = "".join(f"<p>{escape(line)}</p>" for line in self.said)
        return f"{lines}{self.to_pandas().to_html(index=False, max_rows=SHOWN)}"

    def to_pandas(self) -> "pandas.DataFrame":
        """The stage's table; docs/python.md lists the columns, units stand in their names."""
        import pandas

        return pandas.DataFrame(list(self.rows))


def rows_of(stage: str, folder: Path | None, summary: Mapping[str, Any]) -> tuple[Row, ...]:
    """The table of a stage: from the files of its run, else from its summary."""
    if stage == "list":
        return tuple(dict(row) for row in summary["runs"])
    if folder is None or stage not in _TABLES:
        plain = {key: v for key, v in summary.items() if not isinstance(v, list | dict)}
        return (plain,)
    return tuple(_TABLES[stage](folder))


def columns_of(stage: str) -> str:
    """The rows of a stage's table, in words, as its method documents them.

    >>> columns_of("calibrate")
    'a row for each fitted parameter.'
    """
    if stage == "list":
        return "a row for each run, oldest first."
    text = (_TABLES[stage].__doc__ or "") if stage in _TABLES else "One row: its summary."
    return text[0].lower() + text[1:]


def _parameters(folder: Path) -> Iterator[Row]:
    """A row for each fitted parameter."""
    fit = files.read(FitRecord, folder / FitRecord.file)
    for name, row in fit.parameters.items():
        span = fit.intervals.get(name, Interval())
        yield {
            "parameter": name, "value": row.value, "unit": row.unit, "sd": row.sd, "low_95": span.low,
            "high_95": span.high, "at_bound": name in fit.at_bound, "note": span.note,
        }  # fmt: skip


def _misfits(folder: Path) -> Iterator[Row]:
    """A row for each marker, direction, pressure and branch."""
    for kind, rows in files.read(ComparisonRecord, folder / ComparisonRecord.file).maps.items():
        yield from ({"by": kind, **row.model_dump()} for row in rows)


def _ranking(folder: Path) -> Iterator[Row]:
    """A row for each effect, the best first."""
    for row in files.read(DiagnosisRecord, folder / DiagnosisRecord.file).ranking:
        yield row.model_dump(exclude={"at_bound", "parameters"})


def _shares(folder: Path) -> Iterable[Row]:
    """A row for each marker and branch."""
    return (row.model_dump() for row in files.read(EvidenceRecord, folder / EvidenceRecord.file).shares)


def _budget(folder: Path) -> Iterator[Row]:
    """A row for each marker and source of error, as budget.csv has them; none of another program's file."""
    if not (folder / "budget.csv").is_file():
        return
    yield from DataTable.read(folder / "budget.csv", text=("point",)).records


def _study(folder: Path) -> Iterable[Row]:
    """A row for each error and constant, here and as published."""
    rows: list[Row] = page_facts(files.read(Study, folder / Study.file))["rows"]
    return rows


def _files(folder: Path) -> Iterator[Row]:
    """A row for each file of the run."""
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        yield {"file": path.relative_to(folder).as_posix(), "bytes": path.stat().st_size}


def _profiles(folder: Path) -> Iterator[Row]:
    """A row for each name."""
    for row in files.read_json(folder / "profile.json")["profiles"]:
        yield {key: value for key, value in row.items() if key != "points"}


def _posterior(folder: Path) -> Iterator[Row]:
    """A row for each name; its numbers are None where the chain may not be trusted."""
    yield from files.read_json(folder / "posterior.json")["rows"]


def _front(folder: Path) -> Iterator[Row]:
    """A row for each point of the front that was solved: its parameters, and misfits by objective."""
    front = files.read_json(folder / "pareto.json")
    for k, point in enumerate(front["points"]):
        misfits = {f"misfit {name}": value for name, value in point["misfit"].items()}
        yield {**point["parameters"], **misfits, "knee": k == front["knee"]}


def _explored(folder: Path) -> Iterator[Row]:
    """A row for each run of a design: its values, and what the finger shows."""
    for row in files.read_json(folder / "explore.json")["rows"]:
        yield {**row["values"], **{key: value for key, value in row.items() if key != "values"}}


def _vibrations(folder: Path) -> Iterator[Row]:
    """A row for each pressure and vibration: frequency, damping ratio, what moves."""
    for row in files.read_json(folder / "vibrations.json")["vibrations"]:
        yield {key: value for key, value in row.items() if key != "points"}


def _ringings(folder: Path) -> Iterable[Row]:
    """A row for each ringing: frequency, damping ratio, amplitude, the model's frequency."""
    rows: list[Row] = files.read_json(folder / "ringing.json")["ringings"]
    return rows


def _predicted(folder: Path) -> Iterator[Row]:
    """A row for each point and time, as predicted.csv; an interval that there is not is None."""
    for row in DataTable.read(folder / "predicted.csv", text=("point",)).records:
        yield {"point": row.pop("point"), **row}


_TABLES: dict[str, Callable[[Path], Iterable[Row]]] = {
    "measure": _budget,
    "calibrate": _parameters,
    "recalibrate": _parameters,
    "add": _parameters,
    "drop": _parameters,
    "compare": _misfits,
    "diagnose": _ranking,
    "explain": _shares,
    "profile": _profiles,
    "posterior": _posterior,
    "pareto": _front,
    "modes": _vibrations,
    "ringing": _ringings,
    "explore": _explored,
    "predict": _predicted,
    "export": _files,
    "look": _files,
    "print": _files,
    "study": _study,
    "review": _files,
}
