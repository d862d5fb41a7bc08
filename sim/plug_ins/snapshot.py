"""Snapshots: immutable copies of a plug-in and its files."""

import hashlib
import os
import shutil
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import platformdirs

from vastflow.sim.model.digest import FileContent, Value, digest
from vastflow.sim.model.files import keep_folder
from vastflow.sim.plug_ins.neighbors import MOST_BYTES, Hidden, PlugInError, neighbors_of

_UNUSED_S: Final = 30 * 24 * 3600.0
"""A snapshot that nobody has opened for so long goes."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A plug-in's file and the neighbors it uses, at one moment; it can be sent to another process.

    Attributes:
        entry: Place of the plug-in's file.
        modules: Places of all Python files, to the SHA-256 of their content; so has `data`, of declared data files. Places are
            relative to the folder that all lie below.
        outside: Top-level names of the modules that it imports from elsewhere.
        folder: Folder of the copies.
        origin: The folder that was copied from.
        campaign: The campaign's folder.
        hidden: Inputs that results may depend on and that can't be followed.
    """

    entry: str
    modules: Mapping[str, str]
    data: Mapping[str, str]
    outside: tuple[str, ...]
    folder: Path = field(compare=False)
    origin: Path = field(compare=False)
    campaign: Path = field(compare=False)
    hidden: tuple[Hidden, ...] = field(compare=False, default=())

    @property
    def files(self) -> dict[str, str]:
        """All of them."""
        return {**self.modules, **self.data}

    @property
    def digest(self) -> str:
        """Digest of the copied bytes."""
        return _digest(self.entry, self.modules, self.data)

    @property
    def file(self) -> Path:
        """The copy of the plug-in's file."""
        return self.folder / self.entry

    @property
    def contents(self) -> dict[Path, Path]:
        """Original path of each file, to its copy."""
        return {self.origin / place: self.folder / place for place in self.files}

    @property
    def home(self) -> str:
        """Place of the folder from which its imports are looked up."""
        return self.entry.rpartition("/")[0]

    def local_name(self, place: str) -> str:
        """A place relative to the plug-in's own folder, as its code names it."""
        return os.path.relpath(place, self.home or ".").replace(os.sep, "/")

    def read(self, place: str) -> bytes:
        """A copy's content; a PlugInError if the copy has changed."""
        try:
            content = (self.folder / place).read_bytes()
        except OSError:
            content = b""
        if hashlib.sha256(content).hexdigest() != self.files[place]:
            raise PlugInError(f"{str(self.folder / place)!r} is no longer what was copied", "run the campaign again")
        return content

    def check(self) -> None:
        """Read every copy."""
        for place in self.files:
            self.read(place)


@dataclass(frozen=True, slots=True)
class PlugInFile(FileContent):
    """A file that names plug-ins or is one, with the copy of each `file.py:Class`."""

    plug_ins: Mapping[str, Snapshot] = field(compare=False, default_factory=dict)


def snapshot_of(file: Path, campaign: Path, code: str | None = None, within: Path | None = None) -> Snapshot:
    """Copy a plug-in and its files in their current state.

    Args:
        campaign: The campaign's folder.
        code, within: See `vastflow.sim.plug_ins.neighbors.neighbors_of`.

    Raises:
        PlugInError: see there; or all of it is too large, or can't be kept anywhere.
    """
    file, campaign = Path(os.path.abspath(file)), Path(os.path.abspath(campaign))
    found = neighbors_of(file, code, within)
    contents = {**found.modules, **found.data}
    if (size := sum(map(len, contents.values()))) > MOST_BYTES:
        largest = max(contents, key=lambda path: len(contents[path]))
        raise PlugInError(
            f"{file.name} and what it uses have {size / 1e6:.0f} MB, most of it {largest.name}",
            f"at most {MOST_BYTES / 1e6:.0f} MB are allowed, as they are copied into each campaign directory",
        )
    origin = Path(os.path.commonpath([path.parent for path in contents]))
    places = {path: path.relative_to(origin).as_posix() for path in contents}
    modules = {places[path]: hashlib.sha256(content).hexdigest() for path, content in found.modules.items()}
    data = {
        places[path]: hashlib.sha256(content).hexdigest()
        for path, content in sorted(found.data.items())
        if path not in found.modules
    }
    entry = places[file]
    name = _digest(entry, modules, data)
    folder = _kept(name, {places[path]: content for path, content in contents.items()})
    return Snapshot(entry, modules, data, tuple(sorted(found.outside)), folder, origin, campaign, tuple(found.hidden))


def _digest(entry: str, modules: Mapping[str, str], data: Mapping[str, str]) -> str:
    return digest("plug-in", entry, dict(modules), dict(data))


def _kept(name: str, contents: Mapping[str, bytes]) -> Path:
    root = Path(platformdirs.user_cache_dir("vastflow")) / "plug-ins"  # what others can write, they could execute
    folder = root / name[:32]
    try:
        if keep_folder(folder, contents):
            for old in root.iterdir():
                with suppress(OSError):
                    if time.time() - old.stat().st_mtime > _UNUSED_S:
                        shutil.rmtree(old, ignore_errors=True)
        os.utime(folder)
    except OSError as error:
        what = f"copies of a plug-in can't be written below {str(root)!r} ({error.strerror})"
        raise PlugInError(what, "set XDG_CACHE_HOME to a folder of yours") from None
    return folder


def plug_ins_in(values: Value) -> tuple[PlugInFile, ...]:
    """The files with plug-ins among values, once each."""
    if isinstance(values, PlugInFile):
        return (values,)
    if isinstance(values, str | FileContent) or not isinstance(values, Mapping | Sequence):
        return ()
    items = values.values() if isinstance(values, Mapping) else values
    return tuple(dict.fromkeys(each for item in items for each in plug_ins_in(item)))
