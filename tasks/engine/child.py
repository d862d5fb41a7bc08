"""Child processes with limits: requests and answers as lines of JSON, and an end with the process that started them."""

import importlib
import json
import os
import resource
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Final, Self

from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.process import own_environment, python_command

_MOST_LINE_BYTES: Final = 16 << 20
"""Size of an answer as JSON."""
_MOST_BYTES: Final = 4 << 30
"""Size of an answer as bytes."""
_SAID: Final = 2000
"""Bytes of what a process writes that are kept, the last ones."""
_END_S: Final = 2.0
"""Time in which a process that closed its answers tells how it ended."""
_LOOK_MS: Final = 1000


class NoAnswer(UserError):
    """A child process that ended, or had to be ended, before it answered."""


class Child:
    """A function in a process of its own session, which imports nothing from its working directory.

    The end of the `with` kills it with its group. However this process ends, the kernel closes the pipe of requests; a process beside
    the child waits for that, and kills the group. A process of another session is not found.

    Args:
        function: `module:name` of what answers a request: a value of JSON, or bytes.
        folder: Working directory.
        memory_bytes: Address space of the process; `MemoryError` is a problem in words.
        file_bytes: Size of each file that it writes.
    """

    def __init__(
        self,
        function: str,
        *,
        folder: Path | str = os.sep,
        memory_bytes: int | None = None,
        file_bytes: int | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        if environment is None:
            environment = {**own_environment(), "PYTHONUNBUFFERED": "1", "PYTHONDONTWRITEBYTECODE": "1"}
        command = python_command("vastflow.tasks.engine.child", function, json.dumps([memory_bytes, file_bytes]))
        pipe = subprocess.PIPE
        self._log = TemporaryFile()  # noqa: SIM115 - closed with the process
        self._process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=self._log, cwd=folder, env=environment, start_new_session=True
        )

    def ask(self, request: Any, wall_s: float = threading.TIMEOUT_MAX) -> Any:
        """Return the answer to a request; the process is killed after `wall_s`, for the first request its start included.

        Raises:
            NoAnswer: it ended, or was killed at a limit; so does each later request.
            UserError: the function raised; its words, which the type precedes unless it is a `UserError` too.
        """
        requests, answers = self._process.stdin, self._process.stdout
        assert requests is not None and answers is not None
        limit = threading.Timer(wall_s, self._kill)
        limit.daemon = True
        began_s = time.monotonic()
        limit.start()
        try:
            requests.write(json.dumps(request).encode() + b"\n")
            requests.flush()
            kind, answer = json.loads(answers.readline(_MOST_LINE_BYTES))
            if kind == "bytes":
                size, answer = answer, answers.read(min(answer, _MOST_BYTES))
                if len(answer) < size:
                    raise ValueError("the process ended within its answer")
        except (OSError, ValueError):
            is_late = time.monotonic() - began_s >= wall_s
            how = f"took more than {wall_s:g} s" if is_late else self._end()
            raise NoAnswer(f"its process {how}") from None
        finally:
            limit.cancel()
        if kind == "problem":
            raise UserError(answer)
        return answer

    @property
    def said(self) -> str:
        """The end of what the process and those below it have printed."""
        log = self._log.fileno()
        return os.pread(log, _SAID, max(0, os.fstat(log).st_size - _SAID)).decode(errors="replace").strip()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.returncode is None:
            self._kill()
        with self._log, suppress(BrokenPipeError), self._process:  # closes its pipes and waits
            pass

    def _kill(self) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def _end(self) -> str:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)
        self._kill()
        return end_text(self._process.wait(), " without an answer", self.said)


def end_text(code: int, how: str, said: str) -> str:
    """Return how a process ended, with its last line."""
    ended = f"was ended by signal {-code}" if code < 0 else f"ended with code {code}"
    last = said.rpartition("\n")[2].strip()
    return f"{ended}{how}{': ' if last else ''}{last}"


def _main(function: str, limits: str) -> None:
    """Answer each line of the standard input. The code itself prints on the standard error, and reads nothing."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    child = os.getpid()
    if os.fork() == 0:
        answers.close()
        _end_with(child, requests.fileno())
    memory_bytes, file_bytes = json.loads(limits)
    most = {resource.RLIMIT_AS: memory_bytes, resource.RLIMIT_FSIZE: file_bytes, resource.RLIMIT_CORE: 0}
    for kind, value in most.items():
        if value is not None:
            resource.setrlimit(kind, (value, value))
    module, _, name = function.partition(":")
    answer = getattr(importlib.import_module(module), name)
    for line in requests:
        for part in _answered(answer, line, memory_bytes):
            answers.write(part)
        answers.flush()


def _answered(answer: Callable[[Any], Any], line: bytes, memory_bytes: int | None) -> Sequence[bytes]:
    content = b""
    try:
        said = ["value", answer(json.loads(line))]
        if isinstance(said[1], bytes):
            content, said = said[1], ["bytes", len(said[1])]
        return json.dumps(said, allow_nan=False).encode(), b"\n", content
    except UserError as error:
        problem = " ".join(str(error).split())
    except MemoryError:
        problem = f"expected to take at most {(memory_bytes or 0) / 2**30:.1f} GiB of memory, got more"
    except Exception as error:  # noqa: BLE001 - code and files of others may raise anything
        problem = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
    return json.dumps(["problem", problem]).encode(), b"\n"


def _end_with(child: int, requests: int) -> None:
    """Kill this process's group once nobody can write requests, or the child has ended.

    No thread could do it: some code never lets another one run.
    """
    closed = select.poll()
    closed.register(requests, 0)
    while not closed.poll(_LOOK_MS) and os.getppid() == child:
        pass
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    _main(*sys.argv[1:])
