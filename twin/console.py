"""Turn what a stage says into lines and a bar, and what goes wrong into one sentence and an exit code."""

import json
import os
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:  # rich takes a third of a second to import: only a terminal pays for it
    from rich.progress import Progress, TaskID

BAD_INPUT, INTERNAL, INTERRUPTED = 2, 1, 130
PLAIN_EVERY = 30.0  # s between progress lines where no terminal shows a bar
# Letters by which a text steers a terminal: control letters but tab and new line, and turns of direction.
_STEERING = [*range(9), *range(11, 32), *range(127, 160), *range(0x202A, 0x202F), *range(0x2066, 0x206A)]
_AS_CODES = {code: f"\\x{code:02x}" if code < 256 else f"\\u{code:04x}" for code in _STEERING}


def shown(text: str) -> str:
    """A text as a terminal may show it: letters that would steer it stand as their codes.

    >>> print(shown("\x1b[31mred"))
    \\x1b[31mred
    """
    return text.translate(_AS_CODES)


def _print(text: str, stream: TextIO | None) -> None:
    """Print a line. One who reads no more, as `head` does after its last line, stops no command."""
    try:
        print(shown(text), file=stream, flush=True)
    except BrokenPipeError:
        if stream is not None:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class Console:
    """Prints a stage's lines on stdout (on stderr if stdout is for JSON), its progress on stderr."""

    def __init__(self, *, as_json: bool) -> None:
        self.as_json = as_json
        self._bar: Progress | None = None
        self._tasks: dict[str, TaskID] = {}
        self._last = time.monotonic()
        self._began: dict[str, tuple[float, int]] = {}  # when a part was first heard of, and how far it was
        self._reached: dict[str, int] = {}

    def __call__(self, text: str, /) -> None:
        """Print one line; a bar is cleared first, so that lines never mix with it."""
        self.close()
        _print(text, sys.stderr if self.as_json else sys.stdout)

    def progress(self, stage: str, done: int, total: int, /) -> None:
        """Show the progress of a part of a stage and its remaining time: a bar on a terminal, else a line
        every PLAIN_EVERY seconds."""
        if done < self._reached.get(stage, done + 1):  # a part is new, or comes again
            self._began[stage] = time.monotonic(), done
        self._reached[stage] = done
        if sys.stderr is not None and sys.stderr.isatty():
            self._draw(stage, done, total)
        elif time.monotonic() - self._last >= PLAIN_EVERY:
            self._last = time.monotonic()
            _print(f"  {stage}: {done} of {total}{self._left(stage, done, total)}", sys.stderr)

    def result(self, result: dict[str, Any]) -> None:
        """Print a stage's result as one line of JSON, if that was asked for."""
        self.close()
        if self.as_json:
            from twin import files

            _print(json.dumps(files.plain(result), allow_nan=False), sys.stdout)

    def close(self) -> None:
        """Clear the bar."""
        if self._bar is not None:
            self._bar.stop()
            self._bar, self._tasks = None, {}

    def _left(self, stage: str, done: int, total: int) -> str:
        """Remaining time of a part at its mean speed, in words; empty before the first step is done."""
        began, done_before = self._began[stage]
        if not done_before < done < total:
            return ""
        seconds = (time.monotonic() - began) * (total - done) / (done - done_before)
        return f", about {seconds:.0f} s left" if seconds < 100 else f", about {seconds / 60:.0f} min left"

    def _draw(self, stage: str, done: int, total: int) -> None:
        if self._bar is None:
            from rich.console import Console as Terminal
            from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

            columns = (
                TextColumn("  {task.description}"),
                BarColumn(),
                TextColumn("{task.completed}/{task.total}"),
            )
            times = (TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
            self._bar = Progress(*columns, *times, console=Terminal(stderr=True), transient=True)
            self._bar.start()
        if stage not in self._tasks:
            self._tasks[stage] = self._bar.add_task(stage, total=total)
        self._bar.update(self._tasks[stage], completed=done, total=total)


def guarded(work: Callable[[], Any], *, debug: bool) -> int:
    """Run a command and return its exit code; one sentence on stderr says what went wrong, no traceback.

    0 done, 2 bad input, 130 interrupted, 1 anything else (with `debug` its traceback).
    """
    try:
        work()
    except KeyboardInterrupt:
        return _say(
            "interrupted: what was finished is kept; run the same command again to resume", INTERRUPTED
        )
    except Exception as error:
        if debug:
            raise
        if _is_input(error):
            return _say(f"error: {_sentence(error)}", BAD_INPUT)
        return _say(f"internal error: {type(error).__name__}: {_sentence(error)} (run it with --debug after "
                    "`twin` for the traceback)", INTERNAL)  # fmt: skip
    return 0


def _is_input(error: Exception) -> bool:
    """True if the user can mend it: bad input, or a file system that refuses."""
    # numpy's LinAlgError is a ValueError too, but no user caused it
    return isinstance(error, ValueError | OSError | MemoryError) and type(error).__name__ != "LinAlgError"


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        place = error.filename or "a file or the output, whose name the system does not say"
        return f"{place}: {error.strerror}"
    if isinstance(error, MemoryError):
        return f"the memory of this computer does not suffice: {error}; take a coarser mesh, or fewer points"
    return " ".join(str(error).split())


def _say(text: str, code: int) -> int:
    _print(text, sys.stderr)
    return code
