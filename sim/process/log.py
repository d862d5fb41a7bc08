"""The log of a process: what it printed, up to a limit, while it is still printing."""

import os
import select
import threading
from pathlib import Path
from typing import Final

MAX_LOG_BYTES: Final = 16 * 2**20
_CHUNK_BYTES: Final = 1 << 16


class ProcessLog:
    """Drains a pipe into a file, so that a program never waits for its reader; what is too much is read and dropped.

    Attributes:
        path: The file.
        cut: Whether something was dropped.
        complete: Set once the pipe has been read to its end and the file is whole.
    """

    def __init__(self, path: Path, max_bytes: int = MAX_LOG_BYTES) -> None:
        self.path = path
        self.cut = False
        self.complete = threading.Event()
        self._max_bytes = max_bytes
        self._given_up = threading.Event()
        self._read_end, self.write_end = os.pipe()
        path.touch()

    def begin(self) -> None:
        """Give up this process' copy of `write_end`, which the program has, and begin to read."""
        os.close(self.write_end)
        threading.Thread(target=self._drain, name=f"log {self.path.name}", daemon=True).start()

    def abandon(self) -> None:
        """Close a log whose program could not be started."""
        os.close(self.write_end)
        os.close(self._read_end)
        self.complete.set()

    def close(self, timeout_s: float) -> None:
        """Wait for the end of the pipe; if some process still holds it after `timeout_s`, read no more of it."""
        if not self.complete.wait(timeout_s):
            self._given_up.set()
            self.complete.wait()

    def read(self, offset: int = 0) -> bytes:
        """What is in the file from `offset` on, at this moment."""
        with self.path.open("rb") as file:
            file.seek(offset)
            return file.read()

    def last_line(self) -> str:
        """The last line that is not blank, cut to 200 characters; empty without one."""
        with self.path.open("rb") as file:
            file.seek(max(0, self.path.stat().st_size - 4096))
            lines = file.read().decode(errors="replace").split("\n")
        return next((line.strip()[:200] for line in reversed(lines) if line.strip()), "")

    def _drain(self) -> None:
        written = 0
        readable = select.poll()
        readable.register(self._read_end, select.POLLIN)
        try:
            with self.path.open("wb", buffering=0) as file:
                while not self._given_up.is_set():
                    if not readable.poll(100):
                        continue
                    chunk = os.read(self._read_end, _CHUNK_BYTES)
                    if not chunk:
                        break
                    if kept := chunk[: self._max_bytes - written]:
                        file.write(kept)
                        written += len(kept)
                    if len(kept) < len(chunk) and not self.cut:
                        self.cut = True
                        file.write(f"\n[the log was cut here: more than {self._max_bytes} bytes]\n".encode())
        finally:
            os.close(self._read_end)
            self.complete.set()
