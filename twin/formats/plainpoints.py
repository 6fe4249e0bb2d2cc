"""Read a CSV with one row a step and the positions of the points in columns.

Headings such as time_s,tip_x_mm,tip_z_mm,pressure_kPa: for all programs without a format of their own.
Positions or displacements: what they were while the finger was at rest is subtracted either way.
"""

import re
from pathlib import Path

import numpy as np

from twin.csvtable import Sheet, Table, read_sheet
from twin.formats.recorded import PIXEL, Recorded, blanked, plain_names
from twin.gauge.logcolumns import LogFormat, pressures, time_column
from twin.gauge.pressureunits import PRESSURE, heading, in_seconds

HEADING = re.compile(r"(?P<point>.+)_(?P<axis>[xyz])[ _]?[\[(]?(?P<unit>mm|cm|m|px|in)[\])]?")
WITHOUT = re.compile(r"(?P<point>.+)_(?P<axis>[xyz])(?P<unit>)")
BARE = re.compile(r"(.+)_[xyz](?:[ _]?[\[(]\w*[\])])?")  # a place without its unit, or in an unknown one


def read_plain(path: Path, min_likelihood: float) -> Recorded:
    """The points of a plain CSV in its unit, with its times and, where it has one, its pressure."""
    sheet = read_sheet(path, wanted="time_s,tip_x_mm,tip_z_mm,pressure_kPa")
    matches = {name: match for name in sheet.header if (match := HEADING.fullmatch(name))}
    if not matches:  # without units: [import] states it
        matches = {name: match for name in sheet.header if (match := WITHOUT.fullmatch(name))}
    units = {match["unit"] for match in matches.values()}
    if len(units) != 1:
        raise ValueError(
            f"{path}: the header is {','.join(sheet.header)}; wanted the points in columns such as "
            f"tip_x_mm,tip_z_mm, all in one unit{': found ' + ' and '.join(sorted(units)) if units else ''}"
        )
    points = list(dict.fromkeys(match["point"] for match in matches.values()))
    for name in sheet.header:
        if name not in matches and (bare := BARE.fullmatch(name)) and bare[1] in points:
            raise ValueError(
                f"{path}: column {name} has no unit of length; wanted mm, cm, m, px or in, as in {bare[0]}_mm"
            )
    table = sheet.table(tuple(matches))
    cells = {name: blanked(column) for name, column in table.cells.items()}
    table = Table(table.path, cells, table.lines, table.comma)
    position = np.full((len(table), len(points), 3), np.nan)
    for name, match in matches.items():
        column = table.numbers(name, unit=match["unit"], empty=True)
        position[:, points.index(match["point"]), "xyz".index(match["axis"])] = column
    unit = units.pop()
    return Recorded(
        names=plain_names(path, points), position=position, unit=unit, time=_time(sheet),
        pressure=_pressure(sheet), frame=np.arange(float(len(table))),
        axes="x,0,-y" if unit == PIXEL else "x,y,z",
    )  # fmt: skip


def _time(sheet: Sheet) -> np.ndarray | None:
    column = time_column(sheet)
    if column is None:
        return None
    return in_seconds(sheet.table((column.name,)).numbers(column.name, unit=column.unit), column.unit)


def _pressure(sheet: Sheet) -> np.ndarray | None:
    spoken = [name for name in sheet.header if heading(name).word in PRESSURE and not HEADING.fullmatch(name)]
    return pressures(sheet, LogFormat(unit_key="")) if spoken else None
