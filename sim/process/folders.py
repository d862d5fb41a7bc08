"""The folders of a run, and the names that its programs and scenario have for them: `/config` and `/out`, as in containers."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

CONFIG: Final = "/config"
"""Where programs find the run files."""
OUT: Final = "/out"
"""Where programs write."""
_NAMED: Final = re.compile(rb"/(?:config|out)(?![\w-])")
"""May be one of the two names; what only looks like one does no harm."""
_NAME: Final = re.compile(rb"(?<![\w.~/$})-])/(config|out)(?![\w.-])")
"""One of the two names, and not the end of a longer path."""


@dataclass(frozen=True, slots=True)
class RunFolders:
    """The folders of one run, below one that is its own.

    Attributes:
        config: The run files as they were given.
        out: Another copy of them; programs work there, and what they write there is kept.
        logs: What the programs print.
        root: Empty; for the root folder of programs that see `config` and `out` by their names.
    """

    config: Path
    out: Path
    logs: Path
    root: Path

    @classmethod
    def below(cls, folder: Path) -> "RunFolders":
        """Those below `folder`, which are not made."""
        return cls(folder / "config", folder / "run", folder / "logs", folder / "root")

    @property
    def mounts(self) -> Mapping[str, Path]:
        """Name to folder."""
        return {CONFIG: self.config, OUT: self.out}

    def path(self, name: str) -> Path:
        """Where this process finds the file that programs know by `name`; a relative one is seen from `out`."""
        plain = PurePosixPath(os.path.normpath(name))
        for place, folder in self.mounts.items():
            if plain.is_relative_to(place):
                return folder / plain.relative_to(place)
        return self.out / name

    def rewritten(self, text: str) -> str:
        """`text` with the folders' paths on this machine in place of their names."""
        return self._rewritten(text.encode(errors="surrogateescape")).decode(errors="surrogateescape")

    def rewrite_files(self) -> None:
        """Rewrite the text files among the run files, both copies; one with a NUL is taken for no text."""
        for folder in (self.config, self.out):
            for path in _files(folder):
                content = path.read_bytes()
                if _NAMED.search(content) and b"\0" not in content:
                    path.write_bytes(self._rewritten(content))

    def named_in_files(self) -> bool:
        """Whether a run file has one of the names."""
        return any(_NAMED.search(path.read_bytes()) for path in _files(self.config))

    def _rewritten(self, content: bytes) -> bytes:
        return _NAME.sub(lambda found: os.fsencode(self.mounts[f"/{found[1].decode()}"]), content)


def named_in(texts: Sequence[str]) -> bool:
    """Whether one of `texts` has one of the names."""
    return any(_NAMED.search(text.encode(errors="surrogateescape")) for text in texts)


def below_config(name: str) -> str | None:
    """The path below the campaign file's folder of what programs know by `name`; None where it is elsewhere.

    Relative paths are seen from that folder, and none leads out of it.
    """
    plain = PurePosixPath(os.path.normpath(name))
    if plain.is_relative_to(CONFIG):
        plain = plain.relative_to(CONFIG)
    return None if plain.is_absolute() or plain.parts[:1] == ("..",) else plain.as_posix()


def _files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]
