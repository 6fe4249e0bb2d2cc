"""The numbers that files of a series carry in their names: their order, and the times of their pictures."""

import re
from collections.abc import Sequence
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

import numpy as np

from vision.camera import Array

NUMBER = re.compile(r"\d+(?:\.\d+)?")
CLOCKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # of time stamps in names
NEAR = 0.2  # of the usual step: time stamps of a camera follow its frame rate that well
FEW = 10.0  # usual step of numbers that count pictures, where they are not evenly spaced
GIVE_TIMES = "give times.csv with the columns file, time_s"


def is_litter(path: Path) -> bool:
    """True for what systems leave beside files: .DS_Store, ._film.png, Thumbs.db, desktop.ini.

    >>> [is_litter(Path(name)) for name in ("._b01.png", "Thumbs.db", "b01.png")]
    [True, True, False]
    """
    return path.name.startswith(".") or path.name.lower() in ("thumbs.db", "desktop.ini")


def in_order(files: Sequence[Path]) -> tuple[list[Path], list[Decimal]]:
    """Files of a series by the numbers in their names, and for each the number that counts: the one that
    changes, or of several the only one that differs in every name; none where no such one is.

    Numbers are decimal: 1.25 lies before 1.3. ValueError where names have several forms, two the same
    number, or digits behind a point that seem to count.

    >>> names = [Path(name) for name in ("t1.3.png", "t1.25.png", "t0.9.png")]
    >>> [path.name for path in in_order(names)[0]]
    ['t0.9.png', 't1.25.png', 't1.3.png']
    """
    if len(files) < 2:
        return list(files), [Decimal(0)] * len(files)
    stems = {path: path.stem.lower() for path in files}
    forms = {path: (*NUMBER.split(stem), path.suffix.lower()) for path, stem in stems.items()}
    values = {path: tuple(map(Decimal, NUMBER.findall(stem))) for path, stem in stems.items()}
    other = next((path for path in files if forms[path] != forms[files[0]]), None)
    if other is not None:
        raise ValueError(
            f"{files[0].parent}: {files[0].name} and {other.name} have names of two forms: their order is "
            "unknown; wanted names that differ in a number alone: move what does not belong to the series"
        )
    ordered = sorted(files, key=lambda path: values[path])
    twice = next((pair for pair in pairwise(ordered) if values[pair[0]] == values[pair[1]]), None)
    if twice is not None:
        raise ValueError(
            f"{files[0].parent}: {twice[0].name} and {twice[1].name} have the same number; wanted each once: "
            "numbers are decimal, fill those that count with zeros (1.09, 1.10)"
        )
    every = enumerate(zip(*(values[path] for path in ordered), strict=True))
    columns = {k: column for k, column in every if len(set(column)) > 1}
    _check_decimals(ordered, [*columns.values()])
    counting = [k for k, column in columns.items() if len(set(column)) == len(column)]
    if len(counting) != 1:
        return ordered, []
    ordered = sorted(files, key=lambda path: values[path][counting[0]])
    return ordered, [values[path][counting[0]] for path in ordered]


def told_of_numbers(files: Sequence[Path], numbers: Sequence[Decimal]) -> tuple[str, ...]:
    """A sentence on which of several changing numbers counts the files; none where one changes."""
    columns = zip(*(NUMBER.findall(path.stem) for path in files), strict=True)
    if sum(len(set(column)) > 1 for column in columns) < 2:
        return ()
    return (
        "Several numbers change in the names. The one that differs in all counts the pictures: "
        f"{numbers[0]} in {files[0].name}.",
    )


def _check_decimals(files: Sequence[Path], columns: Sequence[tuple[Decimal, ...]]) -> None:
    """ValueError where digits behind a point may be a decimal part or count the files: 1.8, 1.9, 1.10."""
    for column in columns:
        parts = [str(value).partition(".") for value in column]
        behind = sorted(int(digits) for *_, digits in parts if digits)
        if len(behind) < len(parts) or len({whole for whole, *_ in parts}) > 1:
            continue
        if len({len(digits) for *_, digits in parts}) > 1 and len(set(np.diff(behind))) == 1:
            raise ValueError(
                f"{files[0].parent}: {files[0].name} to {files[-1].name} may have decimal numbers, or count "
                "behind the point; wanted one order: fill the digits with zeros (1.09, 1.10)"
            )


def times_of_numbers(numbers: Sequence[Decimal], fps: float, *, where: Path) -> Array:
    """Times (t,) s from the first of pictures whose names have these numbers, taken fps a second.

    The numbers count the camera's pictures, so that a stride or a gap in them is one in time; or they are
    time stamps in s, ms, us or ns, whose usual step is that of fps. ValueError where both, or neither, may
    be.

    >>> times_of_numbers([Decimal(n) for n in (0, 20, 40, 80)], 20.0, where=Path("film")).tolist()
    [0.0, 1.0, 2.0, 4.0]
    >>> times_of_numbers([Decimal(n) for n in (1000, 1052, 1099)], 20.0, where=Path("film")).round(6).tolist()
    [0.0, 0.052, 0.099]
    """
    elapsed = np.array([float(number - numbers[0]) for number in numbers])
    step = np.diff(elapsed)
    usual = float(np.median(step)) if len(step) else 1.0
    clock = next((unit for unit, s in CLOCKS.items() if abs(usual * s * fps - 1.0) < NEAR), None)
    whole = all(number == number.to_integral_value() for number in numbers)
    even = whole and (usual < FEW or not np.any(step % step.min()))
    padded = len({(int(n), len(str(n))) for n in numbers}) == 1  # cam1.0001, cam1.0002
    if clock is not None and even and abs(elapsed * CLOCKS[clock] - elapsed / fps).max() > 1e-9:
        raise ValueError(
            f"{where}: the numbers in the names go up by {usual:g}, which may be time stamps in {clock} or "
            f"count pictures at fps = {fps:g}; {GIVE_TIMES}"
        )
    if clock is not None:
        return np.asarray(elapsed * CLOCKS[clock])
    if even:
        return np.asarray(elapsed / fps)
    if not whole and padded:
        return np.asarray(np.round(elapsed * 10.0 ** -int(numbers[0].as_tuple().exponent)) / fps)
    raise ValueError(
        f"{where}: the numbers in the names go up by {usual:g} from file to file, so that they neither count "
        f"pictures nor are time stamps at fps = {fps:g}; correct fps, or {GIVE_TIMES}"
    )
