"""Positions of points in a file's own axes and unit: the result of every format."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.files import check_plain
from twin.targets import Array

PIXEL = "px"
LOST = ("-", "--", "nan", "na", "n/a", "null", "none", "lost", "?")  # words for a value that is not there


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """Positions of named points; NaN where a point or a component was not seen, never a guess."""

    names: tuple[str, ...]  # (p,) fit for twin.toml
    position: Array  # (s,p,3) along the file's x, y, z, in `unit`
    unit: str  # px, or a unit of length; "" where the file states none
    frame: Array  # (s,) numbers of the pictures, from the file or its files' names, counted from any
    time: Array | None = None  # (s,) s where the file says it
    pressure: Array | None = None  # (s,) MPa where the file has it
    axes: str = ""  # the file's axes that are the world's x, y, z, where the format fixes them
    missing: int = 0  # positions that the file has, but so doubtful that they count as not seen
    doubt: str = ""  # why
    remarks: tuple[str, ...] = ()  # sentences on what was taken for a lost point


def plain(name: str) -> str:
    """A point's name fit for twin.toml and CSV cells.

    >>> plain("Tip - 1"), plain("(base)"), plain("??")
    ('Tip_1', 'base', 'point')
    """
    return re.sub(r"[^A-Za-z0-9_.+]+", "_", name).lstrip("_.+").rstrip("_") or "point"


def plain_names(path: Path, names: list[str]) -> tuple[str, ...]:
    """The names (p,) of a file, fit for twin.toml; ValueError where two become one."""
    safe_names = tuple(plain(name) for name in names)
    twice = [name for name in safe_names if safe_names.count(name) > 1]
    if twice:
        raise ValueError(f"{path}: two points have the name {twice[0]!r}; wanted one name for each point")
    return safe_names


def in_order(path: Path, pattern: str) -> tuple[list[Path], Array, tuple[str, ...]]:
    """The files of a folder in the order of the numbers in their names, these (t,), counted from the first,
    and what to say of them; the file itself where path is none. ValueError for none, or without an order."""
    from vision.film.numbering import in_order as by_number
    from vision.film.numbering import is_litter, told_of_numbers

    found = sorted(path.glob(pattern)) if path.is_dir() else [path]
    files, numbers = by_number([check_plain(file) for file in found if not is_litter(file)])
    if not files or not files[0].is_file():
        raise ValueError(f"{path}: no such file, or no {pattern} in it; wanted the program's result files")
    if not numbers:
        raise ValueError(
            f"{path}: several numbers change in the names, as from {files[0].name} to {files[1].name}; "
            "wanted one that counts the pictures"
        )
    count = np.array([float(number - numbers[0]) for number in numbers])
    return files, count, told_of_numbers(files, numbers)


def blanked(cells: Sequence[str]) -> list[str]:
    """Cells without the words for a value that is not there.

    >>> blanked(["1.5", "-", "NaN", ""])
    ['1.5', '', '', '']
    """
    return ["" if cell.strip().lower() in LOST else cell for cell in cells]


def numbers(cells: list[str], *, path: Path, what: str) -> Array:
    """The cells (n,) as numbers; an empty cell or nan is NaN, ValueError for other text.

    >>> numbers(["1.5", "", "nan"], path=Path("tip.csv"), what="column x").tolist()
    [1.5, nan, nan]
    >>> numbers(["1,5"], path=Path("tip.csv"), what="column x")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ValueError: tip.csv, column x: could not convert string to float: '1,5'; wanted a number, ...
    """
    try:
        return np.array([float(cell) if cell.strip() else np.nan for cell in blanked(cells)])
    except ValueError as error:
        advice = "wanted a number, or nothing where it was not seen"
        raise ValueError(f"{path}, {what}: {error}; {advice}") from None
