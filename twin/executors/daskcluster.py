"""Tasks on the workers of a scheduler of dask.distributed, which queues, retries and balances them.

A worker that dies gives its task back to the scheduler, which gives up after `allowed-failures` of dask's
configuration, 3 by default. A task that raises is not tried again: it would raise again.
"""

import asyncio
import concurrent.futures
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.reduction import ForkingPickler
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from twin import effort
from twin.executors.local import Serial, using
from twin.executors.protocol import Task, count, solved_by
from twin.executors.surroundings import Surroundings

if TYPE_CHECKING:
    from distributed import Client, Future, Worker

LOOK_S = 2.0  # without a result, after which the number of workers is checked
PATIENCE_S = 60.0  # without any worker: a nanny starts a new one within seconds
# what dask raises where somebody waits for a lost scheduler
CANCELLED = (asyncio.CancelledError, concurrent.futures.CancelledError)
AGAIN = "what was finished is kept: run the same command again, with or without --cluster"
START = "with `dask worker ADDRESS --nworkers N --nthreads 1`"


@dataclass(frozen=True)
class Dask:
    """The workers of a scheduler. name: as the user calls it; patience: seconds without any worker."""

    client: "Client"
    name: str
    patience: float = PATIENCE_S

    @property
    def workers(self) -> int:
        """Number of workers at present."""
        with self._reached():
            return len(self.client.nthreads())

    def check(self) -> list[str]:
        """Remarks on its workers, one sentence each, once there is one.

        ConnectionError where none comes, or where results of one might differ from those of this computer.
        """
        self._wait()
        with self._reached():
            replies = self.client.run(_seen_from_within, on_error="return")
        for address, seen in sorted(replies.items()):
            if not isinstance(seen, _Seen):
                raise ConnectionError(
                    f"worker {address} cannot load this version of softtwin ({type(seen).__name__}: {seen}); "
                    "install the same there, with the same Python"
                )
            if refused := seen.refused(Surroundings.here()):
                raise ConnectionError(refused)
        others = [s.name for s in replies.values() if s.of.processor != Surroundings.here().processor]
        if not others:
            return []
        return [f"Another processor than here on {', '.join(sorted(others))}: results may differ from those "
                "of this computer in the last digits."]  # fmt: skip

    def ended(self, tasks: Sequence[Task], /) -> Iterator[tuple[int, Any]]:
        """As `Executor.ended`. Tasks that run when they are cancelled come to their end there, unheard.

        ConnectionError where scheduler or workers are lost; ChildProcessError for a task that ends workers.
        """
        if not tasks:
            return
        with self._reached():
            futures = self._submitted(tasks)
        number = {future.key: k for k, future in enumerate(futures)}
        over: SimpleQueue[Future[Any]] = SimpleQueue()
        for future in futures:
            future.add_done_callback(over.put)
        pending = dict(zip(number, futures, strict=True))
        del futures, future  # a result that nobody refers to leaves its worker
        try:
            while pending:
                batch = [pending.pop(future.key) for future in self._some(over)]
                good = [future for future in batch if future.status == "finished"]
                for future, (result, solved) in zip(good, self._fetched(good), strict=True):
                    count(solved)
                    yield number[future.key], result
                if len(good) < len(batch):
                    bad = min((f for f in batch if f not in good), key=lambda f: number[f.key])
                    raise self._failed(bad, number)
        finally:
            if pending and self.client.status == "running":
                with suppress(*CANCELLED, OSError):  # it is lost meanwhile
                    self.client.cancel(list(pending.values()))

    def _submitted(self, tasks: Sequence[Task]) -> "list[Any]":
        import dask

        # as bytes: a task that dask itself cannot load ends its worker
        data = [bytes(ForkingPickler.dumps(task)) for task in tasks]
        # tasks carry their data, which dask would rather have beforehand; it warns of that
        with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 TiB"}):
            return self.client.map(_served, data, here=Surroundings.here(), pure=False)

    def _some(self, over: "SimpleQueue[Future[Any]]") -> "list[Future[Any]]":
        """The next futures to end, one or more."""
        lonely = None  # since when no worker is there
        while True:
            try:
                batch = [over.get(timeout=LOOK_S)]
                break
            except Empty:
                if self.workers:
                    lonely = None
                    continue
                lonely = lonely or time.monotonic()
                if time.monotonic() - lonely > self.patience:
                    raise self._deserted() from None
        while not over.empty():
            batch.append(over.get())
        return batch

    def _fetched(self, good: "Sequence[Future[Any]]") -> Any:
        """Results of finished futures. A result whose worker dies meanwhile is computed again."""
        time_s = self.patience
        while good:
            with self._reached(), suppress(TimeoutError):
                fetch = partial(self.client.gather, good, asynchronous=True)
                return self.client.sync(fetch, callback_timeout=time_s)
            if not self.workers:
                raise self._deserted()
            time_s *= 2  # results may be large
        return ()

    def _failed(self, future: "Future[Any]", number: Mapping[Any, int]) -> BaseException:
        from distributed import KilledWorker

        with self._reached():
            error = future.exception()
        if future.status == "cancelled" or isinstance(error, CANCELLED):
            return self._lost()
        task = f"task {number[future.key] + 1} of {len(number)}"
        if isinstance(error, KilledWorker):
            last = getattr(error.last_worker, "address", error.last_worker)
            return ChildProcessError(
                f"{task} ended every worker that ran it, {error.allowed_failures + 1} in all, the last "
                f"{last}: most likely its memory does not suffice; start workers with more, by "
                f"--memory-limit; {AGAIN}"
            )
        if isinstance(error, MemoryError):
            return ChildProcessError(f"{task}: the memory of its worker does not suffice ({error}); {AGAIN}")
        return error if isinstance(error, BaseException) else self._lost()

    # -- when nobody answers ---------------------------------------------------------------------------------

    def _wait(self) -> None:
        """Wait until a worker is there."""
        began = time.monotonic()
        while not self.workers:
            if time.monotonic() - began > self.patience:
                raise self._deserted()
            time.sleep(0.1)

    @contextmanager
    def _reached(self) -> Iterator[None]:
        """Block in which errors of a lost scheduler become one ConnectionError."""
        if self.client.status != "running":
            raise self._lost()
        try:
            yield
        except (*CANCELLED, OSError) as error:  # of connections and times, all of them OSErrors
            raise self._lost() from error

    def _lost(self) -> ConnectionError:
        return ConnectionError(f"the scheduler {self.name} has ended, or cannot be reached any more; {AGAIN}")

    def _deserted(self) -> ConnectionError:
        return ConnectionError(
            f"no worker at {self.name} for {self.patience:g} s; start some {START}; {AGAIN}"
        )


# -- on the worker -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Seen:
    """A worker's name, number of threads and surroundings."""

    name: str
    threads: int
    of: Surroundings

    def refused(self, here: Surroundings) -> str:
        """Reason why its results might differ from local ones, one sentence; "" without one."""
        if different := self.of.differences(here):
            return f"worker {self.name} has {'; '.join(different)}; install there what is here, or end it"
        if self.threads != 1:
            return (f"worker {self.name} has {self.threads} threads, wanted 1: tasks beside each other in "
                    f"one process disturb each other; start it {START}")  # fmt: skip
        if several := self.of.many_threads:
            return (f"worker {self.name} has {', '.join(several)}, wanted 1: sums of several threads differ "
                    "in the last digits; set it before the worker starts")  # fmt: skip
        return ""


def _of(worker: "Worker") -> _Seen:
    address, name = str(worker.address), str(worker.name)
    named = address if name == address else f"{address} ({name})"
    return _Seen(named, worker.state.nthreads, Surroundings.here())


def _seen_from_within(dask_worker: "Worker") -> _Seen:
    """The worker that runs this function."""
    return _of(dask_worker)


def _served(data: bytes, *, here: Surroundings) -> tuple[Any, effort.Effort]:
    """A pickled task's result and what it solved, on a worker that agrees with the computer which asks. One
    that came later than the check is refused here."""
    from distributed import get_worker

    seen = _of(get_worker())
    if refused := seen.refused(here):
        raise ConnectionError(refused)
    try:
        task = ForkingPickler.loads(data)
    except (ImportError, AttributeError) as error:
        raise ConnectionError(
            f"worker {seen.name} cannot load a task ({error}); install there what is here"
        ) from error
    with using(Serial()):
        return solved_by(task)
