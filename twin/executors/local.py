"""Tasks in this process, in threads of it, and in other processes of this machine."""

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
from dataclasses import dataclass
from typing import Any

from twin.executors.protocol import Task, count, solved_by

WORKERS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Serial:
    """This process: a task at a time, in order, and only when its result is asked for."""

    workers: int = 1

    def ended(self, tasks: Sequence[Task], /) -> Iterator[tuple[int, Any]]:
        """As `Executor.ended`."""
        for k, task in enumerate(tasks):
            yield k, task()


@dataclass(frozen=True)
class Processes:
    """So many processes of this machine; where one would do, and in a worker, this process."""

    workers: int = WORKERS

    def ended(self, tasks: Sequence[Task], /) -> Iterator[tuple[int, Any]]:
        """As `Executor.ended`; no process outlives whoever listens."""
        if self.workers < 2 or len(tasks) < 2 or mp.parent_process() is not None:
            yield from Serial().ended(tasks)
            return
        # a fresh interpreter each: a fork would inherit threads of the numerical libraries in mid-work
        pool = ProcessPoolExecutor(
            min(self.workers, len(tasks)), mp_context=mp.get_context("spawn"), initializer=_serve
        )
        try:
            with _no_interrupt():  # a worker that is only starting would answer it with a traceback
                number: dict[Future[Any], int] = {pool.submit(solved_by, t): k for k, t in enumerate(tasks)}
            left = set(number)
            while left:
                done, left = wait(left, return_when=FIRST_COMPLETED)
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
    """So many threads of this process, for tasks that wait for another program: they start at once, where a
    process takes seconds."""

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


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Ctrl-C waits while processes are started, and never reaches those: they inherit that."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    asked: list[int] = []
    # blocked here, it reaches another thread, and would be raised here all the same
    handler = signal.signal(signal.SIGINT, lambda number, _: asked.append(number))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        signal.signal(signal.SIGINT, handler if handler is not None else signal.SIG_DFL)
        if asked:
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
