"""A kept server: Prefect's embedded API that stays for the next calls, where the user has allowed it, and ends when it is idle.

A file says where it listens, under a name that all it follows from is in: another version or other settings of Prefect look for
another file, find none, and start a server of their own. Who uses it holds a shared lock beside that file, which the
system takes back however a process ends; the server ends once it could have had the lock for itself all the time.
"""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any, Final

import platformdirs
import psutil

from vastflow.sim.model.digest import digest
from vastflow.sim.model.faults import UserError
from vastflow.tasks.prefect.adapter import settings_of_user
from vastflow.tasks.prefect.server import AUTH, STARTUP_S, ApiServer, PrefectUnavailable, answers, server_environment

IDLE_S: Final = "VASTFLOW_SERVER_IDLE_S"
"""Variable: seconds that a server stays without use. Unset, empty or 0: each call has a server of its own."""

_LOOK_S: Final = 1.0
_POLL_S: Final = 0.1
_SAME_S: Final = 2.0
_TRIES: Final = 30


@dataclass(frozen=True, slots=True)
class Record:
    """Where a kept server listens, and which process it is.

    Attributes:
        began_s: When the process began, which tells it from a later one of the same number.
        notices: What it said that a user should hear.
        auth: User and password that it asks for.
    """

    port: int
    pid: int
    began_s: float
    notices: list[str]
    auth: str = field(repr=False)

    @property
    def process(self) -> psutil.Process | None:
        """The server; None where it is gone."""
        with contextlib.suppress(psutil.Error):
            process = psutil.Process(self.pid)
            ended = process.status() == psutil.STATUS_ZOMBIE
            if not ended and abs(process.create_time() - self.began_s) <= _SAME_S:
                return process
        return None

    @property
    def url(self) -> str:
        """The API's address."""
        return f"http://127.0.0.1:{self.port}/api"


def idle_limit_s() -> float:
    """How long a server stays without use; 0 where none stays.

    Raises:
        UserError: the variable is no number of seconds.
    """
    said = os.environ.get(IDLE_S) or "0"
    try:
        limit_s = float(said)
    except ValueError:
        limit_s = -1.0
    if not 0 <= limit_s < float("inf"):
        raise UserError(f"{IDLE_S}: found {said!r}; seconds that Prefect's API stays without use, such as 900, or 0")
    return limit_s if sys.platform != "win32" else 0.0


def folder() -> Path:
    """Where the records lie."""
    return Path(platformdirs.user_state_dir("vastflow")) / "servers"


def record_file() -> Path:
    """The record of the server that this process may use: of its Prefect, its Python, and its settings."""
    follows_from = [version("prefect"), version("vastflow"), sys.executable, settings_of_user()]
    return folder() / f"{digest(follows_from)[:32]}.json"


def read_record(file: Path) -> Record | None:
    """What a server said of itself; None where there is none or it is gone."""
    try:
        record = Record(**json.loads(file.read_bytes()))
    except (OSError, ValueError, TypeError):
        return None
    return record if record.process else None


def write_record(file: Path, port: int, notices: list[str]) -> None:
    """Say that this process is the server, and listens on `port`."""
    record = Record(port, os.getpid(), psutil.Process().create_time(), notices, os.environ[AUTH])
    prepared = file.with_suffix(f".{os.getpid()}")
    prepared.touch(0o600)
    prepared.write_text(json.dumps(asdict(record)), encoding="utf-8")
    os.replace(prepared, file)


def end_when_idle(file: Path, idle_s: float) -> None:
    """End this process, which is the server, once nobody has used it for `idle_s`, or its record is gone."""
    with _lock(file) as lock:
        used_s = time.monotonic()
        while True:
            time.sleep(min(_LOOK_S, idle_s / 4))
            if not _taken(lock, shared=False):
                used_s = time.monotonic()
                continue
            found = read_record(file)
            is_own = found is not None and found.pid == os.getpid()
            if time.monotonic() - used_s > idle_s or not is_own:
                if is_own:
                    file.unlink(missing_ok=True)
                os._exit(0)  # with the lock, so that nobody comes meanwhile
            _release(lock)


def kept_servers() -> list[Record]:
    """All servers of this user that stay."""
    return [record for file in sorted(folder().glob("*.json")) if (record := read_record(file)) is not None]


def end_kept() -> list[tuple[Record, bool]]:
    """End the servers that nobody uses; gives all that there were, and whether each has ended."""
    found = []
    for file in sorted(folder().glob("*.json")):
        if (record := read_record(file)) is None:
            continue
        with _lock(file) as lock:
            is_free = _taken_soon(lock)
            process = record.process
            if is_free and process is not None:
                file.unlink(missing_ok=True)
                process.terminate()
                try:
                    process.wait(5)
                except psutil.TimeoutExpired:
                    process.kill()
            found.append((record, is_free))
    return found


class KeptServer:
    """The kept server of this Prefect, found or started beside whatever its owner does next. As `ApiServer`, but `stop` leaves it.

    One that dies while it is used is replaced by a server of this process on the same port.

    Args:
        log: File that takes what a server of this process prints; a kept one has a log beside its record.
    """

    def __init__(self, log: Path, idle_s: float) -> None:
        self._log = log
        self._idle_s = idle_s
        self._record: Record | None = None
        self._own: ApiServer | None = None
        self._stopping = threading.Event()
        self._found = threading.Event()
        threading.Thread(target=self._use, name="vastflow kept server", daemon=True).start()

    @property
    def answers(self) -> bool:
        """Whether it has ever answered."""
        return self._record is not None or (self._own is not None and self._own.answers)

    @property
    def auth(self) -> str:
        """User and password that it asks for, once it has answered."""
        return found.auth if (found := self._own or self._record) else ""

    @property
    def notices(self) -> list[str]:
        """What it said that a user should hear."""
        return self._own.notices if self._own is not None else []

    def url(self, timeout_s: float = STARTUP_S) -> str:
        """The API's address, once it answers.

        Raises:
            PrefectUnavailable: it ended or was too slow.
        """
        self._found.wait(timeout_s)
        if self._own is not None:
            return self._own.url(timeout_s)
        if self._record is None:
            raise PrefectUnavailable(f"Prefect's API did not start within {timeout_s:.0f} s; see {self._log}")
        return self._record.url

    def stop(self, grace_s: float = 3.0) -> None:
        """Use it no more; a server of this process is ended. May be called twice."""
        self._stopping.set()
        if self._own is not None:
            self._own.stop(grace_s)

    def _use(self) -> None:
        """Hold the lock until the server is not needed any more, or has gone."""
        try:
            file = record_file()
            file.parent.mkdir(parents=True, exist_ok=True)
            with _lock(file) as lock:
                self._record = self._had(file, lock)
                if self._record is not None:
                    self._found.set()
                    while not self._stopping.wait(_LOOK_S):
                        if self._record.process is None:
                            break
        except OSError:  # a home that can't be written: a container's, say
            pass
        if not self._stopping.is_set():
            before = self._record
            self._own = ApiServer(self._log, before.port, before.auth) if before else ApiServer(self._log)
        self._found.set()

    def _had(self, file: Path, lock: IO[Any]) -> Record | None:
        """The server that answers, with a share in its lock; None where none can be had."""
        deadline = time.monotonic() + STARTUP_S
        while time.monotonic() < deadline and not self._stopping.is_set():
            if _taken(lock, shared=True):  # not while another process starts it
                if (record := read_record(file)) is not None and answers(record.url):
                    return record
                _release(lock)
                if _taken(lock, shared=False):
                    _start(file, self._idle_s)
                    _answering(file, deadline, self._stopping)
                    _release(lock)
            self._stopping.wait(_POLL_S)
        return None


def _start(file: Path, idle_s: float) -> None:
    """Start a server that outlives this process. Its log is that of the last one that was started."""
    with open(file.with_suffix(".log"), "wb") as sink:
        server = subprocess.Popen(
            [sys.executable, "-m", "vastflow.tasks.prefect.api_server", "0", str(file), str(idle_s)],
            stdin=subprocess.DEVNULL,
            stdout=sink,
            stderr=sink,
            env=server_environment(),
            start_new_session=True,
            cwd=file.parent,  # not a folder that somebody wants to delete
        )
    threading.Thread(target=server.wait, name="vastflow kept server's end", daemon=True).start()


def _answering(file: Path, deadline: float, stopping: threading.Event) -> None:
    while time.monotonic() < deadline and not stopping.wait(_POLL_S):
        if (record := read_record(file)) is not None and answers(record.url):
            return


@contextlib.contextmanager
def _lock(file: Path) -> Iterator[IO[Any]]:
    with open(file.with_suffix(".lock"), "ab") as lock:
        yield lock


def _taken(lock: IO[Any], *, shared: bool) -> bool:
    """Take the lock if that is possible now."""
    import fcntl  # not on every system, where no server stays

    with contextlib.suppress(BlockingIOError):
        fcntl.flock(lock, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        return True
    return False


def _taken_soon(lock: IO[Any]) -> bool:
    """Take the lock for this process alone; its server has it for moments, to look whether it is used."""
    for _ in range(_TRIES):
        if _taken(lock, shared=False):
            return True
        time.sleep(_POLL_S)
    return False


def _release(lock: IO[Any]) -> None:
    import fcntl

    fcntl.flock(lock, fcntl.LOCK_UN)
