"""Where the command `twin` begins: an interrupt ends it without a traceback, also while it loads."""

import os
import signal
from types import FrameType

INTERRUPTED = 130


def main() -> None:
    """Run the command line and exit with its code."""
    signal.signal(signal.SIGINT, _leave)
    signal.signal(signal.SIGTERM, _interrupt)
    from twin.cli import main as run

    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        run()
    except KeyboardInterrupt:
        _leave(signal.SIGINT, None)
    finally:
        signal.signal(signal.SIGINT, _leave)  # nothing is at work any more


def _interrupt(number: int, frame: FrameType | None) -> None:
    """An end that is asked for is an interrupt: locks are given back, runs resume."""
    raise KeyboardInterrupt


def _leave(number: int, frame: FrameType | None) -> None:
    os.write(2, b"interrupted: run the same command again\n")
    os._exit(INTERRUPTED)
