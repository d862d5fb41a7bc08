"""Bags (BagIt, RFC 8493) in zip archives: written with equal bytes for equal content, and read within limits."""

import filecmp
import hashlib
import io
import os
import re
import stat
import uuid
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO, Final

from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import open_file
from vastflow.tasks.store.artifact import FileEntry

MANIFEST: Final = "manifest-sha256.txt"
TAG_MANIFEST: Final = "tagmanifest-sha256.txt"
PAYLOAD: Final = "data/"
_DECLARED: Final = b"BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n"
_LONG_AGO: Final = (1980, 1, 1, 0, 0, 0)
_PACKED: Final = (".parquet", ".png", ".mp4", ".zip", ".jpg", ".gif")
"""Files that are compressed already."""
_CHUNK: Final = 1 << 20

MOST_MANIFEST_BYTES: Final = 256 * 2**20
MOST_GROWTH: Final = 200
"""Times an archive's size that its content may have; zip bombs have thousands."""
_FREE_BYTES: Final = 64 * 2**20
"""Unpacked size of a small archive, whatever its own."""
_LINE: Final = re.compile(r"([0-9a-fA-F]{64})[ \t]+\*?(.+?)\r?", re.DOTALL)
_DAMAGE: Final = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError)
"""What a damaged or an encrypted file of an archive raises."""


def write_bag(
    archive: Path,
    top: str,
    payload: Mapping[str, bytes | Path],
    entries: Mapping[str, FileEntry],
    info: Mapping[str, str],
) -> None:
    """Write an archive of a bag at once.

    Args:
        top: Name of its only folder.
        payload: Place below `data/` to content.
        entries: Digest and size of each.
        info: Lines of `bag-info.txt` beside the size of the payload.

    Raises:
        UserError: a file changed meanwhile, or the archive exists with other bytes.
        OSError: the archive can't be written.
    """
    listed = {f"{PAYLOAD}{place}": entries[place] for place in payload}
    oxum = {"Payload-Oxum": f"{sum(each.size for each in listed.values())}.{len(listed)}"}
    lines = "".join(f"{key}: {' '.join(value.split())}\n" for key, value in {**info, **oxum}.items())
    tags = {"bagit.txt": _DECLARED, "bag-info.txt": lines.encode(), MANIFEST: _manifest(listed)}
    tags[TAG_MANIFEST] = _manifest({name: measured(content) for name, content in tags.items()})
    contents = {**{f"{PAYLOAD}{place}": content for place, content in payload.items()}, **tags}
    unfinished = archive.with_name(f".{uuid.uuid4().hex}")
    try:
        with zipfile.ZipFile(unfinished, "x") as written:
            for name, content in sorted(contents.items()):
                entry = zipfile.ZipInfo(f"{top}/{name}", _LONG_AGO)
                entry.create_system, entry.external_attr = 3, (stat.S_IFREG | 0o644) << 16
                entry.compress_type = zipfile.ZIP_STORED if name.endswith(_PACKED) else zipfile.ZIP_DEFLATED
                with written.open(entry, "w", force_zip64=True) as target:
                    if (found := measured(content, target)) != listed.get(name, found):
                        raise UserError(f"{name}: It changed while it was published. Try again.")
        if archive.exists() and not filecmp.cmp(unfinished, archive, shallow=False):
            raise UserError(f"{archive}: expected a new file, or the archive of these results, got another one")
        unfinished.replace(archive)
    finally:
        with suppress(OSError):
            unfinished.unlink()


def measured(content: bytes | Path, target: IO[bytes] | None = None) -> FileEntry:
    """Return digest and size of a file or a text, and copy it to a `target`, if any."""
    with io.BytesIO(content) if isinstance(content, bytes) else open_file(content) as source:
        return copied(source, target)


def copied(source: IO[bytes], target: IO[bytes] | None = None) -> FileEntry:
    """Copy to `target`, if any, and return digest and size."""
    hashed, size = hashlib.sha256(), 0
    while chunk := source.read(_CHUNK):
        hashed.update(chunk)
        size += len(chunk)
        if target is not None:
            target.write(chunk)
    return FileEntry(hashed.hexdigest(), size)


def _manifest(entries: Mapping[str, FileEntry]) -> bytes:
    escaped = {name: name.replace("%", "%25").replace("\n", "%0A").replace("\r", "%0D") for name in entries}
    return "".join(f"{entries[name].sha256}  {escaped[name]}\n" for name in sorted(entries)).encode()


@dataclass(frozen=True)
class Bag:
    """An archive that was opened, with the names of its files checked."""

    archive: zipfile.ZipFile = field(repr=False)
    files: Mapping[str, zipfile.ZipInfo] = field(repr=False)

    def manifest(self, name: str) -> dict[str, str]:
        """Return the SHA-256 of each file that a manifest lists; raises `UserError` if it is missing, damaged, or no manifest."""
        try:
            if self.files[name].file_size > MOST_MANIFEST_BYTES:
                raise ValueError(f"expected at most {MOST_MANIFEST_BYTES:,} bytes")
            lines = self.archive.read(self.files[name]).decode(errors="replace").removesuffix("\n").split("\n")
            found = [_LINE.fullmatch(line) or line for line in lines]
            if wrong := [each for each in found if isinstance(each, str)]:
                raise ValueError(f"expected a SHA-256 and a file in each line, got {wrong[0][:60]!r}")
        except (*_DAMAGE, KeyError, ValueError) as error:
            words = f"a bag without {name}" if isinstance(error, KeyError) else f"{name}: {error}"
            raise UserError(f"{self.archive.filename}: {words}") from None
        unescaped = partial(re.sub, "%(0A|0D|25)", lambda each: chr(int(each[1], 16)), flags=re.IGNORECASE)
        return {unescaped(each[2]): each[1].lower() for each in found}

    def measured(self, name: str, target: Path | None = None) -> FileEntry | None:
        """Return digest and size of a file that may be copied to a `target`; None where it is damaged."""
        try:
            with ExitStack() as stack:
                source = stack.enter_context(self.archive.open(self.files[name]))
                if target is not None:
                    target.parent.mkdir(parents=True, exist_ok=True)
                return copied(source, None if target is None else stack.enter_context(target.open("xb")))
        except _DAMAGE:
            return None


@contextmanager
def opened_bag(archive: Path) -> Iterator[Bag]:
    """Open a stranger's archive without unpacking anything.

    Raises:
        UserError: it is no archive, or it has links, absolute or repeated names, or too much in it.
    """
    with ExitStack() as stack:
        try:
            file = stack.enter_context(open_file(archive))
            found = stack.enter_context(zipfile.ZipFile(file))
            files = _files_of(found, os.fstat(file.fileno()).st_size)
        except (zipfile.BadZipFile, ValueError, OSError, NotImplementedError, MemoryError) as error:
            raise UserError(f"{archive}: expected an archive of `vastflow publish`: {error}") from None
        found.filename = str(archive)
        yield Bag(found, files)


def _files_of(archive: zipfile.ZipFile, size: int) -> dict[str, zipfile.ZipInfo]:
    entries = [each for each in archive.infolist() if not each.is_dir()]
    unpacked, most = sum(each.file_size for each in entries), MOST_GROWTH * size + _FREE_BYTES
    if unpacked > most:
        raise ValueError(f"a zip bomb of {unpacked:,} bytes")
    if len(tops := {each.filename.partition("/")[0] for each in entries}) != 1:
        raise ValueError(f"it has {len(tops)} folders in place of one")
    files: dict[str, zipfile.ZipInfo] = {}
    for each in entries:
        _, _, below = each.filename.partition("/")
        if "\\" in below or not {"", ".", ".."}.isdisjoint(each.filename.split("/")):
            raise ValueError(f"{each.filename!r:.100} is no path inside the folder")
        if stat.S_IFMT(each.external_attr >> 16) not in (0, stat.S_IFREG):
            raise ValueError(f"{each.filename!r:.100} is a link or a device")
        if not below or below in files:
            raise ValueError(f"{each.filename!r:.100} is there twice, or no file in the folder")
        files[below] = each
    if below_files := [name for name in files if not files.keys().isdisjoint(map(str, PurePosixPath(name).parents))]:
        raise ValueError(f"{below_files[0]!r:.100} lies below a file")
    return files
