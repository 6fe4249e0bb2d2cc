"""The formats of other programs, by their names in [import] of twin.toml, and which of them a file has."""

from collections.abc import Callable
from pathlib import Path

from twin import files
from twin.formats.anipose import read_anipose
from twin.formats.deeplabcut import read_deeplabcut
from twin.formats.dice import read_dice
from twin.formats.importtable import LIKELY
from twin.formats.lostpoints import without_lost
from twin.formats.matchid import read_matchid
from twin.formats.motioncapture import read_c3d
from twin.formats.plainpoints import read_plain
from twin.formats.recorded import Recorded

FORMATS: dict[str, Callable[[Path, float], Recorded]] = {
    "deeplabcut": read_deeplabcut,
    "anipose": read_anipose,
    "dice": read_dice,
    "matchid": read_matchid,
    "c3d": read_c3d,
    "csv": read_plain,
}


def read_recorded(path: Path, name: str, min_likelihood: float = LIKELY) -> Recorded:
    """The points of a file or folder in a named format; below `min_likelihood` a point counts as not seen.
    ValueError for an unknown format."""
    if name not in FORMATS:
        raise ValueError(f"format {name}: wanted one of {', '.join(FORMATS)}")
    files.check_plain(path)
    return without_lost(FORMATS[name](path, min_likelihood))


def format_of(path: Path) -> str:
    """The format that a file or folder shows by its names or its first line. ValueError where it shows none.
    """
    if path.is_dir():
        patterns = {"DICe_solution_*.txt": "dice", "*.csv": "matchid"}
        name = next((form for pattern, form in patterns.items() if any(path.glob(pattern))), "")
    elif path.suffix.lower() == ".c3d":
        name = "c3d"
    else:
        name = _told_by(path)
    if not name:
        raise ValueError(
            f"--targets {path}: wanted a folder with targets.csv, or --format with the name of the program "
            f"that wrote it: {', '.join(FORMATS)}"
        )
    return name


def _told_by(path: Path) -> str:
    """The format that the first line of a text file shows, "" for none."""
    files.check_plain(path)
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        head = file.readline(100_000)
    if head.startswith("scorer"):
        return "deeplabcut"
    return "anipose" if "_ncams" in head else "csv" if path.suffix.lower() == ".csv" else ""
