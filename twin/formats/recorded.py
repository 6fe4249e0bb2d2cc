"""What every format gives: where each point was at each step, in the file's own axes and unit."""

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
    """A point's name fit for twin.toml and CSV cells: `Tip - 1` becomes Tip_1."""
    return re.sub(r"[^A-Za-z0-9_.+]+", "_", name).lstrip("_.+").rstrip("_") or "point"


def plain_names(path: Path, names: list[str]) -> tuple[str, ...]:
    """The names (p,) of a file, fit for twin.toml; ValueError where two become one."""
    found = tuple(plain(name) for name in names)
    twice = [name for name in found if found.count(name) > 1]
    if twice:
        raise ValueError(f"{path}: two points have the name {twice[0]!r}; wanted one name for each point")
    return found


def in_order(path: Path, pattern: str) -> list[Path]:
    """The files of a folder by the last number in their names; the file itself where path is none.

    ValueError for none.
    """
    found = sorted(path.glob(pattern), key=_number) if path.is_dir() else [path]
    if not found or not found[0].is_file():
        raise ValueError(f"{path}: no such file, or no {pattern} in it; wanted the program's result files")
    return found


def _number(path: Path) -> tuple[int, str]:
    numbers = re.findall(r"\d+", path.stem)
    return (int(numbers[-1]) if numbers else -1, path.name)


def numbers(cells: list[str], *, path: Path, what: str) -> Array:
    """The cells (n,) as numbers; an empty cell or nan is NaN, ValueError for other text."""
    try:
        return np.array([float(cell) if cell.strip() else np.nan for cell in cells])
    except ValueError as error:
        wanted = "wanted a number, or nothing where it was not seen"
        raise ValueError(f"{path}, {what}: {error}; {wanted}") from None
