"""Where the command `twin` begins: an interrupt ends it without a traceback, also while it loads."""

import _thread
import os
import signal
import sys
import threading
from types import FrameType

INTERRUPTED = 130
AGAIN_S = 0.01  # after which an interrupt that was dropped is given once more


def start() -> None:
    """Run the command line and exit with its code."""
    signal.signal(signal.SIGINT, _leave)
    signal.signal(signal.SIGTERM, _interrupt)
    sys.unraisablehook = _ask_again
    try:
        _run()
    except KeyboardInterrupt:
        _leave(signal.SIGINT, None)


def _run() -> None:
    from twin.cli import main as run

    try:
        signal.signal(signal.SIGINT, _interrupt)
        run()
    finally:
        signal.signal(signal.SIGINT, _leave)  # nothing is at work any more


def _interrupt(number: int, frame: FrameType | None) -> None:
    """An end that is asked for is an interrupt: locks are given back, runs resume."""
    raise KeyboardInterrupt


def _leave(number: int, frame: FrameType | None) -> None:
    os.write(2, b"interrupted: run the same command again\n")
    os._exit(INTERRUPTED)


def _ask_again(lost: "sys.UnraisableHookArgs") -> None:
    """An interrupt that fell into a callback, where Python can only drop it, is given once more."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        again = threading.Timer(AGAIN_S, _once_more)  # not from here: this is a callback, too
        again.daemon = True
        again.start()
    else:
        sys.__unraisablehook__(lost)


def _once_more() -> None:
    if hasattr(signal, "pthread_kill"):  # which also wakes the main thread where it waits
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()
