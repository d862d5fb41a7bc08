"""The files of a store at an address, such as S3 or whatever else fsspec reads and writes.

Nothing can be moved into place there. The files of an artifact are written first and its manifest last, which makes it
exist. A file's name has its digest in it: two writers of one key never mix what they wrote.
"""

import contextlib
import errno
import functools
import json
import os
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeAlias, TypeVar

import fsspec
import platformdirs

from vastflow.sim.model.digest import digest
from vastflow.sim.model.files import replace_file
from vastflow.tasks.store.artifact import MANIFEST, Artifact, FileEntry, StoreError, entry_of, present
from vastflow.tasks.store.files import Listed

_NAMED_DIGITS: Final = 16
_MANIFESTS_AT_A_TIME: Final = 2000
_LISTINGS: Final = 20
"""Number of folders above which one listing of everything is cheaper."""
_S3: Final = ("s3:", "s3a:")
_ANSWER_S: Final = 60
_REQUESTS: Final = 3
_READS: Final = 2
"""s3fs repeats a broken read with all of botocore's requests: six in all, and six minutes until a silent server is named."""

_Entry: TypeAlias = Mapping[str, Any]
"""A file as its file system lists it."""

P = ParamSpec("P")
T = TypeVar("T")


class RemoteFiles:
    """See `vastflow.tasks.store.files.StoreFiles`.

    Args:
        address: Such as `s3://bucket/prefix`.
    """

    def __init__(self, address: str) -> None:
        self._address = address.rstrip("/")
        self._opened: tuple[Any, str] | None = None

    @property
    def place(self) -> str:
        return self._address

    @property
    def local(self) -> Path:
        """A folder of this address in the user's cache folder."""
        return Path(platformdirs.user_cache_dir("vastflow"), "stores", digest(self._address)[:_NAMED_DIGITS])

    def prepare(self) -> None:
        """Write something and delete it."""
        name = f"temporary/{uuid.uuid4().hex}"
        self._write({name: b"vastflow"})
        self._asked(self._files.rm_file, self._path(name))

    def look(self, key: str) -> Artifact | None:
        """One listing and one read."""
        files = self._listed(key)
        if MANIFEST not in files:
            return None
        try:
            manifest = self.read(key, MANIFEST)
        except FileNotFoundError:  # just removed
            return None
        return _present(key, manifest, files)

    def everything(self) -> Iterator[tuple[str, Artifact | None]]:
        """One listing of everything, and the manifests that this machine has not read before."""
        whole = {key: files for key, files in _folders(self._listed("")).items() if MANIFEST in files}
        for key, manifest in self._manifests({key: files[MANIFEST] for key, files in whole.items()}).items():
            try:
                yield key, _present(key, manifest, whole[key])
            except (FileNotFoundError, ValueError):
                yield key, None

    def names(self, key: str) -> Iterable[str]:
        folders = _folders(self._listed(key))
        return [name for name, files in folders.items() if MANIFEST in files and "/" not in name and name]

    def read(self, key: str, name: str, entry: FileEntry | None = None) -> bytes:
        path = self._path(f"{key}/{_object(name, entry) if entry else name}")
        content: bytes = self._asked(self._files.cat_file, path)
        return content

    def measured(self, key: str, name: str, entry: FileEntry) -> FileEntry:
        """See `StoreFiles.measured`; the object is read whole."""
        return entry_of(self.read(key, name, entry))

    def write(
        self, artifact: Artifact, files: Mapping[str, bytes], sidecar: Mapping[str, bytes], manifest: bytes
    ) -> None:
        """The manifest last."""
        written = {_object(name, artifact.files[name]): content for name, content in files.items()}
        self._write({f"{artifact.key}/{name}": content for name, content in {**sidecar, **written}.items()})
        self._write({f"{artifact.key}/{MANIFEST}": manifest})

    def delete(self, keys: list[str]) -> None:
        """The manifests first."""
        folders = _folders(self._listed("")) if len(keys) > _LISTINGS else {key: self._listed(key) for key in keys}
        files = [f"{key}/{name}" for key in keys for name in folders.get(key, ())]
        for is_manifest in (True, False):
            if chosen := [self._path(file) for file in files if file.endswith(f"/{MANIFEST}") is is_manifest]:
                with contextlib.suppress(FileNotFoundError):  # another process was first
                    self._asked(self._files.rm, chosen)

    def listed(self, stages: Iterable[str]) -> Iterator[Listed]:
        chosen = frozenset(stages)
        for path, file in self._listed("").items():
            if path.partition("/")[0] in chosen:
                key, _, name = path.rpartition("/")
                yield Listed(key, name, int(file["size"]), _written_s(file))

    def _manifests(self, files: Mapping[str, _Entry]) -> dict[str, bytes]:
        """Read the manifests of keys, from local copies where the ETag is unchanged."""
        place = self.local / "manifests.json"
        try:
            copies: dict[str, str] = dict(json.loads(place.read_bytes()))
        except (OSError, ValueError, TypeError):
            copies = {}
        tags = {key: f"{key} {entry['ETag']}" for key, entry in files.items() if "ETag" in entry}
        found = {key: str(copies[tag]).encode() for key, tag in tags.items() if tag in copies}
        unread = [key for key in files if key not in found]
        for begin in range(0, len(unread), _MANIFESTS_AT_A_TIME):
            paths = {self._path(f"{key}/{MANIFEST}"): key for key in unread[begin : begin + _MANIFESTS_AT_A_TIME]}
            for path, content in self._asked(self._files.cat, list(paths), on_error="return").items():
                if isinstance(content, bytes):
                    found[paths[path]] = content
                elif not isinstance(content, FileNotFoundError):
                    raise self._unusable(content)
        if unread or len(copies) > len(found):
            kept = {tag: found[key].decode(errors="replace") for key, tag in tags.items() if key in found}
            with contextlib.suppress(OSError):
                place.parent.mkdir(parents=True, exist_ok=True)
                replace_file(place, json.dumps(kept).encode())
        return found

    def _listed(self, key: str) -> dict[str, _Entry]:
        """Return the files below `key`, by path from there."""
        below = self._path(key).rstrip("/") + "/"
        above, _, name = below[:-1].rpartition("/")
        # Where s3fs finds nothing below a path, it makes two more requests to learn what that is; not so with a prefix.
        place = {"path": above, "prefix": f"{name}/"} if above and self._address.startswith(_S3) else {"path": below}
        try:
            found = self._asked(self._files.find, **place, detail=True)
        except FileNotFoundError:
            return {}
        return {path[len(below) :]: file for path, file in found.items() if path.startswith(below)}

    def _write(self, contents: Mapping[str, bytes]) -> None:
        try:
            self._asked(self._files.pipe, {self._path(name): content for name, content in contents.items()})
        except FileNotFoundError as error:
            raise self._unusable(error) from None

    @property
    def _files(self) -> Any:
        return self._open()[0]

    def _path(self, name: str) -> str:
        return f"{self._open()[1]}/{name}"

    def _open(self) -> tuple[Any, str]:
        if self._opened is None:
            try:
                self._opened = file_system(self._address)
            except Exception as error:  # noqa: BLE001 - a file system may raise anything
                raise self._unusable(error) from None
        return self._opened

    def _asked(self, call: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T:
        """Call the file system, and raise a `StoreError` for anything but a missing file."""
        try:
            return call(*arguments, **named)
        except FileNotFoundError:
            raise
        except Exception as error:  # noqa: BLE001 - a file system may raise anything
            raise self._unusable(error) from None

    def _unusable(self, error: Exception) -> StoreError:
        return unusable("store", self._address, error)


def file_system(address: str) -> tuple[Any, str]:
    """Return fsspec's file system of an address, and its path there; errors of the file system pass through."""
    settings = tuple(sorted((name, each) for name, each in os.environ.items() if name.startswith("AWS_")))
    return _connected(address, os.getpid(), settings)


@functools.lru_cache(maxsize=8)
def _connected(address: str, process: int, settings: tuple[tuple[str, str], ...]) -> tuple[Any, str]:
    """Connect once in a process: each unit brings a store, and a client of S3 costs half a second."""
    files, root = fsspec.core.url_to_fs(address, **_options(address))
    if address.startswith(_S3):
        files.retries = _READS
    return files, str(root).rstrip("/")


def unusable(what: str, address: str, error: Exception) -> StoreError:
    """Return a file system's error as a sentence.

    Args:
        what: Kind of content at the address, such as `store`.
    """
    found = f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]
    if isinstance(error, FileNotFoundError):
        right = "Make the bucket, or correct the address"
    elif isinstance(error, PermissionError) or "Credential" in type(error).__name__:
        right = (
            "Check the credentials (AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE) and their rights. They come "
            "from the environment, as no campaign directory, deployment, or log keeps those of an address"
        )
    elif isinstance(error, ImportError):
        right = "Install what it names, or give a folder or s3://bucket/prefix"
    elif isinstance(error, ValueError):
        right = "Give a folder, or an address such as s3://bucket/prefix"
    else:
        right = "Check the network and the server (AWS_ENDPOINT_URL). What was finished is kept"
    return StoreError(f"{what}: can't use {address!r} ({found}). {right}.")


def _options(address: str) -> dict[str, Any]:
    if not address.startswith(_S3):
        return {}
    from aiobotocore.session import get_session

    session = get_session()
    session.register("before-sign.s3", _expect_nothing)
    # Servers other than Amazon's know neither the checksums nor the signature that newer clients send.
    config = {
        "signature_version": "s3v4",
        "request_checksum_calculation": "when_required",
        "response_checksum_validation": "when_required",
        "retries": {"total_max_attempts": _REQUESTS, "mode": "standard"},
        "max_pool_connections": 50,
        "connect_timeout": 10,
        "read_timeout": _ANSWER_S,
    }
    # With more than one reader for a file s3fs asks for its size before each read.
    return {"use_listings_cache": False, "config_kwargs": config, "session": session, "max_concurrency": 1}


def _expect_nothing(request: Any, **_: Any) -> None:
    """Send an object at once: a client that expects "100 Continue" waits for it without any limit of time (aiohttp)."""
    del request.headers["Expect"]


def _present(key: str, manifest: bytes, files: Mapping[str, _Entry]) -> Artifact:
    def size_bytes(name: str, entry: FileEntry) -> int:
        if (file := files.get(_object(name, entry))) is None:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
        return int(file["size"])

    return present(key, manifest, size_bytes)


def _object(name: str, entry: FileEntry) -> str:
    return f"{entry.sha256[:_NAMED_DIGITS]}-{name}"


def _folders(listed: Mapping[str, _Entry]) -> dict[str, dict[str, _Entry]]:
    folders: dict[str, dict[str, _Entry]] = {}
    for path, file in listed.items():
        folder, _, name = path.rpartition("/")
        folders.setdefault(folder, {})[name] = file
    return folders


def _written_s(file: _Entry) -> float:
    """Return when a file was written (s since 1970); now where the file system doesn't say."""
    written = next((file[name] for name in ("LastModified", "mtime", "updated", "created") if name in file), None)
    if isinstance(written, str):
        written = datetime.fromisoformat(written)
    if written is None:
        written = datetime.now()
    return written.timestamp() if isinstance(written, datetime) else float(written)
