"""The formats of other programs, by the names that `twin init --format` takes."""

from collections.abc import Callable
from pathlib import Path

from twin.formats.anipose import read_anipose
from twin.formats.deeplabcut import read_deeplabcut
from twin.formats.dice import read_dice
from twin.formats.matchid import read_matchid
from twin.formats.motioncapture import read_c3d
from twin.formats.plainpoints import read_plain
from twin.formats.recorded import Doubt, Recorded

FORMATS: dict[str, Callable[[Path, Doubt], Recorded]] = {
    "deeplabcut": read_deeplabcut,
    "anipose": read_anipose,
    "dice": read_dice,
    "matchid": read_matchid,
    "c3d": read_c3d,
    "csv": read_plain,
}


def read_recorded(path: Path, name: str, doubt: Doubt) -> Recorded:
    """What a file or folder in a format holds; ValueError for a format that is not known."""
    if name not in FORMATS:
        raise ValueError(f"--format {name}: wanted one of {', '.join(FORMATS)}")
    return FORMATS[name](path, doubt)
