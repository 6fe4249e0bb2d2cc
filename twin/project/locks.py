"""One writing command at a time: the lock of a project, which the system releases when its process ends."""

import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from twin import files

LOOKS, LOOK_S = 10, 0.05  # how often the name of the other command is looked for, and the time between, s


@contextmanager
def lock(path: Path, command: str) -> Iterator[None]:
    """Hold the lock file while the block runs; ValueError says which command holds it already."""
    owner = path.with_name(f"{path.name}.json")  # beside it: on some systems nobody can read a locked file
    try:
        with FileLock(path, blocking=False):
            try:  # from before the file is there: an interrupt may come at once
                files.write_json(owner, {"command": command, "process": os.getpid(), "host": platform.node()})
                yield
            finally:
                owner.unlink(missing_ok=True)
    except Timeout:
        raise ValueError(f"{path}: {_who(owner)} is writing to this project; wait for it to end") from None


def _who(owner: Path) -> str:
    for _ in range(LOOKS):
        try:
            told = files.read_json(owner)
            return f"`twin {told['command']}` (process {told['process']} on {told['host']})"
        except (ValueError, KeyError, TypeError, OSError):  # one that has just begun is about to write it
            time.sleep(LOOK_S)
    return "another command"
