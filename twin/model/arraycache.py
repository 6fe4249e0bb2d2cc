"""A cache of arrays that are expensive to make, by keys, and the part of a key that tells the code's version.

A key is a digest of everything that an array depends on. `code_digest` stands for the programs that make it.
"""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Protocol

from twin.targets import Array

ROOM = 1.005  # over a measured pressure: the maximum of a noisy log differs from film to film
ROOT = Path(__file__).resolve().parents[2]
# what an array of a model depends on
SOURCES = ("fe", "twin/model", "twin/laws", "twin/effects", "twin/gravity.py")


class ArrayCache(Protocol):
    """Gives the array of every task by its key: a stored one, or the one that the task makes now. stage: what
    is made, for whoever waits."""

    def __call__(self, stage: str, tasks: Mapping[str, Callable[[], Array]], /) -> dict[str, Array]: ...


def no_cache(stage: str, tasks: Mapping[str, Callable[[], Array]], /) -> dict[str, Array]:
    """The array of every task by its key, made now and stored nowhere."""
    del stage
    return {key: make() for key, make in tasks.items()}


@cache
def code_digest() -> str:
    """A digest of the version of softtwin and of the sources that make arrays."""
    return sources_digest(ROOT)


def sources_digest(root: Path, sources: Sequence[str] = SOURCES) -> str:
    """The digest of sources and tables below a folder that holds the packages, and of softtwin's version."""
    h = hashlib.sha256(metadata.version("softtwin").encode())
    for source in sources:
        folder = root / source
        below = (f for f in folder.rglob("*") if f.suffix in (".py", ".npz"))
        for file in [folder] if folder.is_file() else sorted(below):
            h.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return h.hexdigest()[:16]


def rounded_up(pressure: float) -> float:
    """A pressure of two digits, at least 0.5 % above the argument: logs of one nominal pressure ask for equal
    solves.

    >>> rounded_up(0.0301), rounded_up(0.0302)
    (0.031, 0.031)
    """
    if pressure <= 0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(ROOM * pressure)) - 1)
    return math.ceil(ROOM * pressure / unit) * unit
