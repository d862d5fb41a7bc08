"""The campaign directory as a place: its name, and that it appears whole or not at all."""

import errno
import itertools
import json
import os
import platform
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final

import psutil

from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import read_json
from vastflow.tasks.store.store import StoreError

ABANDONED_S: Final = 24 * 3600.0
WRITER: Final = ".writer.json"
"""File in an unfinished directory that names the writing process."""

_OF_THE_DISK: Final = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EFBIG, errno.EACCES, errno.EPERM)
_LONGEST_NAME: Final = 150
"""Characters; file systems have room for 255 bytes, of which time, number and the mark of a half written folder take some."""
_PARTIAL: Final = ".{}.partial"
_OURS: Final = re.compile(r"\..+-\d{4}-\d\d-\d\d-\d{6}(-\d+)?\.partial")


@dataclass(frozen=True, slots=True)
class NewDirectory:
    """A campaign directory that is written to `partial`, and will be at `final` once it is whole."""

    partial: Path
    final: Path


@contextmanager
def new_directory(root: Path, name: str, created: datetime) -> Iterator[NewDirectory]:
    """A folder `root/<name>-<YYYY-MM-DD-HHMMSS>` that appears when the body ends, and doesn't when the body raises.

    Two that begin in one second get different names (`-2` appended). A process killed meanwhile leaves a
    hidden `.<name>.partial`, never half a campaign directory; one that was left a day ago is removed first.

    Raises:
        UserError: the disk is full or broken, or may not be written, or the folder was deleted meanwhile.
    """
    directory: NewDirectory | None = None
    try:
        root.mkdir(parents=True, exist_ok=True)
        sweep(root)
        directory = _reserved(root, f"{directory_name(name)}-{created:%Y-%m-%d-%H%M%S}")
        yield directory
        (directory.partial / WRITER).unlink(missing_ok=True)
        directory.partial.rename(directory.final)
    except BaseException as error:
        gone = isinstance(error, FileNotFoundError) and directory is not None and not directory.partial.exists()
        if directory is not None:
            shutil.rmtree(directory.partial, ignore_errors=True)
        if gone:
            raise UserError(
                f"results: {str(root)!r} was deleted while it was being written; what was computed is in the store, "
                "and the same command writes it again"
            ) from None
        of_the_disk = isinstance(error, OSError) and (directory is None or error.errno in _OF_THE_DISK)
        if isinstance(error, OSError) and of_the_disk and not isinstance(error, StoreError):
            raise UserError(
                f"results: can't write to {str(root)!r} ({error.strerror}); make room there or give another folder "
                f"with --results; what was computed is in the store"
            ) from None
        raise


def directory_name(name: str) -> str:
    """Return `name` as a folder name: `-` for other characters, cut to a limit."""
    return re.sub(r"[^A-Za-z0-9.-]+", "-", name)[:_LONGEST_NAME].strip("-.") or "campaign"


def sweep(root: Path) -> None:
    """Remove what processes that are gone left half written in `root` a day ago or longer."""
    for partial in root.glob(_PARTIAL.format("*")):
        if not _OURS.fullmatch(partial.name):
            continue
        with suppress(OSError):
            written_s = max(path.stat().st_mtime for path in (partial, *partial.rglob("*")))
            if time.time() - written_s > ABANDONED_S and writer_of(partial) is None:
                shutil.rmtree(partial, ignore_errors=True)


def left_behind(directory: Path) -> Path | None:
    """Return the half-written folder of a campaign directory, or None."""
    if directory.name.startswith(".") and directory.name.endswith(".partial"):
        return directory if directory.is_dir() else None
    partial = directory.with_name(_PARTIAL.format(directory.name))
    return partial if partial.is_dir() else None


def writer_of(partial: Path) -> int | None:
    """Return the id of the live process on this host that is writing a directory.

    On a file system that hosts share, the process of another host counts as gone.
    """
    try:
        writer = read_json(partial / WRITER)
        alive = writer["host"] == platform.node() and _began_s(writer["pid"]) == writer["began_s"]
        return int(writer["pid"]) if alive else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _began_s(pid: int) -> float | None:
    """Return the start time of a process, which identifies it with its id; None without a process."""
    try:
        return psutil.Process(pid).create_time()
    except psutil.Error:
        return None


def _reserved(root: Path, name: str) -> NewDirectory:
    for k in itertools.count(1):
        final = root / (name if k == 1 else f"{name}-{k}")
        partial = root / _PARTIAL.format(final.name)
        try:
            partial.mkdir()
        except FileExistsError:
            continue
        if not final.exists():  # looked at after the reservation, so that nobody can finish in between
            writer = {"host": platform.node(), "pid": os.getpid(), "began_s": _began_s(os.getpid())}
            (partial / WRITER).write_text(json.dumps(writer), encoding="utf-8")
            return NewDirectory(partial, final)
        partial.rmdir()
    raise AssertionError("unreachable: itertools.count never ends")
