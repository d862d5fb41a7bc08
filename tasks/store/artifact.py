"""An artifact: a key's files as its manifest lists them, and the manifest's text."""

import hashlib
import json
import os
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError
from typing_extensions import TypedDict

from vastflow.sim.model.digest import digest
from vastflow.sim.model.faults import UserError

MANIFEST: Final = "manifest"


_USER: Final = re.compile(r"""(?<=://)(?:[^/\s]*|[^/\s:@]*:(?!\d+/)[^\s'"@]*)@""")
"""A password may have a slash in it; what follows the digits of a port is a path."""
_SECRET: Final = re.compile(
    r"""(?i)(?<=[?&])([\w.-]*(?:token|signature|secret|password|credential|key)[\w.-]*=|sig=)[^&\s'"]+"""
)


def redacted(text: str) -> str:
    """Return a text without the users, passwords, and signatures of addresses in it."""
    return _SECRET.sub(r"\1…", _USER.sub("…@", text))


def public_address(address: str) -> str:
    """Return an address without its credentials, which whoever uses it takes from the environment."""
    return re.sub(r"(?<=[?&])&+", "", _SECRET.sub("", _USER.sub("", address))).rstrip("?&")


class StoreError(UserError, OSError):
    """The store's place can't be used."""

    def __init__(self, *said: object) -> None:
        super().__init__(*(redacted(each) if isinstance(each, str) else each for each in said))


class Lost(Exception):
    """An artifact is missing or damaged: it has to be computed again."""


@dataclass(frozen=True, slots=True)
class FileEntry:
    """A file of an artifact as its manifest has it."""

    sha256: str
    size: int


@dataclass(frozen=True, slots=True)
class Artifact:
    """Files under a key, as a manifest promises them.

    Attributes:
        info_json: Small facts of the content, there without reading it; as text, a tenth of the memory of what it says.
    """

    key: str
    files: Mapping[str, FileEntry]
    info_json: str = "{}"

    @property
    def info(self) -> dict[str, Any]:
        return dict(json.loads(self.info_json))

    @property
    def content(self) -> str:
        """Digest of the files' names and contents."""
        return sys.intern(
            digest({name: entry.sha256 for name, entry in self.files.items()})
        )  # blocks and rows have it too


@dataclass(frozen=True, slots=True)
class Holding:
    """All entries below a key.

    Attributes:
        size_bytes: Size of all its files, with manifest and sidecars.
        written_s: When the youngest file was written (s since 1970).
        whole: True if there is a manifest; without one a writer has not finished.
    """

    key: str
    size_bytes: int
    written_s: float
    whole: bool

    @property
    def stage(self) -> str:
        return self.key.partition("/")[0]


def inside(folder: Path, name: str) -> Path:
    """Return the path of `name` in `folder`; names from a store or a campaign directory are not trusted.

    Raises:
        ValueError: it leads out, or to the folder itself.
    """
    parts = name.replace(os.sep, "/").split("/")
    if ".." in parts or parts[0] == "" or parts[-1] in ("", ".") or "\0" in name or os.path.splitdrive(name)[0]:
        raise ValueError(f"expected a path inside the folder, got {name!r}")
    return folder / name


def entry_of(content: bytes) -> FileEntry:
    """Return the manifest's entry for a file."""
    return FileEntry(hashlib.sha256(content).hexdigest(), len(content))


def info_text(info: Mapping[str, Any]) -> str:
    """Return an artifact's facts as `Artifact` has them."""
    return json.dumps(info, sort_keys=True)


def manifest_of(artifact: Artifact) -> bytes:
    """Return two lines: the SHA-256 of the second, and files, info, and key as JSON."""
    files = {name: asdict(entry) for name, entry in artifact.files.items()}
    promise = json.dumps({"files": files, "info": artifact.info, "key": artifact.key}, sort_keys=True).encode()
    return hashlib.sha256(promise).hexdigest().encode() + b"\n" + promise


_Promise = TypedDict("_Promise", {"key": str, "files": dict[str, FileEntry], "info": dict[str, Any]})  # noqa: UP013
_PROMISE: Final = TypeAdapter(_Promise)
_JUDGED: Final = TypeAdapter[Any](list[tuple[int, str]])
_FACTS: Final[Mapping[str, Mapping[str, TypeAdapter[Any]]]] = {
    "execute": {"runs": TypeAdapter(list[tuple[int, float]])},
    "judge": {"runs": _JUDGED, "causes": _JUDGED, "oracles": TypeAdapter(dict[str, str] | None)},
    "rows": {"counted": TypeAdapter(list[tuple[str | None, str, int]]), "stood_still": TypeAdapter(int)},
    "search": {"batches": TypeAdapter(int)},
}
"""Stage to the facts that its readers rely on: a manifest with a right checksum may still be anybody's."""


def artifact_of(key: str, manifest: bytes) -> Artifact:
    """Return the artifact that a manifest promises.

    Raises:
        ValueError: it is not what was written, not under this key, or lacks what the stage's artifacts have.
    """
    hashed, _, promise = manifest.partition(b"\n")
    if hashlib.sha256(promise).hexdigest().encode() != hashed:
        raise ValueError(f"{MANIFEST} is not what was written")
    try:
        body = _PROMISE.validate_json(promise)
        for name, kind in _FACTS.get(key.partition("/")[0], {}).items():
            kind.validate_python(body["info"].get(name))
    except ValidationError as error:
        raise ValueError(f"{MANIFEST} has another shape ({error.errors()[0]['msg']})") from None
    if body["key"] != key:
        raise ValueError(f"it is a copy of {body['key']}")
    for name in body["files"]:
        inside(Path(), name)
    entries = {sys.intern(name): entry for name, entry in body["files"].items()}
    return Artifact(key, entries, sys.intern(info_text(body["info"])))  # of most configurations alike


def present(key: str, manifest: bytes, size_bytes: Callable[[str, FileEntry], int]) -> Artifact:
    """Return the artifact that a manifest promises, if its files have the promised sizes.

    Args:
        size_bytes: Returns the size of a file, or raises FileNotFoundError.

    Raises:
        FileNotFoundError: a file is missing.
        ValueError: a file has another size, or the manifest is damaged.
    """
    artifact = artifact_of(key, manifest)
    for name, entry in artifact.files.items():
        if (found := size_bytes(name, entry)) != entry.size:
            raise ValueError(f"{name} has {found} of {entry.size} bytes")
    return artifact


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive runs of a scenario, recorded.

    Attributes:
        start, stop: First run index and the one after the last.
        content: Content digest of the recordings.
    """

    key: str
    start: int
    stop: int
    content: str


@dataclass(frozen=True, slots=True)
class Stored:
    """Stored artifacts of a block.

    Attributes:
        lacking: Names of the oracles whose verdicts on the trace are in no artifact; None where that is not known.
    """

    block: Block
    recordings: Artifact
    trace: Artifact | None
    verdicts: Artifact | None
    lacking: frozenset[str] | None = None
