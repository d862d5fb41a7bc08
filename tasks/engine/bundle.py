"""Bundles: values for workers that share only the store, with the files that the values name.

A file is an artifact by its content. A worker lays out the files of a bundle below a folder of its own, at the same absolute
paths, so that they keep their places relative to each other; what a file itself names from the root of the file system means
the worker's own. Plug-ins travel as the copies that were made when they were read.
"""

import hashlib
import io
import os
import pickle
import shutil
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Final

import platformdirs

from vastflow.sim.model.digest import FileContent, digest
from vastflow.sim.model.faults import FileError, ScenarioError
from vastflow.sim.model.files import Unreadable, open_file
from vastflow.sim.plug_ins.snapshot import PlugInFile, Snapshot
from vastflow.sim.scenario.language.reading import files_of
from vastflow.sim.world.readers.reader import WorldError
from vastflow.sim.world.readers.registry import files_of_world, known_reader
from vastflow.tasks.store.store import WRITING_S, Lost, Store, StoreError

STAGE: Final = "bundle"
_CONTENT: Final = "content"


@dataclass(frozen=True, slots=True)
class SentFile:
    """A file of a bundle: its absolute path, the SHA-256 of its content, and whether it may be executed."""

    path: str
    sha256: str
    executable: bool


@dataclass(frozen=True, slots=True)
class Bundle:
    """A pickled value, and the files that it names."""

    content: bytes
    files: tuple[SentFile, ...]

    def opened(self, store: Store) -> Any:
        """Return the value with the files of this machine.

        Args:
            store: Stands for every store in the value.

        Raises:
            StoreError: a file is not in the store, or not the content of its key.
        """
        return _Unpickler(io.BytesIO(self.content), _laid_out(store, self.files), store).load()


class Packer:
    """Packs values, and puts each of their files into the store once."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._sent: dict[Path, SentFile] = {}
        self._needed: dict[Path, tuple[Path, ...]] = {}

    def packed(self, value: object) -> Bundle:
        """Pack a value.

        Raises:
            ScenarioError: a file can't be read.
            StoreError: the store can't be used.
        """
        content = io.BytesIO()
        pickler = _Pickler(content)
        pickler.dump(value)
        files = dict(pickler.copies)
        for path in pickler.named:
            if path not in self._needed:
                try:
                    self._needed[path] = needed_files(path)
                except FileError as error:
                    raise ScenarioError(f"{error} (it changed since the campaign was read)") from None
            files.update((each, files.get(each, each)) for each in self._needed[path])
        return Bundle(content.getvalue(), tuple(self._put(path, files[path]) for path in sorted(files)))

    def put(self, content: bytes) -> str:
        """Store content by its SHA-256, and return that."""
        sha256 = hashlib.sha256(content).hexdigest()
        if self._store.find(key := _key(sha256)) is None:
            self._store.put(key, {_CONTENT: content})
        return sha256

    def _put(self, path: Path, copy: Path) -> SentFile:
        if path not in self._sent:
            try:
                with open_file(copy) as file:
                    content, mode = file.read(), os.fstat(file.fileno()).st_mode
            except Unreadable as error:
                raise ScenarioError(f"{path}: {error} (workers elsewhere need it)") from None
            self._sent[path] = SentFile(str(path), self.put(content), bool(mode & 0o100))
        return self._sent[path]


def content_of(store: Store, sha256: str) -> bytes:
    """Return content by its SHA-256, which is checked because manifests are not trusted.

    Raises:
        StoreError: it is not in the store, or something else is.
    """
    key = _key(sha256)
    try:
        content = store.read(key, _CONTENT)
    except Lost:
        place = "a folder that all machines share, or an address such as s3://bucket/prefix"
        raise StoreError(f"store: {key} is not in {store.place!r}. Expected {place}.") from None
    if hashlib.sha256(content).hexdigest() != sha256:
        store.discard(key, said := f"{_CONTENT} is not the content of its key")
        raise StoreError(f"store: {key}: {said}")
    return content


def needed_files(path: Path) -> tuple[Path, ...]:
    """Return a file and the files that it names by relative paths, such as a map's picture or imports.

    Raises:
        FileError: it can't be read.
    """
    if path.suffix == ".osc":
        return tuple(_absolute(file) for file in files_of(path))
    with suppress(WorldError):  # another YAML file
        known_reader(path)
        return path, *(_absolute(each) for each in files_of_world(path)[1:])
    return (path,)


def _absolute(path: str | Path) -> Path:
    """Return an absolute path with links left alone, as files name each other by these."""
    return Path(os.path.abspath(path))


def _key(sha256: str) -> str:
    return f"{STAGE}/{sha256[:2]}/{sha256}"


class _Pickler(pickle.Pickler):
    """Pickles stores, paths, files, and plug-in snapshots as their counterparts on a worker.

    Attributes:
        named: Paths of the files.
        copies: Paths that are not to be read themselves, each with the copy that has its content.
    """

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file)
        self.named: set[Path] = set()
        self.copies: dict[Path, Path] = {}

    def persistent_id(self, value: Any) -> Any:
        if isinstance(value, Store):
            return ("store",)
        if isinstance(value, FileContent):
            for snapshot in value.plug_ins.values() if isinstance(value, PlugInFile) else ():
                self.copies |= snapshot.contents
            if value.path:
                self.named.add(_absolute(value.path))
            return "file", value.path and str(_absolute(value.path)), value.digest
        if isinstance(value, Snapshot):
            self.copies |= {value.folder / place: value.folder / place for place in value.files}
            folders = value.folder, value.origin, value.campaign
            return "snapshot", value.entry, value.modules, value.data, value.outside, *map(str, folders)
        if isinstance(value, PurePath):
            return "path", str(value)
        return None


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, root: Path, store: Store) -> None:
        super().__init__(file)
        self._root = root
        self._store = store

    def persistent_load(self, pid: Any) -> Any:
        kind, *values = pid
        if kind == "store":
            return self._store
        if kind == "file":
            return FileContent(values[0] and str(_below(self._root, values[0])), values[1])
        if kind == "snapshot":
            return Snapshot(*values[:4], *(_below(self._root, folder) for folder in values[4:]))
        return _below(self._root, values[0])


def _below(root: Path, path: str) -> Path:
    """Return the place of a path in a worker's folder; a relative one stays."""
    place = Path(path)
    return root.joinpath(*place.parts[1:]) if place.is_absolute() else place


def _laid_out(store: Store, files: Sequence[SentFile]) -> Path:
    """Return a folder with these files, and make it if needed; remove folders unused for a day."""
    if not files:
        return Path("/")
    above = Path(platformdirs.user_cache_dir("vastflow")) / "bundles"
    root = above / digest([[each.path, each.sha256, each.executable] for each in files])[:32]
    if root.is_dir() and all(_below(root, each.path).is_file() for each in files):
        os.utime(root)
        return root
    above.mkdir(parents=True, exist_ok=True)
    for old in above.iterdir():
        with suppress(OSError):
            if time.time() - old.stat().st_mtime > WRITING_S:
                shutil.rmtree(old, ignore_errors=True)
    prepared = Path(tempfile.mkdtemp(dir=above))
    for each in files:
        target = _below(prepared, each.path)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content_of(store, each.sha256))
        target.chmod(0o755 if each.executable else 0o644)
    try:
        prepared.rename(root)
    except OSError:  # another worker was first, or something lies there that is not whole
        if not all(_below(root, each.path).is_file() for each in files):
            return prepared
        shutil.rmtree(prepared, ignore_errors=True)
    return root
