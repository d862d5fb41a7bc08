"""Outputs: the files and tables that a run left in its folder."""

import os
import stat
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final, TypeAlias

from vastflow.sim.model.archive import read_foreign_table
from vastflow.sim.model.recording import Columns, LeftOut, Outputs

MAX_FILE_BYTES: Final = 16 * 2**20
MAX_RUN_BYTES: Final = 64 * 2**20
MAX_TABLE_BYTES: Final = 64 * 2**20
MAX_TABLES_BYTES: Final = 256 * 2**20
MAX_LISTED: Final = 10_000

Stamp: TypeAlias = tuple[int, int, int, int]
"""Inode, size, and times of change: another one, another content."""


def stamps(folder: Path) -> dict[str, Stamp]:
    """Return the stamps of all files below `folder` by path."""
    return {name: _stamp(path.lstat()) for name, path in _files(folder)}


def read_outputs(folder: Path, before: Mapping[str, Stamp]) -> Outputs:
    """Read the files below `folder` that are new or changed since `before`.

    `*.csv` and `*.parquet` are tables; one that can't be read as such is noted and kept as a file. In the order of the
    paths, files are kept up to `MAX_FILE_BYTES` each and `MAX_RUN_BYTES` in all, tables up to `MAX_TABLE_BYTES` and
    `MAX_TABLES_BYTES`; the rest is listed. A link that leads out of `folder`, or to a folder, is not followed.
    """
    reading = _Reading(folder.resolve())
    for name, path in _files(folder, reading.lock_out):
        if before.get(name) != _stamp(path.lstat()):
            reading.take(name, path)
    return reading.outputs()


class _Reading:
    """Collects outputs within the limits."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._tables: dict[str, Columns] = {}
        self._files: dict[str, bytes] = {}
        self._left_out: list[LeftOut] = []
        self._unlisted = 0
        self._notes: list[str] = []
        self._files_bytes = 0
        self._tables_bytes = 0

    def take(self, name: str, path: Path) -> None:
        target = Path(os.path.realpath(path)) if path.is_symlink() else path
        if path.is_symlink() and not (target.is_relative_to(self._root) and target.is_file()):
            self._leave(name, 0, "a link that leads to no file of the run's folder")
            return
        status = target.stat()
        if not stat.S_ISREG(status.st_mode):
            self._leave(name, 0, "not a file but a device, pipe or socket")
            return
        try:
            if name.lower().endswith((".csv", ".parquet")):
                self._take_table(name, target, status.st_size)
            else:
                self._take_file(name, target, status.st_size)
        except OSError as error:
            self._leave(name, status.st_size, f"it can't be read: {error.strerror}")

    def lock_out(self, error: OSError) -> None:
        """Note a folder that can't be listed."""
        self._notes.append(f"{_printable(os.path.relpath(error.filename, self._root))}: {error.strerror}")

    def _take_table(self, name: str, path: Path, size: int) -> None:
        if size > MAX_TABLE_BYTES or self._tables_bytes + size > MAX_TABLES_BYTES:
            self._leave(name, size, _too_large(size > MAX_TABLE_BYTES, MAX_TABLE_BYTES, MAX_TABLES_BYTES))
            return
        content = path.read_bytes()
        stem = name.rpartition(".")[0]
        called = name if stem in self._tables else stem
        try:
            self._tables[called], notes = read_foreign_table(name, content)
        except ValueError as fault:
            self._notes.append(f"{name}: {fault}")
            self._take_file(name, path, size)
            return
        self._tables_bytes += size
        self._notes.extend(f"{name}: {note}" for note in notes)

    def _take_file(self, name: str, path: Path, size: int) -> None:
        if size > MAX_FILE_BYTES or self._files_bytes + size > MAX_RUN_BYTES:
            self._leave(name, size, _too_large(size > MAX_FILE_BYTES, MAX_FILE_BYTES, MAX_RUN_BYTES))
            return
        self._files[name] = path.read_bytes()
        self._files_bytes += size

    def _leave(self, name: str, size: int, why: str) -> None:
        if len(self._left_out) < MAX_LISTED:
            self._left_out.append(LeftOut(name, size, why))
        else:
            self._unlisted += 1

    def outputs(self) -> Outputs:
        more = [f"{self._unlisted} more files are neither kept nor listed"] if self._unlisted else []
        return Outputs(self._tables, self._files, tuple(self._left_out), (*self._notes, *more))


def _files(folder: Path, locked: Callable[[OSError], None] | None = None) -> Iterator[tuple[str, Path]]:
    """Return name and path of all files, sorted; a link to a folder counts as a file.

    `locked` is told of folders that can't be listed.
    """
    found = []
    for parent, folders, names in os.walk(folder, onerror=locked):
        links = [name for name in folders if os.path.islink(os.path.join(parent, name))]
        found += [Path(parent, name) for name in (*names, *links)]
    named = ((_printable(path.relative_to(folder).as_posix()), path) for path in found)
    return iter(sorted(named))


def _printable(name: str) -> str:
    """Return a name with bytes that are no UTF-8 written out."""
    return os.fsencode(name).decode(errors="backslashreplace")


def _stamp(status: os.stat_result) -> Stamp:
    return status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns


def _too_large(alone: bool, limit: int, run_limit: int) -> str:
    return f"larger than {limit >> 20} MiB" if alone else f"the run's {run_limit >> 20} MiB are full"
