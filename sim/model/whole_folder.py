"""Folders of files that appear whole, whoever writes them first."""

import shutil
import uuid
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path


def keep_folder(folder: Path, contents: Mapping[str, bytes], beside: Mapping[str, bytes] | None = None) -> bool:
    """Write a folder of these files, unless it is there, whole; return whether it was written.

    Args:
        contents: Place in the folder to content.
        beside: More files that are written, and not compared with what is there.

    Raises:
        OSError: it can't be written.
    """
    beside = beside or {}
    if _is_whole(folder, contents, beside):
        return False
    prepared = folder.with_name(f".{uuid.uuid4().hex}")
    try:
        for place, content in {**contents, **beside}.items():
            file = prepared / place
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        for _ in range(3):
            with suppress(OSError):  # another process was first, or something damaged lies there
                prepared.rename(folder)
                return True
            if _is_whole(folder, contents, beside):
                return False
            damaged = folder.with_name(f".{uuid.uuid4().hex}")
            with suppress(OSError):
                folder.rename(damaged)
            shutil.rmtree(damaged, ignore_errors=True)
        prepared.rename(folder)
        return True
    finally:
        shutil.rmtree(prepared, ignore_errors=True)


def _is_whole(folder: Path, contents: Mapping[str, bytes], beside: Mapping[str, bytes]) -> bool:
    try:
        there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
        own = {place for place in there if place not in beside and "__pycache__" not in place}
        return own == contents.keys() and all((folder / place).read_bytes() == contents[place] for place in contents)
    except OSError:
        return False
