"""What every executor does: submit tasks, give their results as they end, and cancel what is left.

A task is a pickled call (functools.partial of a module's function) that carries all its data and depends on
no other. So its result is the same to the bit wherever it runs.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

from twin import effort

Task = Callable[[], Any]


class Executor(Protocol):
    """Somewhere to run tasks."""

    @property
    def workers(self) -> int:
        """How many tasks it runs at a time."""
        ...

    def ended(self, tasks: Sequence[Task], /) -> Iterator[tuple[int, Any]]:
        """Number and result of each task as it ends, in any order.

        Tasks start in the order given. Who stops listening, or is interrupted, cancels what is left. What a
        task raises is raised here, what it solved is counted here.
        """
        ...


def gathered(
    executor: Executor, tasks: Sequence[Task], *, keep: Callable[[int, Any], None] | None = None
) -> Iterator[Any]:
    """The results in the order of the tasks, whichever ends first.

    keep: told number and result of each as it ends, for a cache on the disk: a killed run then keeps more
    than what came in order. It must not depend on the order.
    """
    waiting: dict[int, Any] = {}
    due = 0
    for k, result in executor.ended(tasks):
        if keep is not None:
            keep(k, result)
        waiting[k] = result
        while due in waiting:
            yield waiting.pop(due)
            due += 1


def solved_by(task: Task) -> tuple[Any, effort.Effort]:
    """A task's result, and what it has solved."""
    before = effort.so_far()
    return task(), effort.since(before)


def count(solved: effort.Effort) -> None:
    """Count here what a worker has solved."""
    for kind, solves in solved.items():
        effort.add(kind, *solves)
