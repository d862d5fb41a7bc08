"""Serving: over standard input and output, or over HTTP on this machine behind a token."""

import os
import secrets
import sys
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Final

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.security import is_one_of
from vastflow.deployments.explorer.serving import LOOPBACK, listen
from vastflow.oracles.results.unfinished import final_of
from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.process import SAFE_PATH

TOKEN: Final = "VASTFLOW_MCP_TOKEN"
"""Variable with the token of a server over HTTP."""
PATH: Final = "/mcp"
MOST_BODY_BYTES: Final = 1 << 20
_REFUSED: Final = "Send the header Authorization: Bearer TOKEN, with the token that the server printed when it started."
_TOKEN_BYTES: Final = 24
_LEAST_TOKEN: Final = 16


class Bearer:
    """An application that answers requests with a token in their header."""

    def __init__(self, app: ASGIApp, token: str) -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or hand it on."""
        app = self._app
        if scope["type"] != "lifespan":
            scheme, _, given = Headers(scope=scope).get("authorization", "").partition(" ")
            if scheme.lower() != "bearer" or not is_one_of(given.strip(), (self._token,)):
                app = JSONResponse({"error": _REFUSED}, 401, {"WWW-Authenticate": "Bearer"})
        await app(scope, receive, send)


def serve(roots: Sequence[Path], port: int | None, *, allow_run: bool, workspace: Path | None) -> None:
    """Serve campaign directories until the client or Ctrl-C ends it.

    Args:
        port: On this machine's loopback, 0 for a free one; None for standard input and output.

    Raises:
        UserError: a folder does not exist, the port is taken, or the extra is missing.
    """
    for option, folder in (*(("", root) for root in roots), *([("--workspace ", workspace)] if workspace else [])):
        if not folder.is_dir():
            raise UserError(f"{option}{folder}: expected a folder, got nothing there")
    try:
        import duckdb  # noqa: F401 - child processes need it
        import mcp  # noqa: F401
    except ImportError as error:
        raise UserError(f"mcp: a library is missing ({error}). Call pip install 'vastflow[mcp]'.") from None
    from vastflow.deployments.assistant.answers import Answers
    from vastflow.deployments.assistant.drafts import Drafts
    from vastflow.deployments.assistant.server import server_of

    given, home = os.environ.pop(TOKEN, ""), workspace.resolve() if workspace else None
    directories = Directories(roots)
    results = _results(directories.roots) if allow_run else None
    with ExitStack() as stack:
        answers = Answers(directories)
        drafts = stack.enter_context(closing(Drafts(answers.directory, home, results)))
        server = server_of(answers, drafts, allow_run=allow_run)
        os.chdir(os.sep)  # the server and its children read nothing of the folder that it was started in
        os.environ[SAFE_PATH] = "1"
        if port is None:
            server.run("stdio")
            return
        import uvicorn

        if given and len(given) < _LEAST_TOKEN:
            raise UserError(f"{TOKEN}: expected at least {_LEAST_TOKEN} characters, got {len(given)}")
        token, listening = given or secrets.token_urlsafe(_TOKEN_BYTES), stack.enter_context(listen(port))
        print(f"http://{LOOPBACK}:{listening.getsockname()[1]}{PATH}", file=sys.stderr)
        print(f"token: that of {TOKEN}" if given else f"token: {token}", file=sys.stderr, flush=True)
        # It answers at this machine's own names alone, and to pages of none but this machine.
        app = server.streamable_http_app(
            host=LOOPBACK, streamable_http_path=PATH, max_request_body_size=MOST_BODY_BYTES
        )
        config = uvicorn.Config(Bearer(app, token), log_level="warning", access_log=False, server_header=False)
        uvicorn.Server(config).run([listening])


def _results(roots: Sequence[Path]) -> Path:
    """Return the folder for results of campaigns that an assistant runs."""
    for root in roots:
        if final_of(root) == root and not (root / "metadata.json").exists():
            return root
    raise UserError("--allow-run: expected a folder of campaign directories, got campaign directories alone")
