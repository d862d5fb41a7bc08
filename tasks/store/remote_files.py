"""The files of a store at an address, which is S3 or whatever else fsspec reads and writes, and copies of its manifests here.

Nothing can be moved into place there. The files of an artifact are written first and its manifest last, which makes it
exist. A file's name has its digest in it: two writers of one key never mix what they wrote.
"""

import contextlib
import errno
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
from vastflow.tasks.store.artifact import MANIFEST, Artifact, FileEntry, StoreError, artifact_of, entry_of, present
from vastflow.tasks.store.files import Listed


class ManifestCopies:
    """Copies by key and ETag: an object whose ETag is the same has the same content.

    A file system without ETags has no copies. A copy that can't be written costs time, nothing else.

    Args:
        file: Where they are kept.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        try:
            self._copies: dict[str, str] = dict(json.loads(file.read_bytes()))
        except (OSError, ValueError, TypeError):
            self._copies = {}
        self._kept = frozenset(self._copies)

    def find(self, key: str, entry: Mapping[str, Any]) -> bytes | None:
        """The manifest of `key`, if there is an undamaged copy.

        Args:
            entry: How the manifest is listed by its file system.
        """
        copy = self._copies.get(_tag(key, entry), "").encode()
        try:
            artifact_of(key, copy)
        except (ValueError, KeyError, TypeError):
            return None
        return copy

    def add(self, key: str, entry: Mapping[str, Any], manifest: bytes) -> None:
        """Copy a manifest that has been read."""
        if tag := _tag(key, entry):
            with contextlib.suppress(UnicodeDecodeError):  # a damaged one
                self._copies[tag] = manifest.decode()

    def keep(self, present: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
        """Write the copies of manifests that are present, and forget the others.

        Args:
            present: Keys, and how their manifests are listed.
        """
        tags = [tag for key, entry in present if (tag := _tag(key, entry)) in self._copies]
        self._copies = {tag: self._copies[tag] for tag in tags}
        if self._kept == self._copies.keys():
            return
        self._kept = frozenset(self._copies)
        prepared = self._file.with_name(uuid.uuid4().hex)
        with contextlib.suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True)
            prepared.write_text(json.dumps(self._copies), encoding="utf-8")
            os.replace(prepared, self._file)


def _tag(key: str, entry: Mapping[str, Any]) -> str:
    tag = entry.get("ETag")
    return f"{key} {tag}" if tag else ""


_NAMED_DIGITS: Final = 16
_MANIFESTS_AT_A_TIME: Final = 2000
_LISTINGS: Final = 20
"""Of more folders than this one listing of everything is cheaper."""
_S3: Final = ("s3:", "s3a:")
_ANSWER_S: Final = 60
_REQUESTS: Final = 3
_READS: Final = 2
"""s3fs repeats what breaks off while it is read, each time with all of botocore's requests: six in all, and six minutes
until a server that doesn't answer is named."""

_Entry: TypeAlias = Mapping[str, Any]
"""What a file system says of a file."""

P = ParamSpec("P")
T = TypeVar("T")


class RemoteFiles:
    """See `vastflow.tasks.store.files.StoreFiles`.

    Args:
        address: Such as `s3://bucket/prefix`.
    """

    def __init__(self, address: str) -> None:
        self._address = address.rstrip("/")
        self._copies: ManifestCopies | None = None
        self._opened: tuple[Any, str] | None = None

    @property
    def place(self) -> str:
        """The address."""
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
        if self._copies is not None:
            self._copies.add(key, files[MANIFEST], manifest)
        return _present(key, manifest, files)

    def everything(self) -> Iterator[tuple[str, Artifact | None]]:
        """One listing of everything, and the manifests that this machine has not read before."""
        whole = {key: files for key, files in _folders(self._listed("")).items() if MANIFEST in files}
        for key, manifest in self._manifests({key: files[MANIFEST] for key, files in whole.items()}).items():
            try:
                yield key, _present(key, manifest, whole[key])
            except (FileNotFoundError, ValueError, KeyError, TypeError):
                yield key, None

    def names(self, key: str) -> Iterable[str]:
        """See `StoreFiles.names`."""
        folders = _folders(self._listed(key))
        return [name for name, files in folders.items() if MANIFEST in files and "/" not in name and name]

    def read(self, key: str, name: str, entry: FileEntry | None = None) -> bytes:
        """See `StoreFiles.read`."""
        path = self._path(f"{key}/{_object(name, entry) if entry else name}")
        content: bytes = self._asked(self._files.cat_file, path)
        return content

    def measured(self, key: str, name: str, entry: FileEntry) -> FileEntry:
        """See `StoreFiles.measured`; an object's name has its digest and its size is listed, so it is read whole."""
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
        if len(keys) > _LISTINGS:
            folders = _folders(self._listed(""))
            files = [f"{key}/{name}" for key in keys for name in folders.get(key, ())]
        else:
            files = [f"{key}/{name}" for key in keys for name in self._listed(key)]
        for is_manifest in (True, False):
            if chosen := [self._path(file) for file in files if file.endswith(f"/{MANIFEST}") is is_manifest]:
                with contextlib.suppress(FileNotFoundError):  # another process was first
                    self._asked(self._files.rm, chosen)

    def listed(self, stages: Iterable[str]) -> Iterator[Listed]:
        """See `StoreFiles.listed`."""
        chosen = frozenset(stages)
        for path, file in self._listed("").items():
            if path.partition("/")[0] in chosen:
                key, _, name = path.rpartition("/")
                yield Listed(key, name, int(file["size"]), _written_s(file))

    def _manifests(self, files: Mapping[str, _Entry]) -> dict[str, bytes]:
        """Key to manifest, those this machine has read before from its own copies."""
        if self._copies is None:
            self._copies = ManifestCopies(self.local / "manifests.json")
        copies = self._copies
        found = {key: copy for key, entry in files.items() if (copy := copies.find(key, entry)) is not None}
        unread = [key for key in files if key not in found]
        for begin in range(0, len(unread), _MANIFESTS_AT_A_TIME):
            paths = {self._path(f"{key}/{MANIFEST}"): key for key in unread[begin : begin + _MANIFESTS_AT_A_TIME]}
            contents = self._asked(self._files.cat, list(paths), on_error="return")
            for path, content in contents.items():
                if isinstance(content, bytes):
                    found[paths[path]] = content
                    copies.add(paths[path], files[paths[path]], content)
                elif not isinstance(content, FileNotFoundError):
                    raise self._unusable(content)
        copies.keep(files.items())
        return found

    def _listed(self, key: str) -> dict[str, _Entry]:
        """What lies below `key`, by path from there."""
        below = self._path(key).rstrip("/") + "/"
        try:
            found = self._asked(self._files.find, below, detail=True)
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
        """Call the file system; what it raises is a `StoreError`, but for a file that is not there."""
        try:
            return call(*arguments, **named)
        except FileNotFoundError:
            raise
        except Exception as error:  # noqa: BLE001 - a file system may raise anything
            raise self._unusable(error) from None

    def _unusable(self, error: Exception) -> StoreError:
        return unusable("store", self._address, error)


def file_system(address: str) -> tuple[Any, str]:
    """fsspec's file system of an address, and the address as that names it; raises whatever a file system raises."""
    files, root = fsspec.core.url_to_fs(address, **_options(address))
    if address.startswith(_S3):
        files.retries = _READS
    return files, str(root).rstrip("/")


def unusable(what: str, address: str, error: Exception) -> StoreError:
    """What a file system raised, in a sentence.

    Args:
        what: What is kept at the address, such as `store`.
    """
    found = f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]
    if isinstance(error, FileNotFoundError):
        right = "make the bucket, or correct the address"
    elif isinstance(error, PermissionError) or "Credential" in type(error).__name__:
        right = "check the credentials (AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE) and their rights"
    elif isinstance(error, ImportError):
        right = "install what it names, or give a folder or s3://bucket/prefix"
    elif isinstance(error, ValueError):
        right = "give a folder, or an address such as s3://bucket/prefix"
    else:
        right = "check the network and the server (AWS_ENDPOINT_URL); what was finished is kept"
    return StoreError(f"{what}: can't use {address!r} ({found}); {right}")


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
    return {"use_listings_cache": False, "config_kwargs": config, "session": session}


def _expect_nothing(request: Any, **_: Any) -> None:
    """Send an object at once: a client that expects "100 Continue" waits for it without any limit of time (aiohttp)."""
    del request.headers["Expect"]


def _present(key: str, manifest: bytes, files: Mapping[str, _Entry]) -> Artifact:
    """See `vastflow.tasks.store.artifact.present`; `files` are those that are listed."""

    def size_bytes(name: str, entry: FileEntry) -> int:
        if (file := files.get(_object(name, entry))) is None:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
        return int(file["size"])

    return present(key, manifest, size_bytes)


def _object(name: str, entry: FileEntry) -> str:
    """What a file of an artifact is called in its folder."""
    return f"{entry.sha256[:_NAMED_DIGITS]}-{name}"


def _folders(listed: Mapping[str, _Entry]) -> dict[str, dict[str, _Entry]]:
    """Folder to its files by name."""
    folders: dict[str, dict[str, _Entry]] = {}
    for path, file in listed.items():
        folder, _, name = path.rpartition("/")
        folders.setdefault(folder, {})[name] = file
    return folders


def _written_s(file: _Entry) -> float:
    """When a file was written, under whatever name its file system has that; now where it doesn't say."""
    written = next((file[name] for name in ("LastModified", "mtime", "updated", "created") if name in file), None)
    if isinstance(written, str):
        written = datetime.fromisoformat(written)
    if written is None:
        written = datetime.now()
    return written.timestamp() if isinstance(written, datetime) else float(written)
