"""Decoding beside the work on what was decoded: on two cores a film is followed while it is read."""

from collections.abc import Iterator
from queue import Full, Queue
from threading import Event, Thread
from typing import TypeVar

AHEAD = 4  # pictures that wait
PATIENCE = 0.05  # s, after which a full queue asks whether it is still wanted

Item = TypeVar("Item")


def ahead(items: Iterator[Item]) -> Iterator[Item]:
    """The same items in the same order, made in a thread of their own while the last ones are used.

    What the source raises is raised here, in its turn. The thread ends with the iteration, or its break.
    """
    waiting: Queue[tuple[bool, Item | BaseException | None]] = Queue(AHEAD)
    unwanted = Event()
    maker = Thread(target=_make, args=(items, waiting, unwanted), daemon=True)
    maker.start()
    try:
        while True:
            more, item = waiting.get()
            if isinstance(item, BaseException):
                raise item
            if not more:
                return
            yield item  # type: ignore[misc] - None only where there are no more
    finally:
        unwanted.set()
        maker.join()


def _make(
    items: Iterator[Item], waiting: "Queue[tuple[bool, Item | BaseException | None]]", unwanted: Event
) -> None:
    try:
        for item in items:
            if not _put(waiting, (True, item), unwanted):
                return
        _put(waiting, (False, None), unwanted)
    except BaseException as error:
        _put(waiting, (False, error), unwanted)


def _put(
    waiting: "Queue[tuple[bool, Item | BaseException | None]]",
    item: tuple[bool, Item | BaseException | None],
    unwanted: Event,
) -> bool:
    """Whether the item was taken before it became unwanted."""
    while not unwanted.is_set():
        try:
            waiting.put(item, timeout=PATIENCE)
            return True
        except Full:
            continue
    return False
