"""A recording in a browser: served to this machine alone, opened in headless Chromium, and drawn."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun as rr

from twin.review.merging import write_merged

WAIT_S = 60.0
FLAGS = ("--headless", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
         "--enable-unsafe-swiftshader", "--hide-scrollbars", "--window-size=1000,700")
PATIENCE_MS = (40_000, 160_000, 640_000)  # of the page's own clock, which a busy machine outruns
LEFT, RIGHT = (230, 30, 200), (30, 200, 60)  # colours that the viewer itself does not have


def recording(path: Path, colour: tuple[int, int, int]) -> Path:
    """A file with a picture of one colour where the review has its film."""
    stream = rr.RecordingStream("softtwin")
    stream.save(path)
    stream.set_time("film_time", duration=0.0)
    stream.log("film/frame", rr.Image(np.full((40, 60, 3), colour, np.uint8)))
    stream.disconnect()
    return path


def two_ports() -> list[int]:
    with socket.socket() as a, socket.socket() as b:
        for probe in (a, b):
            probe.bind(("127.0.0.1", 0))
        return [probe.getsockname()[1] for probe in (a, b)]


def answers(port: int, host: str) -> bool:
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((host, port)) == 0


def own_address() -> str | None:
    """An address of this machine that others see, None without a network; nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
        except OSError:
            return None
        return str(probe.getsockname()[0])


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
    for budget in PATIENCE_MS:
        drawn = photographed(url, tmp_path, budget)
        if share(drawn, LEFT) and share(drawn, RIGHT):
            break
    check(drawn)


def photographed(url: str, folder: Path, budget: int) -> np.ndarray:
    """What headless Chromium draws of a page (h, w, 3)."""
    shot = folder / "shot.png"
    own = (f"--user-data-dir={folder / 'profile'}", f"--virtual-time-budget={budget}", f"--screenshot={shot}")
    command = [str(shutil.which("chromium")), *FLAGS, *own, url]
    subprocess.run(command, check=True, capture_output=True, timeout=3 * WAIT_S)
    return cv2.imread(str(shot))[..., ::-1]


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
    check(cv2.imdecode(shot, cv2.IMREAD_COLOR)[..., ::-1])


def check(drawn: np.ndarray) -> None:
    """Both pictures are drawn, each in its half."""
    half = drawn.shape[1] // 2
    # each picture fills its half across: a third of it or more
    assert share(drawn[:, :half], LEFT) > 0.2
    assert share(drawn[:, half:], RIGHT) > 0.2
    assert share(drawn[:, :half], RIGHT) == share(drawn[:, half:], LEFT) == 0.0
