"""A step in a process of its own, in a session that ends with it."""

import os
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from vastflow.tasks.engine.process import own_environment

_SAID: Final = 2000
"""Characters of what a step's process writes that are kept, the last ones."""


def run_process(command: Sequence[str], folder: Path, request: str, limit_s: float | None = None) -> tuple[int, str]:
    """Run a command with `request` on standard input; return its exit code and the end of what it wrote.

    Args:
        limit_s: Time after which it is killed.
    """
    environment = {**own_environment(), "PYTHONUNBUFFERED": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    with TemporaryDirectory(prefix="vastflow-") as aside, (Path(aside) / "log").open("wb+") as log:
        try:
            process = subprocess.Popen(
                command,
                cwd=folder,
                env=environment,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        except OSError as error:
            return 126, f"{Path(command[0]).name} can't be started: {error.strerror or error}"
        try:
            with suppress(subprocess.TimeoutExpired):
                process.communicate(request.encode(), limit_s)
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        log.seek(max(0, log.seek(0, os.SEEK_END) - _SAID))
        return process.returncode, log.read().decode("utf-8", "replace").strip()


def end_text(code: int, how: str, said: str) -> str:
    """Return how a process ended, with its last line."""
    ended = f"was ended by signal {-code}" if code < 0 else f"ended with code {code}"
    last = said.rpartition("\n")[2].strip()
    return f"{ended}{how}{': ' if said else ''}{last}"
