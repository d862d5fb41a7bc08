"""Folders of a run under paths of its own: its commands are started in a mount namespace, where they are mounted."""

import functools
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

_SCRIPT: Final = Path(__file__).with_name("mounting.py")


def popen_mounted(
    command: Sequence[str], mounts: Mapping[str, Path], root: Path, env: Mapping[str, str], **options: Any
) -> "subprocess.Popen[bytes]":
    """As `subprocess.Popen`, where the command sees each folder of `mounts` at its path, a name below `/`.

    Args:
        root: An empty folder in which its root folder is made.

    Raises:
        OSError: there is no such program, or it can't be executed; or the folders can't be mounted.
    """
    given = [f"{path}={folder}" for path, folder in mounts.items()]
    read_end, write_end = os.pipe()
    with open(read_end, "rb") as said:
        try:
            popen = subprocess.Popen(
                [
                    sys.executable,
                    "-I",
                    "-S",
                    _SCRIPT,
                    str(write_end),
                    env.get("LC_CTYPE", ""),
                    root,
                    *given,
                    "--",
                    *command,
                ],
                env=env,
                pass_fds=[write_end],
                **options,
            )
        finally:
            os.close(write_end)
        failure = said.read()
    if failure:
        popen.wait()
        raise OSError(int(failure), os.strerror(int(failure)))
    return popen


@functools.lru_cache(maxsize=1)
def can_mount() -> bool:
    """Whether commands can have mounts of their own: on Linux, unless the machine forbids it to this user."""
    if sys.platform != "linux":
        return False
    with tempfile.TemporaryDirectory(prefix="vastflow-mounts-") as folder:
        root, shown = Path(folder, "root"), Path(folder, "shown")
        root.mkdir()
        shown.mkdir()
        (shown / "there").touch()
        quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        command = ["/bin/sh", "-c", "test -e /out/there"]
        try:
            return popen_mounted(command, {"/out": shown}, root, os.environ, cwd=folder, **quiet).wait() == 0
        except OSError:
            return False
