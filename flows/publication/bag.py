"""Bags (BagIt, RFC 8493) in zip archives: written with equal bytes for equal content, and read within limits."""

import filecmp
import hashlib
import io
import os
import re
import shutil
import stat
import tempfile
import uuid
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final

from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import Unreadable, open_file
from vastflow.tasks.store.artifact import FileEntry, inside

MANIFEST: Final = "manifest-sha256.txt"
TAG_MANIFEST: Final = "tagmanifest-sha256.txt"
DECLARATION: Final = "bagit.txt"
PAYLOAD: Final = "data/"
_DECLARED: Final = b"BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n"
_LONG_AGO: Final = (1980, 1, 1, 0, 0, 0)
_PACKED: Final = (".parquet", ".png", ".mp4", ".zip", ".jpg", ".gif")
"""Files that are compressed already."""
_CHUNK: Final = 1 << 20

MOST_ENTRIES: Final = 2_000_000
MOST_MANIFEST_BYTES: Final = 256 * 2**20
MOST_GROWTH: Final = 200
"""Times an archive's size that its content may have; zip bombs have thousands."""
_FREE_BYTES: Final = 64 * 2**20
"""Unpacked size of a small archive, whatever its own."""
_LINE: Final = re.compile(r"([0-9a-fA-F]{64})[ \t]+\*?(.+)")


class UnusableArchive(UserError, ValueError):
    """An archive can't be checked; the message says why in one sentence."""


def write_bag(archive: Path, top: str, payload: Mapping[str, bytes | Path], info: Mapping[str, str]) -> None:
    """Write a new archive of a bag at once.

    Args:
        top: Name of its only folder.
        payload: Place below `data/` to content.
        info: Lines of `bag-info.txt` beside the size of the payload.

    Raises:
        UserError: a file changed meanwhile, or the archive exists with other bytes.
        OSError: the archive can't be written.
    """
    entries = {f"{PAYLOAD}{place}": measured(content) for place, content in payload.items()}
    oxum = {"Payload-Oxum": f"{sum(each.size for each in entries.values())}.{len(entries)}"}
    lines = "".join(f"{key}: {' '.join(value.split())}\n" for key, value in {**info, **oxum}.items())
    tags = {DECLARATION: _DECLARED, "bag-info.txt": lines.encode(), MANIFEST: _manifest(entries)}
    tags[TAG_MANIFEST] = _manifest({name: measured(content) for name, content in tags.items()})
    contents: dict[str, bytes | Path] = {**tags, **{f"{PAYLOAD}{place}": content for place, content in payload.items()}}
    partial = archive.with_name(f".{uuid.uuid4().hex}")
    try:
        with zipfile.ZipFile(partial, "x") as written:
            for name, content in sorted(contents.items()):
                info_of_entry = zipfile.ZipInfo(f"{top}/{name}", _LONG_AGO)
                info_of_entry.create_system, info_of_entry.external_attr = 3, (stat.S_IFREG | 0o644) << 16
                info_of_entry.compress_type = zipfile.ZIP_STORED if name.endswith(_PACKED) else zipfile.ZIP_DEFLATED
                expected = entries[name] if name in entries else measured(content)
                info_of_entry.file_size = expected.size
                with opened(content) as source, written.open(info_of_entry, "w") as target:
                    if copied(source, target) != expected:
                        raise UserError(f"{name}: It changed while it was published. Try again.")
        if archive.exists() and not filecmp.cmp(partial, archive, shallow=False):
            raise UserError(f"{archive}: expected a new file, or the archive of these results, got another one")
        partial.replace(archive)
    finally:
        with suppress(OSError):
            partial.unlink()


def opened(content: bytes | Path) -> IO[bytes]:
    """Open a content, which a file has or which is given."""
    return io.BytesIO(content) if isinstance(content, bytes) else open_file(content)


def measured(content: bytes | Path) -> FileEntry:
    """Return digest and size of a content."""
    with opened(content) as source:
        return copied(source)


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

    def read(self, name: str, most_bytes: int = MOST_MANIFEST_BYTES) -> bytes:
        """Return the content of a file; raises `UnusableArchive` if it is missing, damaged, or too large."""
        if name not in self.files:
            raise UnusableArchive(f"{self.archive.filename}: expected a bag of BagIt, got an archive without {name}")
        if (size := self.files[name].file_size) > most_bytes:
            what = f"{name}: expected at most {most_bytes:,} bytes, got {size:,}"
            raise UnusableArchive(f"{self.archive.filename}: {what}")
        try:
            return self.archive.read(self.files[name])
        except _DAMAGE as error:
            raise UnusableArchive(f"{self.archive.filename}: {name} is damaged: {error}") from None

    def manifest(self, name: str) -> dict[str, str]:
        """Return the SHA-256 of each file that a manifest lists; raises as `read`, and for another text."""
        listed: dict[str, str] = {}
        try:
            for line in self.read(name).decode().splitlines():
                found = _LINE.fullmatch(line)
                if found is None or found[2] in listed:
                    wrong = "a file twice" if found else repr(line[:60])
                    raise UnusableArchive(
                        f"{self.archive.filename}: {name}: expected a SHA-256 and a file in each line, got {wrong}"
                    )
                place = re.sub("%(0A|0D|25)", lambda each: chr(int(each[1], 16)), found[2], flags=re.IGNORECASE)
                listed[place] = found[1].lower()
        except UnicodeDecodeError:
            raise UnusableArchive(
                f"{self.archive.filename}: {name}: expected a text in UTF-8, got other bytes"
            ) from None
        return listed

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


_DAMAGE: Final = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError)
"""What a damaged or an encrypted file of an archive raises."""


@contextmanager
def opened_bag(archive: Path) -> Iterator[Bag]:
    """Open a stranger's archive without unpacking anything.

    Raises:
        UnusableArchive: it is no archive, or it has links, absolute or repeated names, too many files, or too much in them.
    """
    with ExitStack() as stack:
        try:
            file = stack.enter_context(open_file(archive, "an archive that `vastflow publish` wrote"))
            size = os.fstat(file.fileno()).st_size
            opened_archive = stack.enter_context(zipfile.ZipFile(file))
        except Unreadable as error:
            raise UnusableArchive(f"{archive}: {error}") from None
        except (zipfile.BadZipFile, ValueError, OSError, NotImplementedError, MemoryError) as error:
            raise UnusableArchive(
                f"{archive}: expected an archive that `vastflow publish` wrote, got {error}"
            ) from None
        try:
            files = _files_of(opened_archive, size)
        except ValueError as error:
            raise UnusableArchive(f"{archive}: {error}") from None
        opened_archive.filename = str(archive)
        yield Bag(opened_archive, files)


def _files_of(archive: zipfile.ZipFile, size: int) -> dict[str, zipfile.ZipInfo]:
    entries = [each for each in archive.infolist() if not each.is_dir()]
    if len(entries) > MOST_ENTRIES:
        raise ValueError(f"expected at most {MOST_ENTRIES:,} files, got {len(entries):,}")
    unpacked, most = sum(each.file_size for each in entries), MOST_GROWTH * size + _FREE_BYTES
    if unpacked > most:
        raise ValueError(f"expected at most {most:,} bytes when unpacked, got {unpacked:,}: a zip bomb")
    tops = {each.filename.partition("/")[0] for each in entries}
    if len(tops) > 1 or not entries:
        raise ValueError(f"expected one folder in the archive, got {len(tops)}")
    files: dict[str, zipfile.ZipInfo] = {}
    for each in entries:
        name = each.filename
        inside(Path(), name)
        if "\\" in name or "" in name.split("/") or "." in name.split("/"):
            raise ValueError(f"expected a path inside the folder, got {name!r:.100}")
        if not stat.S_ISREG(mode := each.external_attr >> 16) and stat.S_IFMT(mode):
            raise ValueError(f"expected files alone, got a link or a device: {name!r:.100}")
        _, _, below = name.partition("/")
        if below in files or not below:
            raise ValueError(
                f"expected each file once, got {name!r:.100} twice" if below else f"got a file {name!r:.100}"
            )
        files[below] = each
    folders = {below[:k] for below in files for k, letter in enumerate(below) if letter == "/"}
    if both := folders & files.keys():
        raise ValueError(f"expected a file or a folder, got both: {min(both)!r:.100}")
    return files


@contextmanager
def scratch_folder(bag: Bag) -> Iterator[Path]:
    """A temporary folder with room for what a bag holds; raises `UnusableArchive` if the disk has not."""
    needed = sum(each.file_size for each in bag.files.values())
    with tempfile.TemporaryDirectory(prefix="vastflow-") as folder:
        if (free := shutil.disk_usage(folder).free) < needed:
            what = f"expected {needed:,} bytes of room in {Path(folder).parent}, got {free:,}. Set TMPDIR to another folder."
            raise UnusableArchive(f"{bag.archive.filename}: {what}")
        yield Path(folder)
