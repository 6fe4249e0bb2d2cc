"""The projects below a folder, one a batch, in the order of their names."""

import re
from collections.abc import Callable
from pathlib import Path

from twin.project.folder import Project


def batches_in(folder: Path) -> list[Path]:
    """The project folders below a folder, in the order of their names (batch-9 before batch-10)."""
    folders = [path.parent for path in folder.glob("*/twin.toml")]
    return sorted(
        (path for path in folders if not path.name.startswith(".")), key=lambda path: _natural(path.name)
    )


def holds_batches(folder: Path) -> bool:
    """True for a folder that is no project itself and has projects below it."""
    return not (folder / "twin.toml").is_file() and bool(batches_in(folder))


def _natural(name: str) -> list[tuple[int, int, str]]:
    """A key by which numbers in a name count as numbers."""
    parts = re.findall(r"\d+|\D+", name)
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]


Opened = Callable[[Path], Project]
