"""Outputs: the files and tables that a run left in its folder."""

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final, TypeAlias

from vastflow.sim.model.archive import read_foreign_table
from vastflow.sim.model.files import Unreadable, read_bytes
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
    kept, root, left_out = _Kept(), folder.resolve(), []

    def lock_out(error: OSError) -> None:
        kept.notes.append(f"{_printable(os.path.relpath(error.filename, root))}: {error.strerror}")

    for name, path in _files(folder, lock_out):
        if before.get(name) == _stamp(path.lstat()):
            continue
        target = Path(os.path.realpath(path)) if path.is_symlink() else path
        size = 0
        if path.is_symlink() and not (target.is_relative_to(root) and target.is_file()):
            why = "a link that leads to no file of the run's folder"
        elif not target.is_file():
            why = "not a file but a device, pipe or socket"
        else:
            size = target.stat().st_size
            try:
                why = kept.refusal(name, target, size)
            except Unreadable as error:
                why = str(error)
        if why:
            left_out.append(LeftOut(name, size, why))
    unlisted = len(left_out) - MAX_LISTED
    more = [f"{unlisted} more files are neither kept nor listed"] if unlisted > 0 else []
    return Outputs(kept.tables, kept.files, tuple(left_out[:MAX_LISTED]), (*kept.notes, *more))


class _Kept:
    """Outputs within the limits, and notes on them."""

    def __init__(self) -> None:
        self.tables: dict[str, Columns] = {}
        self.files: dict[str, bytes] = {}
        self.notes: list[str] = []
        self._tables_bytes = self._files_bytes = 0

    def refusal(self, name: str, path: Path, size: int) -> str:
        """Keep a file, or return why it is not kept."""
        if name.lower().endswith((".csv", ".parquet")):
            if size > MAX_TABLE_BYTES or self._tables_bytes + size > MAX_TABLES_BYTES:
                return _too_large(size, MAX_TABLE_BYTES, MAX_TABLES_BYTES)
            stem = name.rpartition(".")[0]
            try:
                columns, notes = read_foreign_table(name, read_bytes(path))
            except ValueError as fault:
                self.notes.append(f"{name}: {fault}")
            else:
                self.tables[name if stem in self.tables else stem] = columns
                self.notes += [f"{name}: {note}" for note in notes]
                self._tables_bytes += size
                return ""
        if size > MAX_FILE_BYTES or self._files_bytes + size > MAX_RUN_BYTES:
            return _too_large(size, MAX_FILE_BYTES, MAX_RUN_BYTES)
        self.files[name] = read_bytes(path)
        self._files_bytes += size
        return ""


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


def _too_large(size: int, limit: int, run_limit: int) -> str:
    return f"larger than {limit >> 20} MiB" if size > limit else f"the run's {run_limit >> 20} MiB are full"
