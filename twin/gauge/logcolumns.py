"""Find time and pressure among the columns of a log, and turn the pressure into MPa."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.csvtable import Sheet, Table
from twin.gauge.pressureunits import (
    KNOWN,
    PRESSURE,
    TIME,
    UNITS,
    VOLTAGE,
    Line,
    heading,
    in_MPa,
    refuse_absolute,
    speaks_of_absolute,
    unit_of,
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


@dataclass(frozen=True)
class Column:
    """A column of a log: its heading as it stands there, and its unit as the heading has it."""

    name: str
    unit: str  # "" where the heading has none


def time_column(sheet: Sheet) -> Column | None:
    """The column of the time, in s, ms or min, None where there is none. ValueError where there are two."""
    columns = _columns(sheet, TIME, exact="time_s")
    _check_one(sheet, columns, "time", "remove or rename one of them")
    if not columns:
        return None
    what = f"{sheet.path}: column {columns[0].name!r}"
    unit = unit_of(columns[0].unit, what=what) if columns[0].unit else ""
    if unit not in ("s", "ms", "min"):
        has = f"the unit {unit}" if unit else "no unit"
        raise ValueError(f"{what} has {has}: wanted s, ms or min, as in time_s or t [ms]")
    return Column(columns[0].name, unit)


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
            raise ValueError(f"{sheet.path}: [pressure] column = {named!r} is not in the header "
                             f"{','.join(sheet.header)}; correct it in twin.toml")  # fmt: skip
        meaning = heading(named)
        return Column(named, meaning.unit if meaning.word in PRESSURE or meaning.unit in KNOWN else "")
    columns = _columns(sheet, PRESSURE if form.line is None else (*PRESSURE, *VOLTAGE), exact="pressure_MPa")
    _check_one(sheet, columns, "pressure", "say which with column under [pressure] of twin.toml")
    if not columns:
        raise ValueError(f"{sheet.path}: column pressure_MPa is missing: the header is "
                         f"{','.join(sheet.header)}; wanted a heading such as pressure_MPa, p [bar] or "
                         "Pressure (psi), or column under [pressure] of twin.toml")  # fmt: skip
    return columns[0]


def _columns(sheet: Sheet, words: tuple[str, ...], *, exact: str) -> list[Column]:
    """The columns whose headings begin with any of these words; the exact heading alone where it exists."""
    names = [name for name in sheet.header if name == exact] or sheet.header
    named = [(name, heading(name)) for name in names]
    return [Column(name, meaning.unit) for name, meaning in named if meaning.word in words]


def _check_one(sheet: Sheet, columns: list[Column], what: str, way_out: str) -> None:
    if len(columns) > 1:
        names = " and ".join(repr(column.name) for column in columns)
        raise ValueError(f"{sheet.path}: columns {names} are both of {what}; wanted one: {way_out}")


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
        raise ValueError(f"{what} has no unit: wanted {UNITS}; rename it, as in pressure_kPa, or set unit "
                         "under [pressure] of twin.toml")  # fmt: skip
    if unit in ("s", "ms", "min"):
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
