"""Decoding beside the work on what was decoded: on two cores a film is followed while it is read."""

from collections.abc import Callable, Iterator
from functools import partial
from queue import Full, Queue
from threading import Event, Thread
from typing import NoReturn, TypeVar

AHEAD = 4  # pictures that wait
PATIENCE = 0.05  # s, after which a full queue asks whether it is still wanted

Item = TypeVar("Item")


def ahead(items: Iterator[Item]) -> Iterator[Item]:
    """The items in their order, made in a thread of their own while the last ones are used.

    What the source raises is raised here, in its turn. The thread ends with the iteration, or its break.
    """
    waiting: Queue[Callable[[], Item]] = Queue(AHEAD)
    unwanted = Event()
    maker = Thread(target=_make, args=(items, waiting, unwanted), daemon=True)
    maker.start()
    try:
        while True:
            try:
                item = waiting.get()()
            except _NoMore:
                return
            yield item
    finally:
        unwanted.set()
        maker.join()


class _NoMore(Exception):
    """The source has ended."""


def _make(items: Iterator[Item], waiting: "Queue[Callable[[], Item]]", unwanted: Event) -> None:
    try:
        for item in items:
            if not _put(waiting, partial(_given, item), unwanted):
                return
        _put(waiting, partial(_raised, _NoMore()), unwanted)
    except BaseException as error:
        _put(waiting, partial(_raised, error), unwanted)


def _given(item: Item) -> Item:
    return item


def _raised(error: BaseException) -> NoReturn:
    raise error


def _put(waiting: "Queue[Callable[[], Item]]", item: Callable[[], Item], unwanted: Event) -> bool:
    """True if the item was taken before it became unwanted."""
    while not unwanted.is_set():
        try:
            waiting.put(item, timeout=PATIENCE)
            return True
        except Full:
            continue
    return False
