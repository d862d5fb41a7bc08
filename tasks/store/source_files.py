"""Source files as they were when keys were made: nothing is stored by a process that imported others."""

import functools
import hashlib
import json
import os
import sys
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import psutil

from vastflow.tasks.store.artifact import StoreError

_Stamp: TypeAlias = tuple[int, int, str]
"""Size (bytes), time of the last change (ns since 1970) and SHA-256 of a file."""

_TOP: Final = "vastflow"
_WRITTEN_BY: Final = frozenset({".css", ".j2", ".js", ".py"})


@dataclass(frozen=True, slots=True)
class SourceFiles:
    """All Python files of some packages at one moment, small enough to go with every job.

    Attributes:
        record: Folder to its files with their stamps, as compressed JSON.
    """

    record: bytes

    def check(self) -> None:
        """Compare the files of the modules that this process has imported, each once.

        Raises:
            StoreError: one of them is another file now, so this process may have imported either.
        """
        _watched(self.record).check()

    def check_since_start(self, writers: Iterable[Path] = ()) -> None:
        """Check in a process that may have imported modules long before the keys were made.

        Args:
            writers: Folders with more of the code and the templates that made what is to be stored.

        Raises:
            StoreError: an imported file is another now, or any file is younger than this process.
        """
        watched = _watched(self.record)
        watched.check()
        changed_ns = {file: stamp[1] for file, stamp in watched.stamps.items()}
        for file in (file for folder in writers for file in folder.rglob("*") if file.suffix in _WRITTEN_BY):
            changed_ns[str(file)] = file.stat().st_mtime_ns
        began_ns = 1e9 * psutil.Process().create_time()
        for name, time_ns in changed_ns.items():
            if time_ns > began_ns:
                raise _changed(name)


def source_files(folders: Iterable[Path]) -> SourceFiles:
    """Return the Python files in these folders and below, as they are now."""
    found = {
        str(folder): {
            str(file.relative_to(folder)): ((status := file.stat()).st_size, status.st_mtime_ns, _sha256(str(file)))
            for file in sorted(folder.rglob("*.py"))
        }
        for folder in sorted(folders)
    }
    return SourceFiles(zlib.compress(json.dumps(found, separators=(",", ":")).encode()))


class _Watched:
    """A record, and which modules of this process were found to be as recorded."""

    def __init__(self, record: Mapping[str, Mapping[str, _Stamp]]) -> None:
        self._folders = tuple(folder + os.sep for folder in record)
        self.stamps: dict[str, _Stamp] = {
            os.path.join(folder, name): stamp for folder, files in record.items() for name, stamp in files.items()
        }
        self._sound: set[str] = set()
        self._modules = 0

    def check(self) -> None:
        if len(sys.modules) == self._modules:
            return
        count = len(sys.modules)
        for name, module in tuple(sys.modules.items()):
            if name.partition(".")[0] == _TOP and name not in self._sound:
                file = getattr(module, "__file__", None)
                if file is not None and file.startswith(self._folders):
                    self._compare(file)
                self._sound.add(name)
        self._modules = count

    def _compare(self, file: str) -> None:
        size, changed_ns, sha256 = self.stamps.get(file, (-1, -1, ""))
        try:
            status = os.stat(file)
            is_same = (status.st_size, status.st_mtime_ns) == (size, changed_ns) or _sha256(file) == sha256
        except OSError:
            is_same = False
        if not is_same:
            raise _changed(file)


def _changed(file: str) -> StoreError:
    return StoreError(
        f"store: {file} changed while the campaign ran, so nothing more of it is kept. What was finished before is: "
        "give the same command again."
    )


@functools.lru_cache(maxsize=4)
def _watched(record: bytes) -> _Watched:
    return _Watched(json.loads(zlib.decompress(record)))


def _sha256(file: str) -> str:
    with open(file, "rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()[:16]
