"""The files a run is given: patterns below the campaign's folder, resolved to contents and copied to where it works."""

import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Final

from vastflow.sim.digest import FileContent, file_digest
from vastflow.sim.process.setup import RunFiles

_NEVER: Final = "__pycache__"
"""Compiled modules differ from machine to machine; no run needs them."""
_ANY_FOLDERS: Final = r"(?:(?!\.)[^/]+/)*"


class RunFileError(ValueError):
    """A pattern that can't be used, or a file that isn't what it was when the scenario was made."""


def files_matching(
    folder: Path, patterns: Sequence[str], leave_out: Callable[[Path], bool] = lambda folder: False
) -> RunFiles:
    """The files below `folder` that match one of `patterns`, by path.

    `*` and `?` match within a name, `[abc]` one character, `**` any number of folders or, as the last part, everything
    below. A pattern without `/` also matches the name of a file in any folder. Names that begin with a dot are matched
    by a dot only. Folders that are links are not entered; a link to a file is the file.

    Args:
        leave_out: Says of a folder below `folder` whether it is not entered either.

    Raises:
        RunFileError: an absolute pattern, or one that leaves `folder`.
    """
    tests = [_pattern(pattern) for pattern in patterns]
    matching = sorted(path for path in _paths(folder, leave_out) if any(test.fullmatch(path) for test in tests))
    return tuple((path, FileContent(str(folder / path), file_digest(folder / path))) for path in matching)


def unmatched(files: RunFiles, patterns: Sequence[str]) -> tuple[str, ...]:
    """Those of `patterns` that none of `files` matches: slips, most likely."""
    return tuple(
        pattern for pattern in patterns if not any(_pattern(pattern).fullmatch(path) for path, _content in files)
    )


def copy_in(files: RunFiles, folder: Path) -> None:
    """Copy `files` below `folder`, executable where they were.

    Raises:
        RunFileError: a file is gone, or holds something else than when it was resolved.
    """
    for path, content in files:
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            shutil.copy2(content.path, target)
        except OSError as error:
            raise RunFileError(f"run file {content.path!r} can't be copied: {error.strerror}") from None
        if file_digest(target) != content.digest:
            raise RunFileError(f"run file {content.path!r} changed since the campaign was read; run it again")
        target.chmod(target.stat().st_mode | 0o200)


def _paths(folder: Path, leave_out: Callable[[Path], bool]) -> Iterator[str]:
    for parent, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if name != _NEVER and not leave_out(Path(parent, name))]
        for name in names:
            path = Path(parent, name)
            if path.is_file():
                yield path.relative_to(folder).as_posix()


def _pattern(pattern: str) -> re.Pattern[str]:
    parts = PurePosixPath(pattern).parts
    if not parts or parts[0] == "/" or ".." in parts:
        raise RunFileError(f"found run_files pattern {pattern!r}; a pattern below the campaign file's folder")
    if len(parts) == 1 and parts[0] != "**":
        parts = ("**", *parts)
    texts = [_ANY_FOLDERS if part == "**" else _name(part) + "/" for part in parts[:-1]]
    texts.append(_ANY_FOLDERS + _name("*") if parts[-1] == "**" else _name(parts[-1]))
    try:
        return re.compile("".join(texts), re.DOTALL)
    except re.error:
        raise RunFileError(f"found run_files pattern {pattern!r}; a range such as [a-c] goes upwards") from None


def _name(part: str) -> str:
    """One part of a path as a regular expression."""
    text, i = "" if part.startswith(".") else r"(?!\.)", 0
    while i < len(part):
        letter, i = part[i], i + 1
        closing = part.find("]", i + 1 + (part[i : i + 1] == "!")) if letter == "[" else -1
        if closing > 0:
            members = part[i:closing].replace("\\", r"\\").replace("^", r"\^").replace("[", r"\[")
            text += f"[^/{members[1:]}]" if members.startswith("!") else f"(?!/)[{members}]"
            i = closing + 1
        else:
            text += {"*": "[^/]*", "?": "[^/]"}.get(letter, re.escape(letter))
    return text
