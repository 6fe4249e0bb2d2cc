"""Takes a picture of a rerun file as the viewer shows it.

    python benchmarks/review_picture.py review.rrd picture.png generation 20

Needs a Vulkan driver; without a graphics card Mesa's will do (Debian: apt-get install mesa-vulkan-drivers).
"""

import argparse
import socket
import time
from pathlib import Path

from rerun.experimental import ViewerClient


def screenshot(rrd: Path, png: Path, timeline: str, value: float, *, width: int = 1800) -> None:
    """Write `png`: the file `rrd` at `value` of `timeline` (generation number, or film_time in s)."""
    with ViewerClient.spawn(headless=True, port=_free_port(), hide_welcome_screen=True) as viewer:
        viewer.open(str(rrd.resolve()))
        while viewer.get_state().loading:
            time.sleep(0.05)
        if timeline == "generation":
            viewer.set_time(timeline, sequence=int(value), play_state="paused")
        else:
            viewer.set_time(timeline, duration=value, play_state="paused")
        time.sleep(4.0)  # the viewer does not say when the film's frame is decoded
        png.write_bytes(viewer.take_screenshot(max_size=width))


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def main() -> None:
    arguments = argparse.ArgumentParser(description="Take a picture of a rerun file as the viewer shows it.")
    arguments.add_argument("rrd", type=Path)
    arguments.add_argument("png", type=Path)
    arguments.add_argument("timeline", choices=("generation", "film_time"))
    arguments.add_argument("value", type=float, help="number of the generation, or film time in s")
    given = arguments.parse_args()
    screenshot(given.rrd, given.png, given.timeline, given.value)


if __name__ == "__main__":
    main()
