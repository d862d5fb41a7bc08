"""What was read of source files, kept from one process to the next: a file of the same content is not parsed again.

What is kept is found by the content of a file alone, so that nothing of it can be stale: neither by a file's time, nor by
where it lies.
"""

import hashlib
import json
import os
import sys
import uuid
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

MOST_KEPT: Final = 4000
"""Files; those that were not asked for go first when there are more."""


@dataclass(frozen=True, slots=True)
class Module:
    """What is read of one file: the digest of its code, and the names of every module it may import.

    Attributes:
        data: Packages whose data it reads, by `importlib.resources.files("name")` or `importlib.util.find_spec("name")`.
    """

    code: str
    imports: frozenset[str]
    data: frozenset[str] = frozenset()


class SourceCache:
    """Modules by the content of their files.

    Args:
        file: Where they are kept; None for this process alone.
        reader: The source files of what reads modules: they decide what is read of one.
    """

    def __init__(self, file: Path | None, reader: Iterable[Path]) -> None:
        self._file = file
        self._reader = hashlib.sha256(sys.version.encode())
        for each in reader:
            self._reader.update(each.read_bytes())
        self._known: Mapping[str, Any] = _read(file) if file else {}
        self._asked: dict[str, Module] = {}
        self._new = False

    def find(self, content: bytes, package: str) -> Module | None:
        """The module of a file with this content in this package, if it was read before."""
        key = self._key(content, package)
        if key not in self._asked and key in self._known:
            code, imports, data = self._known[key]
            self._asked[key] = Module(code, frozenset(imports), frozenset(data))
        return self._asked.get(key)

    def add(self, content: bytes, package: str, module: Module) -> None:
        """Remember what was read."""
        self._asked[self._key(content, package)] = module
        self._new = True

    def keep(self) -> None:
        """Write down what is new; where that is not possible it is read again the next time."""
        if self._file is None or not self._new:
            return
        self._new = False
        asked = {key: [each.code, sorted(each.imports), sorted(each.data)] for key, each in self._asked.items()}
        rest = {key: found for key, found in self._known.items() if key not in asked}
        kept = {**asked, **dict(list(rest.items())[: max(0, MOST_KEPT - len(asked))])}
        temporary = self._file.with_name(f"{self._file.name}.{uuid.uuid4().hex}")
        with suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True)
            body = json.dumps(kept, separators=(",", ":")).encode()
            temporary.write_bytes(hashlib.sha256(body).hexdigest().encode() + b"\n" + body)
            os.replace(temporary, self._file)
        with suppress(OSError):
            temporary.unlink(missing_ok=True)

    def _key(self, content: bytes, package: str) -> str:
        hashed = self._reader.copy()
        hashed.update(package.encode() + b"\0" + content)
        return hashed.hexdigest()


@cache
def source_cache_file() -> Path:
    """Where the modules of this installation are kept: in the user's cache folder."""
    import platformdirs

    return Path(platformdirs.user_cache_dir("vastflow")) / "source" / "modules"


def _read(file: Path) -> dict[str, Any]:
    """What `keep` wrote; nothing where it is missing or damaged."""
    try:
        hashed, _, body = file.read_bytes().partition(b"\n")
        if hashlib.sha256(body).hexdigest().encode() == hashed:
            found: dict[str, Any] = json.loads(body)
            return found
    except OSError:
        pass
    return {}
