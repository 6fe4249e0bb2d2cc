"""Results of an executor in the order of its tasks."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from twin.executors.protocol import Executor, Task


def gathered(
    executor: Executor, tasks: Sequence[Task], *, keep: Callable[[int, Any], None] | None = None
) -> Iterator[Any]:
    """The results in the order of the tasks, whichever ends first.

    keep: called with number and result of each task as it ends, for a cache on the disk: a killed run then
    keeps every finished result. It must not depend on the order.
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
