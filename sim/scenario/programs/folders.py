"""The folders of a run: `/config` and `/out`, their files, and the mount namespaces that show them."""

import ctypes
import functools
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import Any, Final

import yaml

from vastflow.sim.model.digest import FileContent, file_digest
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.files import Unreadable, copy_file, read_text, yaml_value
from vastflow.sim.model.scenario import RunFiles
from vastflow.sim.world.environment import WORLD_KEY
from vastflow.sim.world.readers.registry import files_of_world
from vastflow.sim.world.world import check_unchanged, world_at

CONFIG: Final = "/config"
"""Folder of the run files, as programs see it."""
_ABOVE: Final = re.compile(r"^(\.\./)+")
OUT: Final = "/out"
"""Folder that programs write to, as they see it."""
_NAMED: Final = re.compile(rb"/(?:config|out)(?![\w-])")
"""May be one of the two names; what only looks like one does no harm."""


@dataclass(frozen=True, slots=True)
class RunFolders:
    """The folders of one run, below its own folder.

    Attributes:
        config: The run files as they were given.
        out: Another copy of them; programs work there, and what they write there is kept.
        logs: Folder of the programs' logs.
    """

    config: Path
    out: Path
    logs: Path

    @classmethod
    def below(cls, folder: Path) -> "RunFolders":
        """Return the folders below `folder` without making them."""
        return cls(folder / "config", folder / "run", folder / "logs")

    @property
    def mounts(self) -> Mapping[str, Path]:
        """Name to folder."""
        return {CONFIG: self.config, OUT: self.out}

    def path(self, name: str) -> Path:
        """Return the path of the file that programs know by `name`; relative names start at `out`."""
        plain = PurePosixPath(os.path.normpath(name))
        for place, folder in self.mounts.items():
            if plain.is_relative_to(place):
                return folder / plain.relative_to(place)
        return self.out / name

    def named_in_files(self) -> bool:
        """Whether a run file has one of the names."""
        return any(_NAMED.search(path.read_bytes()) for path in filter(Path.is_file, self.config.rglob("*")))


def named_in(texts: Sequence[str]) -> bool:
    """True if one of `texts` has one of the names."""
    return any(_NAMED.search(text.encode(errors="surrogateescape")) for text in texts)


def below_config(name: str) -> str | None:
    """Return the path of `name` below the campaign file's folder, or None if it is elsewhere.

    Relative paths are seen from that folder, and none leads out of it.
    """
    plain = PurePosixPath(os.path.normpath(name))
    if plain.is_relative_to(CONFIG):
        plain = plain.relative_to(CONFIG)
    return None if plain.is_absolute() or plain.parts[:1] == ("..",) else plain.as_posix()


def files_matching(
    folder: Path, patterns: Sequence[str], leave_out: Callable[[Path], bool] = lambda folder: False
) -> RunFiles:
    """Return the files below `folder` that match one of `patterns`, by path.

    `*` and `?` match within a name, `[abc]` one character, `**` any number of folders or, as the last part, everything
    below. A pattern without `/` also matches the name of a file in any folder. Names that begin with a dot are matched
    by a dot only. Folders that are links are not entered; a link to a file is the file.

    Args:
        leave_out: Says of a folder below `folder` whether it is not entered either.

    Raises:
        ScenarioError: an absolute pattern, or one that leaves `folder`.
    """
    tests = [_parts(pattern) for pattern in patterns]
    found = {}
    for parent, folders, names in os.walk(folder):
        # Compiled modules differ from machine to machine; no run needs them.
        folders[:] = [name for name in folders if name != "__pycache__" and not leave_out(Path(parent, name))]
        for path in (Path(parent, name) for name in names):
            parts = path.relative_to(folder).parts
            if path.is_file() and any(_matches(parts, test) for test in tests):
                found["/".join(parts)] = FileContent(str(path), file_digest(path))
    return tuple(sorted(found.items(), key=lambda item: item[0]))


def unmatched(files: RunFiles, patterns: Sequence[str]) -> tuple[str, ...]:
    """Return the patterns that match no file."""
    paths = [path.split("/") for path, _content in files]
    return tuple(pattern for pattern in patterns if not any(_matches(path, _parts(pattern)) for path in paths))


def copy_in(files: RunFiles, folder: Path) -> None:
    """Copy `files`, with their executable bits, below `folder`; ScenarioError for a missing or changed one."""
    for path, content in files:
        target = folder / path
        try:
            copy_file(content.path, target)
            shutil.copystat(content.path, target)
        except (OSError, Unreadable) as error:
            reason = error.problem if isinstance(error, Unreadable) else error.strerror
            raise ScenarioError(f"run file {content.path!r} can't be copied: {reason}") from None
        if file_digest(target) != content.digest:
            raise ScenarioError(f"run file {content.path!r} changed since the campaign was read. Run it again.")
        target.chmod(target.stat().st_mode | 0o200)


def _parts(pattern: str) -> tuple[str, ...]:
    """Return the parts of a pattern; the last one matches the file's name."""
    parts = PurePosixPath(pattern).parts
    if not parts or parts[0] == "/" or ".." in parts:
        raise ScenarioError(f"expected a pattern below the campaign file's folder, got run_files pattern {pattern!r}")
    parts = parts if parts[-1] != "**" else (*parts, "*")
    return parts if len(parts) > 1 else ("**", *parts)


def _matches(names: Sequence[str], parts: Sequence[str]) -> bool:
    if not names or not parts:
        return not names and not parts
    (name, *further), (part, *rest) = names, parts
    if part == "**" and _matches(names, rest):
        return True
    hidden = name.startswith(".") and not part.startswith(".")
    return not hidden and fnmatchcase(name, part) and _matches(further, parts if part == "**" else rest)


def handed_name(key: str, content: FileContent) -> str:
    """Return the path of the file under `key`, relative to `/config` and to the programs' folder."""
    suffix = Path(content.path).suffix.lower()
    return f"{key}/{content.digest[:12]}{'.yaml' if suffix == '.yml' else suffix}"


def hand_over(handed: Mapping[str, FileContent], folder: Path) -> None:
    """Copy the files by key below `folder`, a map with its picture, a world with what it includes.

    Raises:
        ScenarioError: one is gone, a map or world changed since the campaign was read, or its files can't lie in one folder.
    """
    for key, content in handed.items():
        source, target = Path(content.path), folder / handed_name(key, content)
        try:
            header = _map_header(source)
            if header is None:
                copy_file(source, target)
                included = files_of_world(source)[1:] if key == WORLD_KEY else ()
                for file in included:  # a folder of models beside the world's is looked for in its own, too
                    copy_file(file, target.parent / _ABOVE.sub("", os.path.relpath(file, source.parent)))
                if included:
                    check_unchanged(content, world_at(target))
                continue
            picture = source.parent / header["image"]
            copied = target.with_suffix(picture.suffix)
            copy_file(picture, copied)
            target.write_text(yaml.safe_dump({**header, "image": copied.name}), encoding="utf-8")
            check_unchanged(content, world_at(target))
        except (OSError, ValueError) as error:
            raise ScenarioError(f"{key}: {content.path!r} can't be copied: {error}") from None


def _map_header(source: Path) -> dict[str, Any] | None:
    """Return the content of a map's YAML file, or None for another file."""
    if source.suffix.lower() not in (".yaml", ".yml"):
        return None
    try:
        header = yaml_value(read_text(source))
    except Unreadable as error:
        raise ScenarioError(f"{str(source)!r}: {error}") from None
    return header if isinstance(header, dict) and isinstance(header.get("image"), str) else None


BUBBLEWRAP: Final = "bwrap"


@dataclass(frozen=True)
class MountNamespace:
    """A mount namespace, and the user namespace it belongs to where that is not this process' own.

    Attributes:
        descriptors: Open files of both, in the order in which a process joins them; the namespaces last as long.
    """

    descriptors: tuple[int, ...]

    @classmethod
    def of(cls, mounts: Mapping[str, Path]) -> "MountNamespace":
        """Make a namespace with the machine's folders and `mounts`, each at its path below `/`.

        Its root folder is read-only, so that files written beside the folders are not lost silently.

        Raises:
            OSError: bubblewrap is missing, or may not make namespaces here.
        """
        options = []
        for entry in os.scandir("/"):
            if entry.is_symlink():
                options += ["--symlink", os.readlink(entry.path), entry.path]
            elif entry.path not in mounts:
                options += ["--dev-bind", entry.path, entry.path]
        for path, folder in mounts.items():
            options += ["--dev-bind", str(folder), path]
        try:
            return cls._made(options)
        except OSError:  # a root user who may not mount; bubblewrap does this by itself for others
            return cls._made([*options, "--unshare-user"])

    @classmethod
    def _made(cls, options: Sequence[str]) -> "MountNamespace":
        command = [BUBBLEWRAP, *options, "--remount-ro", "/", "sh", "-c", "echo $$; read _"]
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as holder:
            assert holder.stdout is not None and holder.stderr is not None
            pid = holder.stdout.readline().strip()
            if not pid:
                raise OSError(holder.stderr.read().strip())
            users = Path("/proc", pid, "ns", "user")
            own = [] if users.samefile("/proc/self/ns/user") else [users]
            return cls(tuple(os.open(each, os.O_RDONLY) for each in [*own, users.with_name("mnt")]))

    def join(self, folder: Path) -> None:
        """Move this process, which has one thread, into the namespace and to `folder`."""
        setns = ctypes.CDLL(None, use_errno=True).setns  # `os.setns` from Python 3.12 on
        for descriptor in self.descriptors:
            if setns(descriptor, 0) != 0:
                raise OSError(ctypes.get_errno(), "setns")
        os.chdir(folder)

    def close(self) -> None:
        """Give it up; processes that joined it keep it."""
        for descriptor in self.descriptors:
            os.close(descriptor)


@functools.lru_cache(maxsize=1)
def can_mount() -> bool:
    """True if bubblewrap is installed and this user may make namespaces with it."""
    if sys.platform != "linux" or shutil.which(BUBBLEWRAP) is None:
        return False
    with tempfile.TemporaryDirectory(prefix="vastflow-mounts-") as folder:
        Path(folder, "there").touch()
        try:
            namespace = MountNamespace.of({"/out": Path(folder)})
        except OSError:
            return False
        try:
            join = functools.partial(namespace.join, Path(folder))
            return subprocess.run(["test", "-e", "/out/there"], check=False, preexec_fn=join).returncode == 0
        except (OSError, subprocess.SubprocessError):
            return False
        finally:
            namespace.close()
