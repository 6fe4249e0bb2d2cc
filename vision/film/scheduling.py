"""A block after which the process is scheduled as it was before it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress


@contextmanager
def as_before() -> Iterator[None]:
    """A block after which all threads of the process are scheduled as the one that enters it.

    Where root runs it, SVT-AV1 makes its process a real-time one when it opens, before which every other
    program of the computer has to wait, and leaves it so.
    """
    if not hasattr(os, "sched_getscheduler"):  # Linux has it
        yield
        return
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        for thread in map(int, os.listdir("/proc/self/task")):
            with suppress(ProcessLookupError):  # it has ended since
                if os.sched_getscheduler(thread) != policy:
                    os.sched_setscheduler(thread, policy, priority)
