"""The code of a plug-in as a value, for a plug-in that a scenario names and that no source digest has."""

import functools
import hashlib
import importlib.metadata
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final, TypeAlias

from vastflow.sim.digest import Value, file_digest
from vastflow.sim.plug_ins.loading import snapshot_behind

OWN: Final = "vastflow."

_Stamp: TypeAlias = tuple[str, int, int]
"""Path, size (bytes) and time of the last change (ns since 1970) of a file."""


def code_value(kind: type) -> Value:
    """What tells the code of a class from any other: its files to the byte, and the versions of what they import.

    None for vastflow's own, which the source digest of execution has. Of a class from a file that is its snapshot, of an
    installed one its package.
    """
    if kind.__module__.startswith(OWN):
        return None
    if (snapshot := snapshot_behind(kind)) is not None:
        return [snapshot.digest, _versions(snapshot.outside)]
    top = kind.__module__.partition(".")[0]
    return [_content(_stamps(top)), _versions((top,))]


def _stamps(top: str) -> tuple[_Stamp, ...]:
    module = sys.modules[top]
    folders = [Path(folder) for folder in getattr(module, "__path__", ())]
    files = [file for folder in folders for file in folder.rglob("*.py")] or [Path(module.__file__ or "")]
    return tuple((str(file), status.st_size, status.st_mtime_ns) for file in sorted(files) if (status := file.stat()))


@functools.lru_cache(maxsize=16)
def _content(files: tuple[_Stamp, ...]) -> str:
    return hashlib.sha256("".join(file_digest(file) for file, _, _ in files).encode()).hexdigest()


def _versions(imported: tuple[str, ...]) -> dict[str, str]:
    names = (name for top in imported for name in _distributions().get(top, ()))
    return {name: importlib.metadata.version(name) for name in names}


@functools.cache
def _distributions() -> Mapping[str, list[str]]:
    """Import name to the distributions that are installed under it; takes a tenth of a second."""
    return importlib.metadata.packages_distributions()
