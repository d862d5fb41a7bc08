"""The store at an address: S3, or whatever else fsspec reads and writes.

Nothing can be moved into place there. The files of an artifact are written first and its manifest last, which makes it
exist. A file's name has its digest in it: two writers of one key never mix what they wrote.
"""

import contextlib
import logging
import uuid
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

import fsspec
import platformdirs

from vastflow.sim.digest import digest
from vastflow.tasks.manifest_copies import ManifestCopies
from vastflow.tasks.store import (
    MANIFEST,
    STAGES,
    Artifact,
    FileEntry,
    Holding,
    Lost,
    StoreError,
    artifact_fault,
    artifact_of,
    entry_of,
    manifest_of,
)
from vastflow.tasks.survey import Survey

LOGGER: Final = logging.getLogger("vastflow.store")

_NAMED_DIGITS: Final = 16
_MANIFESTS_AT_A_TIME: Final = 2000
_LISTINGS: Final = 20
"""Of more folders than this one listing of everything is cheaper."""

P = ParamSpec("P")
T = TypeVar("T")


class ObjectStore:
    """A store at an address. It may be sent to another process, without what it surveyed.

    Args:
        address: Such as `s3://bucket/prefix`.
    """

    def __init__(self, address: str) -> None:
        self._address = address.rstrip("/")
        self._survey: Survey | None = None
        self._copies: ManifestCopies | None = None
        self._opened: tuple[Any, str] | None = None

    def __reduce__(self) -> tuple[type["ObjectStore"], tuple[str]]:
        return ObjectStore, (self._address,)

    @property
    def place(self) -> str:
        """See `Store.place`."""
        return self._address

    @property
    def local(self) -> Path:
        """A folder of this address in the user's cache folder."""
        return Path(platformdirs.user_cache_dir("vastflow"), "stores", digest(self._address)[:_NAMED_DIGITS])

    def survey(self) -> None:
        """One listing of everything, and the manifests that this machine has not read before."""
        listed = self._listed("")
        whole = {key: files for key, files in _folders(listed).items() if MANIFEST in files}
        manifests = self._manifests({key: files[MANIFEST] for key, files in whole.items()})
        found = [self._surveyed(key, manifests[key], files) for key, files in whole.items() if key in manifests]
        self._survey = Survey(artifact for artifact in found if artifact is not None)

    def changed(self, key: str) -> None:
        """See `Store.changed`."""
        if self._survey is not None:
            self._survey.changed(key)

    def find(self, key: str) -> Artifact | None:
        """See `Store.find`."""
        if self._survey is not None and self._survey.knows(key):
            return self._survey.find(key)
        artifact = self._look(key)
        if artifact is not None and self._survey is not None:
            self._survey.add(artifact)
        return artifact

    def under(self, key: str) -> tuple[str, ...]:
        """See `Store.under`."""
        if self._survey is not None and self._survey.knows_under(key):
            return self._survey.under(key)
        folders = _folders(self._listed(key))
        return tuple(sorted(name for name, files in folders.items() if MANIFEST in files and "/" not in name and name))

    def load(self, artifact: Artifact, name: str) -> bytes:
        """See `Store.load`."""
        entry = artifact.files[name]
        try:
            content = self._get(f"{artifact.key}/{_object(name, entry)}")
        except FileNotFoundError:
            self.discard(artifact.key, f"{name} is missing")
            raise Lost(f"{artifact.key}: {name} went away") from None
        if entry_of(content) != entry:
            self.discard(artifact.key, f"{name} is not what was written")
            raise Lost(f"{artifact.key}: {name} is damaged")
        return content

    def read(self, key: str, name: str) -> bytes:
        """See `Store.read`."""
        artifact = self.find(key)
        if artifact is None or name not in artifact.files:
            raise Lost(f"{key}: {name} is not in the store")
        return self.load(artifact, name)

    def beside(self, key: str, name: str) -> bytes | None:
        """See `Store.beside`."""
        try:
            return self._get(f"{key}/{name}")
        except FileNotFoundError:
            return None

    def put(
        self,
        key: str,
        files: Mapping[str, bytes],
        info: Mapping[str, Any] | None = None,
        sidecar: Mapping[str, bytes] | None = None,
    ) -> Artifact:
        """See `Store.put`."""
        kept = self._sound(key)
        if kept is None:
            entries = {name: entry_of(content) for name, content in files.items()}
            kept = Artifact(key, entries, dict(info or {}))
            written = {_object(name, entries[name]): content for name, content in files.items()}
            contents = {f"{key}/{name}": content for name, content in {**(sidecar or {}), **written}.items()}
            self._write(contents)
            self._write({f"{key}/{MANIFEST}": manifest_of(kept)})
        if self._survey is not None:
            self._survey.add(kept)
        return kept

    def discard(self, key: str, why: str) -> None:
        """See `Store.discard`."""
        LOGGER.warning("%s is damaged and will be computed again: %s", key, why)
        self.remove([key])

    def holdings(self) -> list[Holding]:
        """See `Store.holdings`."""
        found = []
        for key, files in sorted(_folders(self._listed("")).items()):
            if key.partition("/")[0] in STAGES:
                size = sum(int(file["size"]) for file in files.values())
                found.append(Holding(key, size, max(map(_written_s, files.values())), MANIFEST in files))
        return found

    def fault(self, key: str) -> str | None:
        """See `Store.fault`."""
        try:
            artifact = artifact_of(key, self._get(f"{key}/{MANIFEST}"))
        except FileNotFoundError:
            return f"{MANIFEST} is missing"
        except (ValueError, KeyError, TypeError) as error:
            return str(error)
        return artifact_fault(artifact, lambda name: self._get(f"{key}/{_object(name, artifact.files[name])}"))

    def remove(self, keys: Iterable[str]) -> None:
        """See `Store.remove`; the manifests go first."""
        chosen_keys = list(keys)
        if len(chosen_keys) > _LISTINGS:
            folders = _folders(self._listed(""))
            files = [f"{key}/{name}" for key in chosen_keys for name in folders.get(key, ())]
        else:
            files = [f"{key}/{name}" for key in chosen_keys for name in self._listed(key)]
        for last in (True, False):
            if chosen := [self._path(file) for file in files if file.endswith(f"/{MANIFEST}") is last]:
                with contextlib.suppress(FileNotFoundError):  # another process was first
                    self._asked(self._files.rm, chosen)
        if self._survey is not None:
            for key in chosen_keys:
                self._survey.drop(key)

    def probe(self) -> None:
        """Write something and delete it.

        Raises:
            StoreError: that can't be done.
        """
        name = f"temporary/{uuid.uuid4().hex}"
        self._write({name: b"vastflow"})
        self._asked(self._files.rm_file, self._path(name))

    def _look(self, key: str) -> Artifact | None:
        files = self._listed(key)
        if MANIFEST not in files:
            return None
        try:
            manifest = self._get(f"{key}/{MANIFEST}")
        except FileNotFoundError:
            return None
        if self._copies is not None:
            self._copies.add(key, files[MANIFEST], manifest)
        return self._promised(key, manifest, files)

    def _surveyed(self, key: str, manifest: bytes, files: Mapping[str, Mapping[str, Any]]) -> Artifact | None:
        """As `_promised`; a long listing may have the manifest of what another campaign wrote meanwhile, and not its files."""
        try:
            return _kept(key, manifest, files)
        except (ValueError, KeyError, TypeError):
            return self._look(key)

    def _promised(self, key: str, manifest: bytes, files: Mapping[str, Mapping[str, Any]]) -> Artifact | None:
        """The artifact of a manifest if `files` has what it promises; else it is discarded."""
        try:
            return _kept(key, manifest, files)
        except (ValueError, KeyError, TypeError) as error:
            self.discard(key, str(error))
            return None

    def _sound(self, key: str) -> Artifact | None:
        if (artifact := self._look(key)) is None:
            return None
        try:
            for name in artifact.files:
                self.load(artifact, name)
        except Lost:
            return None
        return artifact

    def _manifests(self, files: Mapping[str, Mapping[str, Any]]) -> dict[str, bytes]:
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

    def _listed(self, key: str) -> dict[str, Mapping[str, Any]]:
        """What lies below `key`, by path from there."""
        below = self._path(key).rstrip("/") + "/"
        try:
            found = self._asked(self._files.find, below, detail=True)
        except FileNotFoundError:
            return {}
        return {path[len(below) :]: file for path, file in found.items() if path.startswith(below)}

    def _get(self, name: str) -> bytes:
        content: bytes = self._asked(self._files.cat_file, self._path(name))
        return content

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


def open_object_store(address: str) -> ObjectStore:
    """The store at an address.

    Raises:
        StoreError: it can't be written.
    """
    if address.startswith("memory:"):
        raise StoreError(f"store: found {address!r}, which no other process sees; a folder, or s3://bucket/prefix")
    store = ObjectStore(address)
    store.probe()
    return store


def file_system(address: str) -> tuple[Any, str]:
    """fsspec's file system of an address, and the address as that names it; raises whatever a file system raises."""
    files, root = fsspec.core.url_to_fs(address, **_options(address))
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
    if not address.startswith(("s3:", "s3a:")):
        return {}
    import s3fs  # noqa: F401 - fsspec finds it by itself, but says less when it is not there

    # Servers other than Amazon's know neither the checksums nor the signature that newer clients send.
    config = {
        "signature_version": "s3v4",
        "request_checksum_calculation": "when_required",
        "response_checksum_validation": "when_required",
        "retries": {"max_attempts": 3, "mode": "standard"},
        "max_pool_connections": 50,
        "connect_timeout": 10,
        "read_timeout": 60,
    }
    return {"use_listings_cache": False, "config_kwargs": config}


def _kept(key: str, manifest: bytes, files: Mapping[str, Mapping[str, Any]]) -> Artifact:
    """The artifact of a manifest whose promise `files` keeps.

    Raises:
        ValueError, KeyError, TypeError: they do not, or the manifest is not what was written.
    """
    artifact = artifact_of(key, manifest)
    for name, entry in artifact.files.items():
        if (file := files.get(_object(name, entry))) is None:
            raise ValueError(f"{name} is missing")
        if file["size"] != entry.size:
            raise ValueError(f"{name} has {file['size']} of {entry.size} bytes")
    return artifact


def _object(name: str, entry: FileEntry) -> str:
    """What a file of an artifact is called in its folder."""
    return f"{entry.sha256[:_NAMED_DIGITS]}-{name}"


def _folders(listed: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Mapping[str, Any]]]:
    """Folder to its files by name."""
    folders: dict[str, dict[str, Mapping[str, Any]]] = {}
    for path, file in listed.items():
        folder, _, name = path.rpartition("/")
        folders.setdefault(folder, {})[name] = file
    return folders


def _written_s(file: Mapping[str, Any]) -> float:
    """When a file was written, under whatever name its file system has that; now where it doesn't say."""
    written = next((file[name] for name in ("LastModified", "mtime", "updated", "created") if name in file), None)
    if isinstance(written, str):
        written = datetime.fromisoformat(written)
    if written is None:
        written = datetime.now()
    return written.timestamp() if isinstance(written, datetime) else float(written)
