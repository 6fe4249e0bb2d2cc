"""Find time and pressure among the columns of a log, and turn the pressure into MPa."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.csvtable import Sheet, Table, read_recording, together
from twin.gauge.pressureunits import (
    ASKED,
    CLOCKS,
    KNOWN,
    PRESSURE,
    TIME,
    TIMES,
    UNITS,
    VOLTAGE,
    Line,
    heading,
    in_MPa,
    is_pressure,
    refuse_absolute,
    speaks_of_absolute,
    time_unit,
    unit_of,
    words_of,
)
from twin.sanity import pressure_fault, top_fault, zero_fault
from twin.targets import Array


@dataclass(frozen=True)
class LogFormat:
    """Column, unit and calibration line of a log, from `[pressure]` of twin.toml where headings lack them."""

    column: str | None = None  # heading of the pressure
    unit: str | None = None  # of that column
    line: Line | None = None  # for a gauge that gives volts
    top_kPa: float | None = None  # what the regulator was set to: the unit is compared with it
    key: str = "column under [pressure] of twin.toml"  # where the user names the column
    unit_key: str = "unit under [pressure] of twin.toml"  # and its unit; "": nowhere


@dataclass(frozen=True)
class Column:
    """A column of a log: its heading as it stands there, and its unit as the heading has it."""

    name: str
    unit: str  # "" where the heading has none


def log_sheet(path: Path, form: LogFormat) -> Sheet:
    """The sheet of a log, below the lines above its header. ValueError where that stands there again."""
    sheet = read_recording(path, lambda row: _is_header(row, form), wanted="time_s,pressure_MPa")
    if len(sheet.again) > 1:
        lines = ", ".join(map(str, sheet.again))
        raise ValueError(f"{path}: the header stands in the lines {lines}: the logger was started again, and "
                         "its clock with it; wanted one recording: keep the rows of one")  # fmt: skip
    return sheet


def _is_header(row: Sequence[str], form: LogFormat) -> bool:
    """True for a line with a heading of the time and another of the pressure."""
    times = [name for name in row if _speaks_of_time(name)]
    pressures = [name for name in row if name == form.column or (name not in times and (
        heading(name).word in PRESSURE or is_pressure(heading(name).unit)))]  # fmt: skip
    volts = [name for name in row if form.line is not None and heading(name).word in VOLTAGE]
    return bool(times and (pressures or volts)) and len(row) > 1


def _speaks_of_time(name: str) -> bool:
    return heading(name).word in (*TIME, *CLOCKS) or name.strip().lower() in TIME or "time" in words_of(name)


def time_column(sheet: Sheet) -> Column | None:
    """The column of the time, in s, ms, us or min, None where there is none. ValueError where there are
    two."""
    columns = _columns(sheet, (*TIME, *CLOCKS), exact="time_s")
    columns = columns or [_column(sheet, name) for name in sheet.header if _speaks_of_time(name)]
    clear = [column for column in columns if column.unit.lower() in TIMES]
    columns = clear if len(clear) == 1 else columns
    _check_one(sheet, columns, "time", "remove or rename one of them")
    if not columns:
        return None
    name, unit = columns[0].name, columns[0].unit
    unit = unit or CLOCKS.get(heading(name).word, "")
    return Column(name, time_unit(unit, what=f"{sheet.path}: column {name!r}"))


def columns_of(sheet: Sheet, form: LogFormat) -> tuple[Column, Column]:
    """The columns of time and pressure of a log. ValueError with all that is wrong with its header."""

    def clock() -> None:
        if time_column(sheet) is None:
            raise ValueError(
                f"{sheet.path}: column time_s is missing: the header is {','.join(sheet.header)}; wanted the "
                "time in s, such as time_s or t [ms]"
            )

    together(sheet.path, clock, lambda: _unit(sheet.path, pressure_column(sheet, form), form))
    time = time_column(sheet)
    assert time is not None
    return time, pressure_column(sheet, form)


def pressures(sheet: Sheet, form: LogFormat) -> Array:
    """The gauge pressure (t,) MPa of every row of a log, whether it has times or not."""
    column = pressure_column(sheet, form)
    return gauge_pressure(sheet.table((column.name,)), column, form)[0]


def gauge_pressure(table: Table, column: Column, form: LogFormat) -> tuple[Array, str]:
    """The gauge pressure (t,) MPa, and the unit it was read in."""
    unit = _unit(table.path, column, form)
    values = in_MPa(table.numbers(column.name, unit=unit), unit, line=form.line)
    _check_size(table.path, column, float(np.abs(values).max()), unit, form.top_kPa)
    if fault := zero_fault(values):
        raise ValueError(f"{table.path}: {column.name} {fault}")
    return values, unit


def _check_size(path: Path, column: Column, peak: float, unit: str, top_kPa: float | None) -> None:
    """Raise ValueError where no soft finger has such a pressure (peak, MPa), or the regulator was set to
    another: the unit is another one."""
    fault = "" if top_kPa is None else top_fault(peak, unit=unit, top_kPa=top_kPa)
    fault = fault or pressure_fault(peak, unit=unit)
    if fault and peak > 0:
        raise ValueError(
            f"{path}: {column.name} {fault}; correct the unit in the heading, as in pressure_kPa, or in "
            "[pressure] of twin.toml"
        )


def pressure_column(sheet: Sheet, form: LogFormat) -> Column:
    """The column of the pressure: the one that twin.toml names, else the one whose heading speaks of it.

    ValueError where it is not there, or several are.
    """
    named = form.column
    if named is not None:
        if named not in sheet.header:
            raise ValueError(f"{sheet.path}: column = {named!r} is not in the header "
                             f"{','.join(sheet.header)}; correct {form.key}")  # fmt: skip
        column, known = _column(sheet, named), heading(named).word in PRESSURE or heading(named).unit in KNOWN
        return column if known or is_pressure(column.unit) else Column(named, "")
    columns = _columns(sheet, PRESSURE if form.line is None else (*PRESSURE, *VOLTAGE), exact="pressure_MPa")
    every = [_column(sheet, name) for name in sheet.header]
    others = [column for column in every if column not in columns and is_pressure(column.unit)]
    every = sorted([*columns, *others], key=lambda column: sheet.header.index(column.name))
    _check_one(sheet, every if columns or len(others) > 1 else [], "pressure", f"say which with {form.key}")
    if not columns:
        likely = f", if {others[0].name!r} is it" if others else ""
        raise ValueError(f"{sheet.path}: column pressure_MPa is missing: the header is "
                         f"{','.join(sheet.header)}; wanted a heading such as pressure_MPa, p [bar] or "
                         f"Pressure (psi), or {form.key}{likely}")  # fmt: skip
    return columns[0]


def asked_doubt(column: Column, form: LogFormat) -> str:
    """A sentence where a heading names what a regulator was set to, "" where it does not, or was stated."""
    word = next((word for word in words_of(column.name) if word in ASKED), "")
    if form.column is not None or not word:
        return ""
    return (
        f"Column {column.name!r} is by its name ({word}) what the regulator was asked for, not what a gauge "
        "measured, and the finger may have had less, and later; log the gauge, or, if the name is wrong, "
        f"write {form.key}."
    )


def _columns(sheet: Sheet, words: tuple[str, ...], *, exact: str) -> list[Column]:
    """The columns whose headings begin with any of these words; the exact heading alone where it exists."""
    names = [name for name in sheet.header if name == exact] or sheet.header
    return [_column(sheet, name) for name in names if heading(name).word in words or name.lower() in words]


def _column(sheet: Sheet, name: str) -> Column:
    """A column with the unit of its heading, or of the line below it."""
    unit, below = heading(name).unit, sheet.units.get(name, "").strip("[]() ")
    return Column(name, below if below and unit not in KNOWN and not is_pressure(unit) else unit)


def _check_one(sheet: Sheet, columns: list[Column], what: str, way_out: str) -> None:
    if len(columns) > 1:
        names = " and ".join(repr(column.name) + _asked(column) for column in columns)
        both = "both" if len(columns) == 2 else "all"
        raise ValueError(f"{sheet.path}: columns {names} are {both} of {what}; wanted one: {way_out}")


def _asked(column: Column) -> str:
    """ " (asked of the regulator)" for a heading that says so, else ""."""
    return " (asked of the regulator)" if set(ASKED) & set(words_of(column.name)) else ""


def _unit(path: Path, column: Column, form: LogFormat) -> str:
    """The unit of the pressure. ValueError where it is unclear or contradictory."""
    what = f"{path}: column {column.name!r}"
    if speaks_of_absolute(column.name):
        refuse_absolute(column.name, what=what)
    heading_unit = unit_of(column.unit, what=what) if column.unit else ""
    stated_unit = "" if form.unit is None else unit_of(form.unit, what="[pressure] unit of twin.toml")
    if heading_unit and stated_unit and heading_unit != stated_unit:
        raise ValueError(f"{what} says {heading_unit}, [pressure] unit of twin.toml says {stated_unit}; "
                         "wanted one unit: correct the heading or the key")  # fmt: skip
    unit = stated_unit or heading_unit
    if not unit:
        raise ValueError(f"{what} has no unit: wanted {UNITS}; rename it, as in pressure_kPa"
                         + (form.unit_key and f", or set {form.unit_key}"))  # fmt: skip
    if unit in TIMES:
        raise ValueError(f"{what} has the unit {unit}: wanted {UNITS}")
    _check_line(unit, form.line, what=what)
    return unit


def _check_line(unit: str, line: Line | None, *, what: str) -> None:
    """Raise ValueError where volts have no calibration line, or another unit has one."""
    if unit in ("V", "mV") and line is None:
        raise ValueError(
            f"{what} is in {unit}: wanted the calibration line of the gauge; set volt_zero (V at no "
            "pressure) and MPa_per_V under [pressure] of twin.toml"
        )
    if unit not in ("V", "mV") and line is not None:
        raise ValueError(
            f"{what} is in {unit}, but [pressure] of twin.toml has a calibration line for volts; remove "
            "volt_zero and MPa_per_V, or correct the unit"
        )
