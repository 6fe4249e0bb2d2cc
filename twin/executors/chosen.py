"""The executor in use: the processors of this machine unless a block says otherwise.

It is no argument of every function between a command and its solves, since nothing that they give depends on
it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from twin.executors.local import Processes
from twin.executors.protocol import Executor

LOCAL = Processes()
_used: ContextVar[Executor] = ContextVar("executor", default=LOCAL)


def current() -> Executor:
    """The executor in use."""
    return _used.get()


@contextmanager
def using(executor: Executor) -> Iterator[None]:
    """Use an executor in the block."""
    before = _used.set(executor)
    try:
        yield
    finally:
        _used.reset(before)
