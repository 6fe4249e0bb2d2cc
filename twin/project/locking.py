"""Turn a lock file into one writing command at a time; the lock of a dead process is taken over."""

import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def lock(path: Path, command: str) -> Iterator[None]:
    """Hold the lock file while the block runs; ValueError says which living process holds it already."""
    mine = {"pid": os.getpid(), "host": platform.node(), "command": command, "started": _started(os.getpid())}
    _take(path, mine)
    try:
        yield
    finally:
        if _owner(path) == mine:
            path.unlink(missing_ok=True)


def _take(path: Path, mine: dict[str, Any]) -> None:
    draft = path.with_name(f"{path.name}.{mine['pid']}")
    draft.write_text(json.dumps(mine), encoding="utf-8")
    try:
        for _ in range(5):  # another process may take a dead lock over between two steps of ours
            try:
                os.link(draft, path)  # fails if the lock is there; a link is never seen half written
                return
            except FileExistsError:
                _clear_dead(path)
    finally:
        draft.unlink(missing_ok=True)
    raise ValueError(f"{path}: another command is taking the lock at this moment; try again")


def _clear_dead(path: Path) -> None:
    """Remove the lock if its process is gone, else raise ValueError."""
    owner = _owner(path)
    if owner is None:
        return
    if _alive(owner):
        raise ValueError(
            f"{path}: `twin {owner.get('command')}` (process {owner.get('pid')} on {owner.get('host')}) is "
            "writing to this project; wait for it, or remove this file if that process is gone"
        )
    aside = path.with_name(f"{path.name}.dead.{os.getpid()}")
    try:
        os.rename(path, aside)
    except FileNotFoundError:
        return  # somebody else cleared it first
    if _owner(aside) != owner:  # a living lock came in between: put it back
        os.link(aside, path)
    aside.unlink(missing_ok=True)


def _owner(path: Path) -> dict[str, Any] | None:
    """Return what the lock says, {} where it cannot be read, None where there is no lock."""
    try:
        owner = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except ValueError:
        return {}
    return owner if isinstance(owner, dict) else {}


def _alive(owner: dict[str, Any]) -> bool:
    """Return whether the process that wrote the lock may still run; one on another host may."""
    if not isinstance(owner.get("pid"), int):
        return False  # an empty or broken file locks nothing
    if owner.get("host") != platform.node() or os.name == "nt":
        return True
    try:
        os.kill(owner["pid"], 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return _started(owner["pid"]) == owner.get("started")  # else the number was given to a new process


def _started(pid: int) -> str:
    """Return the start time of a process in kernel ticks, '' where the system does not tell."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return ""
    return stat.rpartition(")")[2].split()[19]
