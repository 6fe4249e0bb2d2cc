"""Executors on this machine: serial, threads and processes."""

import multiprocessing as mp
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
    wait,
)
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

from twin.executors.protocol import Executor, Task, count, solved_by

WORKERS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Serial:
    """Serial executor: a task runs when its result is requested, in order.

    >>> list(Serial().ended([int, lambda: 2 + 2]))
    [(0, 0), (1, 4)]
    """

    workers: int = 1

    def ended(self, tasks: Sequence[Task], /) -> Iterator[tuple[int, Any]]:
        """As `Executor.ended`."""
        for k, task in enumerate(tasks):
            yield k, task()


@dataclass(frozen=True)
class Processes:
    """Executor on several processes; a single task, and a task of a worker, runs in this process."""

    workers: int = WORKERS

    def ended(self, tasks: Sequence[Task], /) -> Iterator[tuple[int, Any]]:
        """As `Executor.ended`; no process outlives whoever listens."""
        if self.workers < 2 or len(tasks) < 2 or mp.parent_process() is not None:
            yield from Serial().ended(tasks)
            return
        # a fresh interpreter each: a fork would inherit threads of the numerical libraries in mid-work
        with _no_local_imports():  # the pool's semaphores start a process, too
            pool = ProcessPoolExecutor(
                min(self.workers, len(tasks)), mp_context=mp.get_context("spawn"), initializer=_serve
            )
        try:
            # a worker that is only starting would answer an interrupt with a traceback
            with _no_interrupt(), _no_local_imports():
                number: dict[Future[Any], int] = {pool.submit(solved_by, t): k for k, t in enumerate(tasks)}
            pending = set(number)
            while pending:
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                for future in sorted(done, key=number.__getitem__):
                    result, solved = future.result()
                    count(solved)
                    yield number[future], result
        except BaseException:
            for process in list((pool._processes or {}).values()):
                process.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


@dataclass(frozen=True)
class Threads:
    """Executor on several threads, for tasks that wait for another program: a thread starts at once, where
    a process takes seconds.

    >>> sorted(Threads(2).ended([int, str]))
    [(0, 0), (1, '')]
    """

    workers: int

    def ended(self, tasks: Sequence[Task], /) -> Iterator[tuple[int, Any]]:
        """As `Executor.ended`; what has begun is waited for."""
        with ThreadPoolExecutor(self.workers) as pool:
            number = {pool.submit(task): k for k, task in enumerate(tasks)}
            try:
                for future in as_completed(number):
                    yield number[future], future.result()
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise


# The executor in use is no argument of every function between a command and its solves, since no result
# depends on it.
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


@contextmanager
def _no_local_imports() -> Iterator[None]:
    """Block whose child processes import nothing from the current folder, which may be a stranger's."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Block that defers Ctrl-C while processes start; these inherit it and never receive one."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    interrupts: list[int] = []
    # blocked here, it reaches another thread, and would be raised here all the same
    handler = signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        signal.signal(signal.SIGINT, handler if handler is not None else signal.SIG_DFL)
        if interrupts:
            signal.raise_signal(signal.SIGINT)


def _serve() -> None:
    """Ctrl-C is for the parent, which ends its workers; and without a parent there is nothing to work for."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, daemon=True).start()


def _leave_with_parent() -> None:
    parent = mp.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
