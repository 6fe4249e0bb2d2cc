"""Messages to the user: lines of text and progress, printed, kept or dropped."""

from typing import Protocol


class Say(Protocol):
    """How a stage talks to the user: one line of text, or how far a part of it is.

    Only what asks something of the user, or is a result, is said. A remark that asks nothing goes to the
    run's log with `Run.note(text)`, which prints nothing.
    """

    def __call__(self, text: str, /) -> None: ...

    def progress(self, stage: str, done: int, total: int, /) -> None: ...


class Silent:
    """A `say` that says nothing."""

    def __call__(self, text: str, /) -> None: ...

    def progress(self, stage: str, done: int, total: int, /) -> None: ...


class Lines(Silent):
    """A `say` that keeps the lines, and shows no progress."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def __call__(self, text: str, /) -> None:
        self.lines.append(text)
