"""A recording in a browser: served to this machine alone, opened in headless Chromium, and drawn."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun as rr

from tests.browser import WAIT_S, Browser, answers, own_address, two_ports
from twin.batches.side import write_merged

DRAWN_S = 240.0  # a software renderer beside another test: 10 s on two idle cores
LEFT, RIGHT = (230, 30, 200), (30, 200, 60)  # colours that the viewer itself does not have


def recording(path: Path, colour: tuple[int, int, int]) -> Path:
    """A file with a picture of one colour where the review has its film."""
    stream = rr.RecordingStream("softtwin")
    stream.save(path)
    stream.set_time("film_time", duration=0.0)
    stream.log("film/frame", rr.Image(np.full((40, 60, 3), colour, np.uint8)))
    stream.disconnect()
    return path


@pytest.fixture
def served(tmp_path):
    """`served(rrd)`: the ports of data and page, served to this machine alone until the test ends."""
    command = Path(sys.executable).with_name("rerun")
    started = []

    def serve(rrd: Path) -> tuple[int, int]:
        data, page = two_ports()
        bound = ["--bind", "127.0.0.1", "--port", str(data), "--web-viewer-port", str(page)]
        # `rerun` starts another program that serves, and leaves it behind when it ends: one group for both
        child = subprocess.Popen([command, "--serve-web", *bound, rrd], stdout=subprocess.DEVNULL,
                                 stderr=subprocess.DEVNULL, start_new_session=True)  # fmt: skip
        started.append(child)
        end = time.monotonic() + WAIT_S
        while not (answers(page, "127.0.0.1") and answers(data, "127.0.0.1")):
            assert child.poll() is None
            assert time.monotonic() < end, "the server does not answer"
            time.sleep(0.1)
        return data, page

    yield serve
    for child in started:
        os.killpg(child.pid, signal.SIGTERM)
        child.wait(timeout=WAIT_S)


def share(picture: np.ndarray, colour: tuple[int, int, int]) -> float:
    """The share of a picture (h, w, 3) that has a colour."""
    return float((np.abs(picture.astype(int) - colour).max(axis=2) < 12).mean())


@pytest.mark.slow
def test_a_browser_on_this_machine_draws_both_sides(served, require, tmp_path):
    require("chromium")
    sides = {"batch 07 é": recording(tmp_path / "a.rrd", LEFT), "batch-08": recording(tmp_path / "b.rrd", RIGHT)}
    write_merged(tmp_path / "both.rrd", recordings=sides)
    data, page = served(tmp_path / "both.rrd")
    if (other := own_address()) not in (None, "127.0.0.1"):
        assert not answers(page, other)
        assert not answers(data, other)
    url = f"http://127.0.0.1:{page}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{data}%2Fproxy&renderer=webgl"
    with Browser(tmp_path / "profile", webgl=True) as browser:
        browser.open(url)
        end = time.monotonic() + DRAWN_S
        while not beside(drawn := browser.photograph()) and time.monotonic() < end:
            time.sleep(1.0)
    assert beside(drawn)


@pytest.mark.slow
def test_the_viewer_of_this_machine_draws_both_sides(require, tmp_path, monkeypatch):
    require("egl")  # of the same packages as the driver that the viewer draws with
    from rerun.experimental import ViewerClient

    monkeypatch.setenv("PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    sides = {"batch 07 é": recording(tmp_path / "a.rrd", LEFT), "batch-08": recording(tmp_path / "b.rrd", RIGHT)}
    write_merged(tmp_path / "both.rrd", recordings=sides)
    with ViewerClient.spawn(headless=True, port=two_ports()[0], hide_welcome_screen=True) as viewer:
        viewer.open(str(tmp_path / "both.rrd"))
        end = time.monotonic() + WAIT_S
        while viewer.get_state().loading:
            assert time.monotonic() < end, "the viewer does not end loading"
            time.sleep(0.05)
        time.sleep(2.0)
        shot = np.frombuffer(viewer.take_screenshot(max_size=1000), np.uint8)
    assert beside(cv2.imdecode(shot, cv2.IMREAD_COLOR)[..., ::-1])


def beside(drawn: np.ndarray) -> bool:
    """Whether both pictures are drawn, each in its half, which it fills across: a third of it or more."""
    left, right = np.split(drawn[:, : drawn.shape[1] // 2 * 2], 2, axis=1)
    each = min(share(left, LEFT), share(right, RIGHT)) > 0.2
    return each and share(left, RIGHT) == share(right, LEFT) == 0.0
