"""A process group: a command, everything it starts, and how it ended, in words."""

import errno
import functools
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import psutil

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.scenario.programs.folders import MountNamespace, RunFolders
from vastflow.sim.scenario.programs.guard import VARIABLE, kill_marked

MAX_LOG_BYTES: Final = 16 * 2**20
RSS_UNIT_BYTES: Final = 1 if sys.platform == "darwin" else 1024
_KILL_S: Final = 5.0
"""Maximum time of a process to end after SIGKILL."""


class ProcessLog:
    """Drains a program's pipe into a file, and drops the excess so that the program never blocks.

    Attributes:
        cut: Whether something was dropped.
        complete: Set once the pipe has been read to its end and the file is whole.
        problem: Why the file could not be written, such as a full disk; the pipe is closed then.
    """

    def __init__(self, path: Path, max_bytes: int = MAX_LOG_BYTES) -> None:
        self.path = path
        self.cut = False
        self.problem: OSError | None = None
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
        """Close the log of a program that could not be started."""
        os.close(self.write_end)
        os.close(self._read_end)
        self.complete.set()

    def close(self, timeout_s: float) -> None:
        """Wait for the end of the pipe, at most `timeout_s`, and stop reading."""
        if not self.complete.wait(timeout_s):
            self._given_up.set()
            self.complete.wait()

    def read(self, offset: int = 0) -> bytes:
        """Return the current content of the file from `offset` on."""
        with self.path.open("rb") as file:
            file.seek(offset)
            return file.read()

    def last_line(self) -> str:
        """Return the last line that is not blank, cut to 200 characters; empty without one."""
        self.complete.wait(0.2)  # it is the one that says why a program ended
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
                    data = os.read(self._read_end, 1 << 16)
                    if not data:
                        break
                    if kept := data[: self._max_bytes - written]:
                        file.write(kept)
                        written += len(kept)
                    if len(kept) < len(data) and not self.cut:
                        self.cut = True
                        file.write(f"\n[the log was cut here: more than {self._max_bytes} bytes]\n".encode())
        except OSError as error:
            self.problem = error
        finally:
            os.close(self._read_end)
            self.complete.set()


@dataclass(frozen=True, slots=True)
class Usage:
    """Processor time of a process and its awaited children, and the greatest resident memory of one of them."""

    cpu_s: float
    max_rss_bytes: int


class ProcessGroup:
    """A command in a session of its own, with all it starts.

    Everything it starts bears its mark, by which also those are found that began a session of their own. Not found is
    who clears its environment and leaves its family both. Outside Linux marks can't be read: descendants are found
    while their parents live, and not where this process is killed. macOS has `os.waitid` from Python 3.13 on.

    Attributes:
        command: Program and arguments; no shell reads them.
        label: Name that the scenario gives it; may be empty.
        pid: ID of the program's process, and of its session and group.
        log: Its standard output and error.
        failure: Failure of the program in words, empty for exit code 0; None while it runs.
        is_stopped: Whether `stop` ended it.
    """

    def __init__(
        self,
        command: Sequence[str],
        *,
        folders: RunFolders,
        environment: Mapping[str, str],
        log_file: Path,
        mark: str,
        namespace: MountNamespace | None = None,
        label: str = "",
        max_log_bytes: int = MAX_LOG_BYTES,
        on_end: Callable[[], None] | None = None,
    ) -> None:
        """Start `command` in `folders.out`; `on_end` is called, in another thread, when the program has ended.

        Args:
            namespace: The one in which it finds the folders by their names.
            mark: Unique to this group and no beginning of another's.

        Raises:
            ScenarioError: there is no such program, or it can't be executed.
        """
        self.command = tuple(command)
        self.label = label
        self.log = ProcessLog(log_file, max_log_bytes)
        self._mark = mark
        self._on_end = on_end
        self._overdue = ""
        self.failure: str | None = None
        self.is_stopped = False
        self._is_over = False
        self._usage: Usage | None = None
        self._end = threading.Event()
        try:
            self._popen = subprocess.Popen(
                self.command,
                cwd=folders.out,
                env={**environment, VARIABLE: mark},
                stdin=subprocess.DEVNULL,
                stdout=self.log.write_end,
                stderr=self.log.write_end,
                start_new_session=True,
                # The child has one thread and calls only the system between fork and exec.
                preexec_fn=functools.partial(namespace.join, folders.out) if namespace else None,  # noqa: PLW1509
            )
        except (OSError, ValueError, subprocess.SubprocessError) as error:
            self.log.abandon()
            raise ScenarioError(_not_started(self.command, folders, error)) from None
        self.pid = self._popen.pid
        self.log.begin()
        threading.Thread(target=self._await_end, name=f"end of {self.pid}", daemon=True).start()

    def wait(self, timeout_s: float | None = None) -> str | None:
        """Wait for the end of the program, at most `timeout_s` (s), and return `failure`."""
        self._end.wait(timeout_s)
        return self.failure

    def with_last_line(self, failure: str) -> str:
        """Return a failure of the program with the last line that it printed."""
        last = self.log.last_line()
        return f"{failure}: {last}" if last else failure

    def stop(self, with_signal: int = signal.SIGTERM, timeout_s: float = 10.0) -> None:
        """Send `with_signal` to the group, and SIGKILL to the rest after `timeout_s` (s, host time).

        Does nothing to a program that has ended, but kills what it left behind.
        """
        if self._is_over:
            return
        family: list[psutil.Process] = []
        with suppress(psutil.NoSuchProcess):
            family = psutil.Process(self.pid).children(recursive=True)
        if self.failure is None:
            until_s = time.monotonic() + timeout_s
            self.is_stopped = True
            self._signal_group(with_signal)
            if self.wait(timeout_s) is None:
                self._overdue = f"did not end within {timeout_s:g} s of {_signal_name(with_signal)} and was killed"
            while time.monotonic() < until_s and any(_lives(process, self.pid) for process in family):
                time.sleep(0.01)
        self._signal_group(signal.SIGKILL)
        kill_all(family)
        left = kill_marked(self._mark)
        if self.wait(_KILL_S) is None:
            raise RuntimeError(f"process {self.pid} ({self.command[0]}) is still there {_KILL_S:g} s after SIGKILL")
        self.log.close(1.0)
        self._is_over = not left  # else somebody is there who could start something more

    def release(self) -> Usage:
        """Stop and reap the process; its id may be reused from then on."""
        if self._usage is None:
            self.stop(timeout_s=0.0)
            _, status, used = os.wait4(self.pid, 0)
            self._popen.returncode = os.waitstatus_to_exitcode(status)  # so that Popen does not wait for it either
            self._usage = Usage(used.ru_utime + used.ru_stime, used.ru_maxrss * RSS_UNIT_BYTES)
        return self._usage

    def _signal_group(self, number: int) -> None:
        if self._usage is None:  # while the zombie is there, the group's number is not another's
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, number)

    def _await_end(self) -> None:
        """Wait for the end without reaping, which would free the ids of process and group."""
        info = os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOWAIT)
        assert info is not None  # it blocks
        status = info.si_status
        if info.si_code == os.CLD_EXITED:
            self.failure = f"exited with code {status}" if status else ""
        else:
            killed = self._overdue if status == signal.SIGKILL else ""
            self.failure = killed or f"was ended by {_signal_name(status)}"
        self._end.set()
        if self._on_end is not None:
            self._on_end()


def kill_all(processes: Iterable[psutil.Process]) -> None:
    """Kill the living among `processes`, and wait until they are gone."""
    living = [process for process in processes if _lives(process)]
    for process in living:
        with suppress(psutil.NoSuchProcess, psutil.AccessDenied):
            process.kill()
    until_s = time.monotonic() + _KILL_S
    while any(_lives(process) for process in living) and time.monotonic() < until_s:
        time.sleep(0.005)


def _lives(process: psutil.Process, group: int | None = None) -> bool:
    """Whether a process still does something, in a process group if one is given."""
    try:
        lives = bool(process.is_running() and process.status() != psutil.STATUS_ZOMBIE)
        return lives and (group is None or os.getpgid(process.pid) == group)
    except (psutil.NoSuchProcess, ProcessLookupError):
        return False


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # a real-time signal
        return f"signal {number}"


def _not_started(command: Sequence[str], folders: RunFolders, error: Exception) -> str:
    program = command[0]
    if not folders.out.is_dir():
        return f"the folder {str(folders.out)!r} to start {program!r} in is not there"
    there = folders.path(program)
    reason = str(error)
    match error:
        case FileNotFoundError() if "/" in program and there.is_file():
            reason = "the interpreter its first line names was not found"
        case FileNotFoundError() if there.is_relative_to(folders.config):
            reason = "no file that execution.run_files matches lies there"
        case FileNotFoundError() if "/" in program:
            reason = "there is no such file, seen from the run's folder"
        case FileNotFoundError():
            reason = "no program of this name in PATH"
        case PermissionError():
            reason = "it is not executable"
        case OSError(errno=errno.ENOEXEC):
            reason = "neither a binary of this machine nor a script with a #! line"
    return f"{program!r} could not be started: {reason}"
