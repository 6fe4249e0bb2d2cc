"""Displacements in a table, a CSV file or a DataFrame, as the targets of a calibration."""

import csv
import io
import operator
import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.formats.catalogue import read_recorded
from twin.formats.conversion import targets_of
from twin.formats.importtable import ImportTable
from twin.formats.recorded import plain
from twin.marktables import PointTable
from twin.targets import Targets
from twin.validation import checked

if TYPE_CHECKING:
    import pandas

POINT, COMPONENT = "point", re.compile(r"[uU]?([123xyzXYZ])[ _]?[\[(]?(mm|cm|m|px|in)[\])]?")


def read_table(
    source: "str | Path | pandas.DataFrame",
    *,
    points: Mapping[str, int | Sequence[float]],
    sd_mm: float | None = None,
    log: "str | Path | pandas.DataFrame | None" = None,
    format: str = "csv",  # noqa: A002 - as [import] of twin.toml has it
    **stated: Any,
) -> Targets:
    """Displacements of the points of an actuator, relative to the first row, with their errors.

    source: a CSV file or a DataFrame with a row a step, in columns such as time_s, tip_x_mm, tip_z_mm and
    pressure_kPa; or with a row a point and step, in columns such as time_s, pressure_kPa, point, u1_mm and
    u3_mm. The unit stands in each column's name. Without times a step is a second. points: the place of each
    point without load, (x, y, z) in mm or the label of its node; other points are left out. sd_mm: standard
    deviation of one position, mm. log: pressure over time between the rows, for effects with a memory.
    format, stated: another program's file, and keys of [import] of twin.toml in place of sd_mm or beside it:
    still_steps="holds", axes="x,0,z", fps=30.0, rest_steps=5. ValueError says what is missing or wrong.

    >>> import pandas
    >>> frame = pandas.DataFrame({"time_s": [0, 1, 2], "pressure_kPa": [0, 10, 20],
    ...                           "tip_x_mm": [0, -0.4, -1.7], "tip_z_mm": [0, -6, -13]})
    >>> data = read_table(frame, points={"tip": (110, 11.5, 0)}, sd_mm=0.02)
    >>> print(data)
    Targets of 1 point (tip) at 3 steps up to 20 kPa; sd 0.02 mm
    >>> data.value[-1, 0]
    array([ -1.7,   nan, -13. ])
    >>> data.pressure.tolist()  # MPa
    [0.0, 0.01, 0.02]

    A row a point and step:

    >>> long = pandas.DataFrame({"pressure_kPa": [0, 20], "point": ["tip", "tip"], "u3_mm": [0, -13]})
    >>> print(read_table(long, points={"tip": 4401}, sd_mm=0.02))
    Targets of 1 point (tip) at 2 steps up to 20 kPa; sd 0.02 mm

    An error is one sentence:

    >>> read_table(frame.drop(columns="pressure_kPa"), points={"tip": (110, 11.5, 0)}, sd_mm=0.02)
    Traceback (most recent call last):
    ValueError: [import]: the file does not say all that is needed; wanted log (pressure log, ...
    """
    if not isinstance(points, Mapping) or not points:
        raise ValueError(f"points = {points!r}: wanted places in mm, such as {{'tip': (110, 11.5, 0)}}")
    tables = [_point(name, place) for name, place in points.items()]
    with tempfile.TemporaryDirectory() as folder:
        file, log_file = (_file(Path(folder), name, x, wide=name == "table") for name, x in
                          (("table", source), ("log", log)))  # fmt: skip
        assert file is not None
        keys = {"file": file.name, "format": format, "sd_mm": sd_mm} | stated
        keys |= {} if log_file is None else {"log": log_file.name}
        try:
            recorded = read_recorded(file, format)
            if len(recorded.position) < 2:
                raise ValueError("the table: one row; wanted more, as the first is the rest")
            if recorded.time is None and "fps" not in keys:
                keys["fps"] = 1.0
            table = checked(ImportTable, keys, name="read_table")
            return targets_of(recorded, table, tables, log=log_file)[0]
        except ValueError as error:
            text = re.sub(f"{re.escape(folder)}/(table|log).csv", r"the \1", str(error))
            raise ValueError(text) from None


def _point(name: str, place: int | Sequence[float]) -> PointTable:
    key: dict[str, Any]
    try:
        if np.ndim(place):
            key = {"position_mm": np.asarray(place, float).tolist()}
        else:
            key = {"node": operator.index(place)}  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise ValueError(
            f"points[{name!r}] = {place!r}: wanted (x, y, z) in mm, or the label of a node"
        ) from None
    return checked(PointTable, {"name": plain(name)} | key, name=f"points[{name!r}]")


def _file(folder: Path, name: str, source: Any, *, wide: bool) -> Path | None:
    """A file with a row a step; None without a log. ValueError where there is no such file."""
    if source is None and not wide:
        return None
    if hasattr(source, "to_csv"):
        text = source.to_csv(index=False)
    elif not isinstance(source, str | Path):
        raise ValueError(f"{type(source).__name__}: no table; wanted a CSV file or a DataFrame")
    else:
        path = Path(source)
        if not path.exists():
            raise ValueError(f"{path}: no such file; wanted a CSV file or a DataFrame")
        if not wide or path.is_dir():
            return path
        text = path.read_text(encoding="utf-8-sig", errors="replace")
        if POINT not in text.partition("\n")[0].strip().split(","):
            return path
    rows = list(csv.reader(io.StringIO(text)))
    file = folder / f"{name}.csv"
    with file.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows(_wide(rows) if wide and rows and POINT in rows[0] else rows)
    return file


def _wide(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """Rows a step of rows a point and step: tip_x_mm of u1_mm in the rows whose point is tip."""
    head, named = list(rows[0]), rows[0].index(POINT)
    parts = {k: match for k, name in enumerate(head) if (match := COMPONENT.fullmatch(name))}
    shared = [k for k, name in enumerate(head) if k != named and k not in parts
              and re.match(r"(?i)(time|t\b|frame|step|p\b|pressure)", name)]  # fmt: skip
    if not parts or not shared:
        raise ValueError(
            f"the table has the columns {', '.join(head)}; wanted beside {POINT} the displacements, such as "
            "u1_mm and u3_mm, and time_s or pressure_kPa"
        )
    steps: dict[tuple[str, ...], dict[str, str]] = {}
    columns: dict[str, None] = {}
    for row in rows[1:]:
        step = steps.setdefault(tuple(row[k] for k in shared), {})
        for k, match in parts.items():
            axis = match[1].lower().translate(str.maketrans("123", "xyz"))
            column = f"{plain(row[named])}_{axis}_{match[2]}"
            if column in step:
                raise ValueError(
                    f"point {row[named]!r} stands twice at {', '.join(row[k] for k in shared)}; wanted one "
                    "row for a point and step"
                )
            step[column] = row[k]
            columns[column] = None
    out = [[head[k] for k in shared] + list(columns)]
    return out + [[*key, *(step.get(column, "") for column in columns)] for key, step in steps.items()]
