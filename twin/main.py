"""Start of the command `twin`: an interrupt ends it without a traceback, also while it loads."""

import _thread
import os
import signal
import sys
import threading
import time
from types import FrameType

INTERRUPTED = 130
IMPORT = "<frozen importlib._bootstrap>"  # the file of an import's frames
PATIENCE_S = 5.0  # for which an import is waited for: it may be of code that never ends
AGAIN_S = 0.01  # after which an interrupt that was dropped, or came too early, is given once more


def start() -> None:
    """Run the command line and exit with its code."""
    _keep_out()
    signal.signal(signal.SIGINT, _leave)
    signal.signal(signal.SIGTERM, _interrupt)
    sys.unraisablehook = _ask_again
    try:
        _run()
    except KeyboardInterrupt:
        _leave(signal.SIGINT, None)


def _keep_out() -> None:
    """Import nothing from the current folder, here or in a child process: it may be a stranger's. An empty or
    relative part of PYTHONPATH leads there, too, and counts only where this program itself lies."""
    own = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    parts = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    stated = {own, *filter(os.path.isabs, parts)}
    os.environ["PYTHONSAFEPATH"] = "1"
    os.environ["PYTHONPATH"] = os.pathsep.join(p for p in map(os.path.abspath, parts) if p in stated)
    strange = {os.path.abspath(p) for p in ("", *parts) if not os.path.isabs(p)} - stated
    sys.path[:] = [p for p in sys.path if os.path.abspath(p) not in strange]


def _run() -> None:
    from twin.cli import main as run

    try:
        signal.signal(signal.SIGINT, _interrupt)
        run()
    finally:
        signal.signal(signal.SIGINT, _leave)  # nothing is at work any more


_asked: list[float] = []  # when the interrupt that waits was asked for


def _interrupt(number: int, frame: FrameType | None) -> None:
    """An end that is asked for is an interrupt: locks are given back, runs resume. A library that is being
    loaded is loaded first: in C, it takes an interrupt for an error of its own, or aborts."""
    now = time.monotonic()
    if not _asked:
        _asked.append(now)
    if _loads(frame) and now - _asked[0] < PATIENCE_S:
        _ask_later()
    else:
        _asked.clear()
        raise KeyboardInterrupt


def _loads(frame: FrameType | None) -> bool:
    """True if a frame is reached by an import."""
    while frame is not None and frame.f_code.co_filename != IMPORT:
        frame = frame.f_back
    return frame is not None


def _leave(number: int, frame: FrameType | None) -> None:
    os.write(2, b"interrupted: run the same command again\n")
    os._exit(INTERRUPTED)


def _ask_again(lost: "sys.UnraisableHookArgs") -> None:
    """An interrupt that fell into a callback, where Python can only drop it, is given once more."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        _ask_later()  # not from here: this is a callback, too
    else:
        sys.__unraisablehook__(lost)


def _ask_later() -> None:
    again = threading.Timer(AGAIN_S, _once_more)
    again.daemon = True
    again.start()


def _once_more() -> None:
    if hasattr(signal, "pthread_kill"):  # which also wakes the main thread where it waits
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()
