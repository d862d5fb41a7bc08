"""A Dask scheduler of this machine's own, with its workers."""

import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

from distributed.security import Security

from vastflow.tasks.engine import dask_worker
from vastflow.tasks.engine.executor import ClusterError

LOCAL: Final = "local:"
"""Begins the address of a cluster of this machine's own, with the number of its workers."""


class OwnScheduler:
    """A process with a scheduler and `workers` workers, started when its address is first asked for.

    Args:
        log: File that takes what they print.

    Attributes:
        security: Security settings that a client needs; None before the first start.
    """

    def __init__(self, workers: int, log: Path | None) -> None:
        self.security: Any = None
        self._workers, self._log = workers, log
        self._process: subprocess.Popen[bytes] | None = None
        self._address = ""

    def address(self) -> str:
        """Return the scheduler's address; start it again if it died.

        Raises:
            ClusterError: it did not start.
        """
        if self._process is None or self._process.poll() is not None:
            script = f"from {dask_worker.__name__} import serve; serve({self._workers})"
            with open(self._log or os.devnull, "ab") as log:
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log
                )
            self.security = Security.temporary()  # else every user of this machine may run code as this one
            assert self._process.stdin is not None and self._process.stdout is not None
            self._process.stdin.write(pickle.dumps(self.security))
            self._process.stdin.flush()
            self._address = self._process.stdout.readline().decode().strip()
        if not self._address:
            raise ClusterError(f"--cluster: {LOCAL}{self._workers} did not start, see {self._log}")
        return self._address

    def end(self) -> None:
        """Kill it."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
