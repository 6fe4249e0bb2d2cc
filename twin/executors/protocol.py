"""The interface of executors: they run tasks, yield results as tasks end, and cancel the rest.

A task is a pickled call (functools.partial of a module's function) that carries all its data and depends on
no other. So its result is the same to the bit wherever it runs.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

from twin import effort

Task = Callable[[], Any]


class Executor(Protocol):
    """A place to run tasks: processes of this machine, or a cluster."""

    @property
    def workers(self) -> int:
        """Number of tasks that run at a time."""
        ...

    def ended(self, tasks: Sequence[Task], /) -> Iterator[tuple[int, Any]]:
        """Number and result of each task, in the order in which the tasks end.

        Tasks start in the order given. Closing the iterator, or Ctrl-C, cancels the tasks that remain. An
        error of a task is raised here; the equations that it solved are counted here.
        """
        ...


def solved_by(task: Task) -> tuple[Any, effort.Effort]:
    """A task's result, and the number and size of its solves."""
    before = effort.so_far()
    return task(), effort.since(before)


def count(solved: effort.Effort) -> None:
    """Add the solves of a worker to this process's own."""
    for kind, solves in solved.items():
        effort.add(kind, *solves)
