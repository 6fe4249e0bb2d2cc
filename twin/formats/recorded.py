"""Positions of points in a file's own axes and unit: the result of every format."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.targets import Array

PIXEL = "px"


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """Positions of named points; NaN where a point or a component was not seen, never a guess."""

    names: tuple[str, ...]  # (p,) fit for twin.toml
    position: Array  # (s,p,3) along the file's x, y, z, in `unit`
    unit: str  # px, or a unit of length
    frame: NDArray[np.int64]  # (s,) number of the picture, from the file
    time: Array | None = None  # (s,) s where the file says it
    pressure: Array | None = None  # (s,) MPa where the file has it
    axes: str = ""  # the file's axes that are the world's x, y, z, where the format fixes them
    missing: int = 0  # positions that the file has, but so doubtful that they count as not seen
    doubt: str = ""  # why


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


def in_order(path: Path, pattern: str) -> list[Path]:
    """The files of a folder by the last number in their names; the file itself where path is none.

    ValueError for none.
    """
    files = sorted(path.glob(pattern), key=_number) if path.is_dir() else [path]
    if not files or not files[0].is_file():
        raise ValueError(f"{path}: no such file, or no {pattern} in it; wanted the program's result files")
    return files


def _number(path: Path) -> tuple[int, str]:
    numbers = re.findall(r"\d+", path.stem)
    return (int(numbers[-1]) if numbers else -1, path.name)


def numbers(cells: list[str], *, path: Path, what: str) -> Array:
    """The cells (n,) as numbers; an empty cell or nan is NaN, ValueError for other text.

    >>> numbers(["1.5", "", "nan"], path=Path("tip.csv"), what="column x").tolist()
    [1.5, nan, nan]
    >>> numbers(["1,5"], path=Path("tip.csv"), what="column x")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ValueError: tip.csv, column x: could not convert string to float: '1,5'; wanted a number, ...
    """
    try:
        return np.array([float(cell) if cell.strip() else np.nan for cell in cells])
    except ValueError as error:
        advice = "wanted a number, or nothing where it was not seen"
        raise ValueError(f"{path}, {what}: {error}; {advice}") from None
