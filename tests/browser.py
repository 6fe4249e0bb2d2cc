"""Headless Chromium, told what to do through its debugging pipe."""

import base64
import json
import os
import select
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

WAIT_S = 60.0
ANSWER_S = 180.0  # for one answer
FLAGS = ("--headless", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync",
         # a page that nobody sees is not put behind other programs
         "--disable-renderer-backgrounding", "--disable-background-timer-throttling",
         "--disable-backgrounding-occluded-windows", "--remote-debugging-pipe")  # fmt: skip
WEBGL = "--use-angle=swiftshader", "--enable-unsafe-swiftshader"
EVENTS = "Inspector", "Log", "Page", "Runtime"  # domains of the protocol whose events are asked for
# NiceGUI takes no event before; a page whose server was too slow for it loads itself anew
READY = "document.readyState === 'complete' && window.did_handshake !== false"


def two_ports() -> list[int]:
    """Two ports of this machine that are free."""
    with socket.socket() as a, socket.socket() as b:
        for probe in (a, b):
            probe.bind(("127.0.0.1", 0))
        return [probe.getsockname()[1] for probe in (a, b)]


def answers(port: int, host: str) -> bool:
    """Whether something listens there."""
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
    """Headless Chromium, told what to do through its debugging pipe: JSON messages that end with a zero.

    webgl: for pages that draw with it; without it no process of graphics is started.
    """

    def __init__(self, profile: Path, *, width: int = 1000, height: int = 700, webgl: bool = False) -> None:
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        command = [str(shutil.which("chromium")), *FLAGS, *(WEBGL if webgl else ("--disable-gpu",)),
                   f"--window-size={width},{height}", f"--user-data-dir={profile}", "about:blank"]  # fmt: skip
        # the browser reads its file 3 and writes its file 4
        wired = ["bash", "-c", f'exec 3<&{to_browser} 4>&{from_browser}; exec "$@"', "bash", *command]
        self._child = subprocess.Popen(wired, pass_fds=(to_browser, from_browser), start_new_session=True,
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
        os.close(to_browser)
        os.close(from_browser)
        self._asked = 0
        self._read = b""
        self.told: list[str] = []  # what the page has told unasked: dialogs, errors, lines of its console
        self.loads = 0  # how often a page was loaded
        self._session: dict[str, str] = {}

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        os.killpg(self._child.pid, signal.SIGKILL)
        self._child.wait(timeout=WAIT_S)
        os.close(self._out)
        os.close(self._in)

    def ask(self, method: str, **params: object) -> dict[str, object]:
        """The result of one method of the Chrome DevTools Protocol."""
        number = self._send(method, **params)
        end = time.monotonic() + ANSWER_S
        while (told := self._next(method, end)).get("id") != number:
            self._notice(told)
        return dict(told.get("result", {}))  # none: refused, as a picture of a page that is being opened

    def _send(self, method: str, **params: object) -> int:
        self._asked += 1
        message = {"id": self._asked, "method": method, "params": params, **self._session}
        os.write(self._out, json.dumps(message).encode() + b"\0")
        return self._asked

    def _next(self, method: str, end: float) -> dict[str, Any]:
        """The next message: an answer or an event."""
        while b"\0" not in self._read:
            left = max(0.0, end - time.monotonic())
            assert select.select([self._in], [], [], left)[0], f"no answer to {method}; the page told {self.told}"
            read = os.read(self._in, 1 << 20)
            assert read, f"the browser ended before it answered {method}; the page told {self.told}"
            self._read += read
        told, self._read = self._read.split(b"\0", 1)
        return dict(json.loads(told))

    def _notice(self, event: dict[str, Any]) -> None:
        """Keep what an event tells. A dialog is agreed to: until then the page answers nothing."""
        kind, params = event.get("method", ""), event.get("params", {})
        assert kind != "Inspector.targetCrashed", f"the page crashed; it had told {self.told}"
        if kind == "Page.javascriptDialogOpening":
            self.told.append(f"dialog {params['type']} {params['message']!r}")
            self._send("Page.handleJavaScriptDialog", accept=True)
        elif kind == "Page.loadEventFired":
            self.loads += 1
        elif kind == "Runtime.consoleAPICalled":
            self.told.append(" ".join(str(a.get("value", a.get("description"))) for a in params["args"]))
        elif kind == "Runtime.exceptionThrown":
            self.told.append(str(params["exceptionDetails"].get("exception", {}).get("description")))
        elif kind == "Log.entryAdded":
            self.told.append(params["entry"]["text"])

    def open(self, url: str) -> None:
        """Open a page."""
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = {"sessionId": str(self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"])}
        for domain in EVENTS:
            self.ask(f"{domain}.enable")
        self.ask("Page.navigate", url=url)

    def value(self, script: str) -> object:
        """What an expression of JavaScript gives on the page."""
        result = self.ask("Runtime.evaluate", expression=script, returnByValue=True).get("result", {})
        return result.get("value") if isinstance(result, dict) else None

    def text(self) -> str:
        """The words that the page shows."""
        return str(self.value("document.body.innerText"))

    def until(self, *words: str, wait_s: float = WAIT_S, after: Callable[[], object] | None = None) -> str:
        """The page's words once all of these are among them.

        after: done before, and again where the page was loaded anew since: what was on its way is lost then.
        """
        end, loads = time.monotonic() + wait_s, -1
        while True:
            if after is not None and loads != self.loads:
                self.ready()
                loads = self.loads
                after()
            if all(word in (shown := self.text()) for word in words):
                return shown
            assert time.monotonic() < end, f"the page does not show {words}, but {shown!r}; it told {self.told}"
            time.sleep(0.1)

    def ready(self) -> None:
        """Wait until the page takes events."""
        self._found(READY, "the page takes no events")

    def reload(self) -> None:
        """Load the page anew, by a script of its own: where it asks before it is left, that is agreed to."""
        loads, end = self.loads, time.monotonic() + WAIT_S
        self.value("setTimeout(() => location.reload(), 0)")
        while loads == self.loads:
            assert time.monotonic() < end, f"the page is not loaded anew; it told {self.told}"
            self.text()
            time.sleep(0.1)

    def _found(self, script: str, otherwise: str) -> None:
        """Wait until an expression is true on the page."""
        end = time.monotonic() + WAIT_S
        while not self.value(script):
            assert time.monotonic() < end, f"{otherwise}; it told {self.told}"
            time.sleep(0.1)

    def mouse(self, kind: str, x: float, y: float) -> None:
        """One event of the left button: mousePressed, mouseMoved, mouseReleased."""
        held = 0 if kind == "mouseReleased" else 1
        self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=held, clickCount=1)

    def drag(self, start: tuple[float, float], end: tuple[float, float], *, steps: int = 5) -> None:
        """Press, move, let go: at one place, a click."""
        self.mouse("mousePressed", *start)
        for share in np.linspace(0.0, 1.0, steps + 1)[1:] if start != end else ():
            self.mouse("mouseMoved", *(a + share * (b - a) for a, b in zip(start, end)))
        self.mouse("mouseReleased", *end)

    def press(self, text: str) -> None:
        """Click the button with this text."""
        script = (f"(() => {{ const b = [...document.querySelectorAll('button')].find(b => b.innerText.trim().split('\\n').pop() === {json.dumps(text)});"
                  " if (!b) return false; b.click(); return true; })()")  # fmt: skip
        self._found(f"{READY} && {script}", f"no button {text!r}")

    def fill(self, words: str, text: str) -> None:
        """Type into the field whose label, or the words beside it, end with these."""
        script = (f"(() => {{ const f = [...document.querySelectorAll('.q-field, .nicegui-row')].filter(f => f.querySelectorAll('input').length === 1"
                  f" && f.innerText.trim().endsWith({json.dumps(words)})).pop(); if (!f) return false; const i = f.querySelector('input');"
                  " i.focus(); i.select(); return true; })()")  # fmt: skip
        self._found(f"{READY} && {script}", f"no field {words!r}")
        self.ask("Input.insertText", text=text)
        self.value("document.activeElement.blur()")

    def photograph(self) -> np.ndarray:
        """What the page shows now (h, w, 3), RGB; one black pixel while it shows nothing yet."""
        png = self.ask("Page.captureScreenshot", format="png").get("data")
        if png is None:
            return np.zeros((1, 1, 3), np.uint8)
        return cv2.imdecode(np.frombuffer(base64.b64decode(str(png)), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
