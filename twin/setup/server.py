"""The page of `twin setup`, served to this machine alone until ctrl-C."""

import os
import socket
import sys
import webbrowser

import uvicorn
from fastapi import FastAPI
from nicegui import ui
from starlette.middleware.trustedhost import TrustedHostMiddleware

from twin.messages import Say
from twin.setup.desk import Check
from twin.setup.draft import SetupDraft
from twin.setup.page import Page

HOST = "127.0.0.1"
PATIENT_S = 60.0  # that the browser waits for an answer: beside a check a slow computer may take seconds


def serve(draft: SetupDraft, say: Say, *, check: Check, port: int) -> bool:
    """Whether twin.toml has all that was on the page when ctrl-C ended it. ValueError where the port is
    taken.

    check: says what is known of a project.   port: 0 for any free one.
    """
    listening = _bound(port)
    page = Page(draft, say, check)
    url = f"http://{HOST}:{listening.getsockname()[1]}"
    server = FastAPI()
    # a page of another site, whose name leads to this machine, is refused
    server.add_middleware(TrustedHostMiddleware, allowed_hosts=[HOST, "localhost"])
    ui.page("/", title=f"twin setup: {draft.root.name}")(page.build)
    ui.run_with(server, show_welcome_message=False, reconnect_timeout=PATIENT_S)
    settings = uvicorn.Config(server, log_level="error", timeout_graceful_shutdown=1)
    try:
        say(f"Open {url} in a browser on this computer. Ctrl-C ends it.")
        if _has_screen():
            webbrowser.open(url)
        uvicorn.Server(settings).run(sockets=[listening])
    except KeyboardInterrupt:
        pass  # this is how it ends
    finally:
        listening.close()
    done = page.desk.proposal.is_written
    say("twin.toml has all that the page showed." if done else "What the page showed last is not written.")
    return done


def _has_screen() -> bool:
    """Whether a browser can be opened here: without a screen, one of letters would take the terminal."""
    screens = ("DISPLAY", "WAYLAND_DISPLAY")
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in screens)


def _bound(port: int) -> socket.socket:
    """A socket at a port of this machine alone; ValueError where it cannot be had."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((HOST, port))
        bound.listen()
    except OSError as error:
        bound.close()
        raise ValueError(
            f"--port {port}: {error.strerror}; wanted a free port above 1023; leave --port out, and any free "
            "one is taken"
        ) from None
    return bound
