"""A path that rerun can write: it takes names in UTF-8 alone, whatever the machine's language has."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def plain_path(path: Path) -> Iterator[Path]:
    """The path itself, or, where UTF-8 cannot hold its name, a file elsewhere that is moved there."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        with tempfile.TemporaryDirectory() as folder:
            yield Path(folder) / "plain.rrd"
            shutil.move(Path(folder) / "plain.rrd", path)
    else:
        yield path
