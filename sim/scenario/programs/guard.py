"""The guard of a run: it kills processes, found by a mark in their environment, and removes containers.

Run as a script, `guard.py MARK FOLDER` waits until its standard input is closed, kills what bears the mark, executes the
commands that it read, one a line as a list in JSON, and removes the folder. The kernel closes the pipe however the program that holds it ends, SIGKILL too. It imports nothing but the
standard library, so that it starts in some milliseconds. Marks are read from /proc: where there is none (macOS), no
process is found.
"""

import json
import os
import shutil
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

VARIABLE: Final = "VASTFLOW_RUN"
"""The environment variable that is the mark."""
KILL_FOR_S: Final = 5.0
"""Time during which processes that keep starting others are killed, before the guard gives up."""
CLEAN_FOR: Final = 60
"""Times, a second apart, that the guard tries to remove containers whose runtime does not answer."""
_PROC: Final = Path("/proc")


def marked(mark: str) -> Iterator[int]:
    """Yield ids of other living processes with a mark that begins with `mark`.

    A process that cleared its environment is not found, nor is one of another user.
    """
    entry = f"{VARIABLE}={mark}".encode()
    me = os.getpid()
    for name in os.listdir(_PROC) if _PROC.is_dir() else ():
        if name.isdigit() and int(name) != me and _bears(int(name), entry):
            yield int(name)


def kill_marked(mark: str, for_s: float = KILL_FOR_S) -> tuple[int, ...]:
    """Kill all processes with `mark`; return the ids of survivors after `for_s` (s).

    One look may miss a process: while it executes a program, it has no environment for a moment.
    """
    until_s = time.monotonic() + for_s
    found: tuple[int, ...] = ()
    looks_without = 0
    while looks_without < 2:
        found = tuple(marked(mark))
        looks_without = 0 if found else looks_without + 1
        for pid in found:
            try:
                os.kill(pid, signal.SIGKILL)
            except (ProcessLookupError, PermissionError):
                continue
        if time.monotonic() > until_s:
            break
        time.sleep(0.005)
    return found


def clean(commands: Sequence[Sequence[str]], missing: bool = False) -> bool:
    """Execute commands that remove containers, side by side; whether all removed one, or found none where it may be `missing`."""
    pipe = subprocess.PIPE
    try:
        begun = [subprocess.Popen(each, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe) for each in commands]
        said = [process.communicate(timeout=30.0)[1] for process in begun]
    except (OSError, subprocess.TimeoutExpired):
        return False
    found = zip(begun, said, strict=True)
    return all(not each.returncode or (missing and b"no such container" in text.lower()) for each, text in found)


def remove_folder(folder: Path) -> None:
    """Remove `folder`, also if programs locked folders in it."""
    shutil.rmtree(folder, ignore_errors=True)
    locked = [folder] if folder.is_dir() else []
    while locked:
        within = locked.pop()
        with suppress(OSError):
            within.chmod(stat.S_IRWXU)
            locked += [Path(entry) for entry in os.scandir(within) if entry.is_dir(follow_symlinks=False)]
    shutil.rmtree(folder, ignore_errors=True)


def _bears(pid: int, entry: bytes) -> bool:
    try:
        environment = (_PROC / str(pid) / "environ").read_bytes()
    except OSError:  # it ended, or it is another user's
        return False
    return environment.startswith(entry) or b"\0" + entry in environment


if __name__ == "__main__":
    # A terminal's Ctrl-C is for the program that started the run, which then closes the pipe in its own time.
    for ignored in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(ignored, signal.SIG_IGN)
    left = [json.loads(line) for line in sys.stdin.buffer]
    _, given_mark, folder = sys.argv
    kill_marked(given_mark)
    time.sleep(0.1)  # a process that was just being started bears its mark a moment later
    kill_marked(given_mark)
    is_clean = False
    for _try in range(CLEAN_FOR if left else 0):
        if clean(left, missing=True) and is_clean:
            break
        is_clean = True  # unless the runtime was just making one
        time.sleep(1.0)
    remove_folder(Path(folder))
