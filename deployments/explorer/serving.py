"""Serving: a socket, a token, and the browser that is sent there."""

import os
import secrets
import socket
import sys
import threading
import webbrowser
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import uvicorn

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.server import application
from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.process import SAFE_PATH

LOOPBACK: Final = "127.0.0.1"
_TOKEN_BYTES: Final = 24
_WARM_AFTER_S: Final = 3.0
_WARM: Final = (
    "vastflow.oracles.query.frames",
    "vastflow.flows.results.provenance",
    "vastflow.flows.analysis.comparison",
    "pandas",
    "scipy.stats",
)
"""Modules that some pages need, imported when the first page is there."""
_LAST_REPLIES_S: Final = 1
"""Time that replies may take after Ctrl-C; streams of events would never end."""


def serve(roots: Sequence[Path], port: int, *, browser: bool) -> None:
    """Serve the explorer until Ctrl-C, and print its address.

    Raises:
        UserError: a folder does not exist, or the port is taken.
    """
    for root in roots:
        if not root.is_dir():
            raise UserError(f"{root}: expected a folder with campaign directories, got nothing there")
    token, once = (secrets.token_urlsafe(_TOKEN_BYTES) for _ in range(2))
    listening = listen(port)
    shown, opened = (f"http://{LOOPBACK}:{listening.getsockname()[1]}/?token={each}" for each in (token, once))
    config = uvicorn.Config(
        application(Directories(roots), token, (once,)),
        log_level="warning",
        access_log=False,
        server_header=False,
        lifespan="off",
        timeout_graceful_shutdown=_LAST_REPLIES_S,
    )
    print(shown, flush=True)
    print("Ctrl-C ends it", file=sys.stderr)
    os.chdir(os.sep)  # the server and its children read nothing of the folder that it was started in
    os.environ[SAFE_PATH] = "1"
    warming = threading.Timer(_WARM_AFTER_S, lambda: [*map(import_module, _WARM)])
    warming.daemon = True
    warming.start()
    with (
        listening,
        TemporaryDirectory(prefix="vastflow-") as folder,
        suppress(KeyboardInterrupt),
    ):  # which is how it ends
        if browser:
            page = redirect_page(Path(folder), opened)
            # A browser may take seconds to start; connections wait in the socket meanwhile.
            threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()
        uvicorn.Server(config).run([listening])


def redirect_page(folder: Path, address: str) -> Path:
    """Write a page that leads to an address with a token, readable by this user alone.

    A browser's command line is there for all users to see.
    """
    page = folder / "open.html"
    with os.fdopen(os.open(page, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
        file.write(f'<!DOCTYPE html><meta http-equiv="refresh" content="0; url={address}">')
    return page


def listen(port: int) -> socket.socket:
    """Return a listening socket on this machine only; raises `UserError` if the port is taken."""
    try:
        return socket.create_server((LOOPBACK, port))
    except OSError as error:
        raise UserError(f"--port: {port} can't be used ({error.strerror}). Choose a free port, or 0") from None
