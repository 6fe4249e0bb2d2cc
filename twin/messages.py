"""Messages to the user: lines of text and progress, printed, kept or dropped."""

from typing import Protocol


class Say(Protocol):
    """The messages of a stage to its user: lines of text, and the progress of its parts.

    A line is a result, or asks something of the user. Other remarks go to the run's log by `Run.note(text)`,
    which prints nothing.
    """

    def __call__(self, text: str, /) -> None: ...

    def progress(self, stage: str, done: int, total: int, /) -> None: ...


class Silent:
    """A `say` that says nothing."""

    def __call__(self, text: str, /) -> None: ...

    def progress(self, stage: str, done: int, total: int, /) -> None: ...


class Lines(Silent):
    """A `say` that keeps the lines, and shows no progress.

    >>> say = Lines()
    >>> say("Mesh: 7455 nodes.")
    >>> say.lines
    ['Mesh: 7455 nodes.']
    """

    def __init__(self) -> None:
        self.lines: list[str] = []

    def __call__(self, text: str, /) -> None:
        self.lines.append(text)
