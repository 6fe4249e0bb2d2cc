"""Counts of solves by kind, with their processor time in s; workers' solves count, too."""

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple, Protocol

COLUMNS, FINER, PATHS, PLANNED = "columns of tangents", "finer meshes", "load paths", "planned films"


class Solves(NamedTuple):
    """Number of solves, and their processor time in s.

    >>> Solves(12, 30.1)
    Solves(n=12, cpu_s=30.1)
    """

    n: int = 0
    cpu_s: float = 0.0


class Counted(Protocol):
    """Protocol of a count of solves: `Solves`, or a row of run.json."""

    @property
    def n(self) -> int: ...

    @property
    def cpu_s(self) -> float: ...


Effort = Mapping[str, Solves]  # by kind
_made: dict[str, Solves] = {}


def kind_of(*, history: bool, derivatives: bool) -> str:
    """The kind of a whole solve, in words.

    >>> kind_of(history=True, derivatives=True), kind_of(history=False, derivatives=False)
    ('with history and derivatives', 'plain')
    """
    with_what = [word for word, there in (("history", history), ("derivatives", derivatives)) if there]
    return f"with {' and '.join(with_what)}" if with_what else "plain"


def add(kind: str, n: int, cpu_s: float) -> None:
    """Count solves of a kind."""
    so_far_of_kind = _made.get(kind, Solves())
    _made[kind] = Solves(so_far_of_kind.n + n, so_far_of_kind.cpu_s + cpu_s)


@contextmanager
def counted(kind: str) -> Iterator[None]:
    """Context manager that counts its block as one solve of a kind, also where it fails."""
    start = time.process_time()
    try:
        yield
    finally:
        add(kind, 1, time.process_time() - start)


def so_far() -> Effort:
    """All that this process has solved."""
    return dict(_made)


def since(before: Effort) -> Effort:
    """Solves since an earlier `so_far`."""
    earlier = {kind: before.get(kind, Solves()) for kind in _made}
    more = {kind: Solves(s.n - earlier[kind].n, s.cpu_s - earlier[kind].cpu_s) for kind, s in _made.items()}
    return {kind: solves for kind, solves in more.items() if solves.n}


def processor_s() -> float:
    """Seconds of processor of this process and of the workers that it has ended."""
    return time.process_time() + sum(os.times()[2:4])


def in_words(effort: Mapping[str, Counted]) -> str:
    """The counts in a line; empty where nothing was solved.

    >>> in_words({"plain": Solves(12, 30.1), "with history": Solves(4, 52.0)})
    '12 plain in 30.1 s, 4 with history in 52.0 s'
    """
    return ", ".join(f"{s.n} {kind} in {s.cpu_s:.1f} s" for kind, s in effort.items())
