"""A recording in a browser: served to this machine alone, opened in headless Chromium, and drawn."""

import base64
import json
import os
import select
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

from twin.batches.side import write_merged

WAIT_S = 60.0
FLAGS = ("--headless", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
         "--enable-unsafe-swiftshader", "--hide-scrollbars", "--window-size=1000,700", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync",
         "--remote-debugging-pipe")  # fmt: skip
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


class Browser:
    """Headless Chromium, told what to do through its debugging pipe: JSON messages that end with a zero."""

    def __init__(self, profile: Path) -> None:
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        command = [str(shutil.which("chromium")), *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        # the browser reads its file 3 and writes its file 4
        wired = ["bash", "-c", f'exec 3<&{to_browser} 4>&{from_browser}; exec "$@"', "bash", *command]
        self._child = subprocess.Popen(wired, pass_fds=(to_browser, from_browser), start_new_session=True,
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
        os.close(to_browser)
        os.close(from_browser)
        self._asked = 0
        self._read = b""
        self._session: dict[str, str] = {}

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        os.killpg(self._child.pid, signal.SIGKILL)
        self._child.wait(timeout=WAIT_S)
        os.close(self._out)
        os.close(self._in)

    def ask(self, method: str, **params: object) -> dict[str, object]:
        """The result of one method of the Chrome DevTools Protocol; events on the way are passed over."""
        self._asked += 1
        message = {"id": self._asked, "method": method, "params": params, **self._session}
        os.write(self._out, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + WAIT_S
        while True:
            while b"\0" not in self._read:
                assert select.select([self._in], [], [], max(0.0, end - time.monotonic()))[0], f"no answer to {method}"
                read = os.read(self._in, 1 << 20)
                assert read, f"the browser ended before it answered {method}"
                self._read += read
            answer, self._read = self._read.split(b"\0", 1)
            told = json.loads(answer)
            if told.get("id") == self._asked:
                return dict(told.get("result", {}))  # none: refused, as a picture of a page that is being opened

    def open(self, url: str) -> None:
        target = self.ask("Target.createTarget", url=url)["targetId"]
        self._session = {"sessionId": str(self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"])}

    def photograph(self) -> np.ndarray:
        """What the page shows now (h, w, 3), RGB; one black pixel while it shows nothing yet."""
        png = self.ask("Page.captureScreenshot", format="png").get("data")
        if png is None:
            return np.zeros((1, 1, 3), np.uint8)
        return cv2.imdecode(np.frombuffer(base64.b64decode(str(png)), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


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
    with Browser(tmp_path / "profile") as browser:
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
