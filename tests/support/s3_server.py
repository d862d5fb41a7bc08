"""A real S3 server: `rclone serve s3`."""

import contextlib
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

BUCKET = "bucket"
KEY_ID, SECRET = "TESTKEYID", "TESTSECRET"


def rclone() -> str | None:
    """Return rclone, beside Python or on the path."""
    return shutil.which("rclone", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))


class S3Server:
    """A server over a folder, or another remote of rclone's; it keeps its port when it is started again."""

    def __init__(self, binary: str, folder: Path, remote: str | None = None) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}"
        self._binary, self._folder, self._remote = binary, folder, remote or str(folder / "data")
        if remote is None:
            (folder / "data" / BUCKET).mkdir(parents=True)
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        options = ["--config", os.devnull, "--addr", f"127.0.0.1:{self.port}", "--auth-key", f"{KEY_ID},{SECRET}"]
        with open(self._folder / "log", "ab") as log:
            self._process = subprocess.Popen(
                [self._binary, "serve", "s3", *options, self._remote], stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline and self._process.poll() is None:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1):
                return
            time.sleep(0.05)
        raise RuntimeError(f"rclone did not start: {(self._folder / 'log').read_text()}")

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait(10)

    @property
    def lost(self) -> set[str]:
        """Addresses of artifacts of which it lost a file: rclone renames neither of two concurrent writes."""
        log = (self._folder / "log").read_text()
        return {f"s3://{path}" for path in re.findall(r"ERROR : (\S+)/\.rclone_temp_put_\S+: Dir\.Rename error", log)}
