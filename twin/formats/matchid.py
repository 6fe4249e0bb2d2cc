"""Read the CSV files that MatchID exports, one for each picture.

One row a point. The export's columns have changed with the versions: coor.X [mm], disp.Horizontal
Displacement U [mm], Coordinates.Image X [Pixel] (2024); x, y, z, u, v, w (2023); X [mm], U [mm]. What they
have in common is that the last word before the unit is the letter. Coordinates are those of the reference
picture; a lost point has empty cells.
"""

import re
from pathlib import Path

import numpy as np

from twin.csvtable import Sheet, Table, read_sheet
from twin.formats.recorded import PIXEL, Recorded, blanked, in_order
from twin.targets import Array

SAME_PLACE = 1e-6  # of the span of all points: rows are told by their place in the reference picture
LETTERS = ("x", "y", "z", "u", "v", "w")


def read_matchid(path: Path, min_likelihood: float) -> Recorded:
    """The points of a folder of MatchID exports, in mm or px.

    ValueError where no unit has all columns, or a file has other rows than the first.
    """
    files, frame, told = in_order(path, "*.csv")
    sheets = [read_sheet(file, wanted="X [mm];Y [mm];U [mm];V [mm]") for file in files]
    columns, unit = _columns(sheets[0])
    tables = [_values(sheet, columns) for sheet in sheets]
    reference, flat = tables[0], "w" not in columns
    position = np.full((len(files), len(reference["x"]), 3), np.nan)
    for step, (file, table) in enumerate(zip(files, tables, strict=True)):
        _check_rows(file, table, reference)
        for axis, (place, moved) in enumerate(zip("xyz"[: 2 if flat else 3], "uvw", strict=False)):
            position[step, :, axis] = reference[place] + table[moved]
    lost = ~np.isfinite(position[..., :2]).all(axis=2)
    return Recorded(
        names=tuple(f"p{row + 1}" for row in range(position.shape[1])), position=position, unit=unit,
        frame=frame, missing=int(lost.sum()), doubt="no value", remarks=told,
    )  # fmt: skip


def _columns(sheet: Sheet) -> tuple[dict[str, str], str]:
    """The heading of each letter, and the unit of all of them."""
    by_unit: dict[str, dict[str, str]] = {}
    for name in sheet.header:
        bracket = re.search(r"\[(.*?)\]\s*$", name)
        letter = re.split(r"[\s.:]+", re.sub(r"\[.*?\]\s*$", "", name).strip())[-1].lower()
        if letter in LETTERS:
            by_unit.setdefault(_unit(bracket[1] if bracket else ""), {}).setdefault(letter, name)
    complete = {unit: have for unit, have in by_unit.items() if {"x", "y", "u", "v"} <= have.keys()}
    if not complete:
        raise ValueError(
            f"{sheet.path}: the header is {','.join(sheet.header[:6])}; wanted X, Y and the displacements U, "
            "V in one unit, as in X [mm];Y [mm];U [mm];V [mm]: add them to MatchID's export"
        )
    unit = next((u for u in ("mm", "m", PIXEL) if u in complete), next(iter(complete)))
    have = complete[unit]
    solid = {"z", "w"} <= have.keys()
    letters = LETTERS if solid else ("x", "y", "u", "v")
    # exports of 2023 name no unit: those of stereo are in mm, those of one camera in pixels
    return {letter: have[letter] for letter in letters}, unit or ("mm" if solid else PIXEL)


def _unit(text: str) -> str:
    return PIXEL if text.lower() in ("pixel", "pixels", "px", "pix") else text.strip()


def _values(sheet: Sheet, columns: dict[str, str]) -> dict[str, Array]:
    """The columns (p,) by their letter; NaN where a cell is empty or says so."""
    sigma = next((name for name in sheet.header if name.partition("[")[0].strip().lower() == "sigma"), None)
    table = sheet.table((*columns.values(), *([sigma] if sigma else [])))
    cells = {name: blanked(column) for name, column in table.cells.items()}
    table = Table(table.path, cells, table.lines, table.comma)
    values = {letter: table.numbers(name, unit="its unit", empty=True) for letter, name in columns.items()}
    if sigma is not None:  # of VIC-3D, below 0 where a point was lost
        failed = table.numbers(sigma, unit="px", empty=True) < 0.0
        values |= {letter: np.where(failed, np.nan, values[letter]) for letter in "uvw" if letter in values}
    return values


def _check_rows(path: Path, table: dict[str, Array], reference: dict[str, Array]) -> None:
    """Raise ValueError where the rows of a file are not the points of the first."""
    same = len(table["x"]) == len(reference["x"])
    if same:
        span = np.nanmax(np.abs([reference["x"], reference["y"]]))
        off = np.hypot(table["x"] - reference["x"], table["y"] - reference["y"])
        same = not bool(np.nanmax(np.nan_to_num(off)) > SAME_PLACE * span)
    if not same:
        raise ValueError(
            f"{path}: its rows are not the points of the first file; wanted X and Y of the reference picture "
            "and all points in every file: export them with lost points as empty cells"
        )
