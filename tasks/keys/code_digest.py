"""Code digests: equal for equal programs, whatever their layout and docstrings; and a cache of parsed source files."""

import ast
import hashlib
import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from vastflow.sim.model.files import replace_file

_UNSEEN = frozenset({"kind", "type_comment", "type_ignores"})
"""Fields of a syntax tree that change nothing: `u` before a string, and comments about types."""


def tree_digest(tree: ast.AST) -> str:
    """SHA-256 of the syntax tree of Python source, without positions and statements that are only a string.

    The tree's own form, unlike `ast.dump`, is the same on every minor version of Python that parses the same nodes.
    """
    hashed = hashlib.sha256()
    for token in _tokens(tree):
        hashed.update(token)
    return hashed.hexdigest()


def _tokens(tree: ast.AST) -> Iterator[bytes]:
    """Yield text from which the tree could be rebuilt, without recursion, as trees may be 1,000 levels deep."""
    waiting: list[Any] = [tree]
    while waiting:
        part = waiting.pop()
        if isinstance(part, bytes):
            yield part
        elif isinstance(part, ast.AST):
            waiting += reversed(list(_node(part)))
        elif isinstance(part, list):
            waiting += reversed([b"[", *(each for each in part if not _is_docstring(each)), b"]"])
        else:
            yield _constant(part)


def _node(node: ast.AST) -> Iterator[Any]:
    """Yield a node's parts without absent fields and empty lists, which depend on the version of Python."""
    yield f"({type(node).__name__}".encode()
    for name, value in ast.iter_fields(node):
        if isinstance(node, ast.JoinedStr):  # Python 3.12 has an empty text behind a nested format
            value = [each for each in value if not (isinstance(each, ast.Constant) and each.value == "")]
        is_absent = (value is None and not isinstance(node, ast.Constant)) or value == []
        if name not in _UNSEEN and not is_absent:
            yield f" {name}=".encode()
            yield value
    yield b")"


def _constant(value: object) -> bytes:
    """Encode a syntax tree's value with type and length, so that encodings are unique."""
    if isinstance(value, str):
        text = value.encode("utf-8", "surrogatepass")
    elif isinstance(value, bytes):
        text = value
    elif isinstance(value, float):
        text = value.hex().encode()
    elif isinstance(value, complex):
        text = f"{value.real.hex()} {value.imag.hex()}".encode()
    elif isinstance(value, int) and not isinstance(value, bool):
        text = hex(value).encode()  # a decimal of more than 4,300 digits is refused
    else:
        text = repr(value).encode()
    return f"{type(value).__name__} {len(text)} ".encode() + text


def _is_docstring(node: object) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


CACHED_FILES: Final = 4000
"""Maximum number of files in the cache; the unused ones go first."""


@dataclass(frozen=True, slots=True)
class Module:
    """Code digest of one file, the modules it may import, and the packages with data that it reads."""

    code: str
    imports: frozenset[str]
    data: frozenset[str] = frozenset()


class SourceCache:
    """Modules by the content of their files.

    Args:
        file: Cache file; None for this process alone.
        reader: Source files of the code that reads modules, which are part of every key.
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
        """Return the module of a file with this content in this package, if it was read before."""
        key = self._key(content, package)
        if key not in self._asked and key in self._known:
            code, imports, data = self._known[key]
            self._asked[key] = Module(code, frozenset(imports), frozenset(data))
        return self._asked.get(key)

    def add(self, content: bytes, package: str, module: Module) -> None:
        self._asked[self._key(content, package)] = module
        self._new = True

    def keep(self) -> None:
        """Write the cache file if anything is new; a failure costs time, nothing else."""
        if self._file is None or not self._new:
            return
        self._new = False
        asked = {key: [each.code, sorted(each.imports), sorted(each.data)] for key, each in self._asked.items()}
        rest = {key: found for key, found in self._known.items() if key not in asked}
        kept = {**asked, **dict(list(rest.items())[: max(0, CACHED_FILES - len(asked))])}
        with suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True)
            body = json.dumps(kept, separators=(",", ":")).encode()
            replace_file(self._file, hashlib.sha256(body).hexdigest().encode() + b"\n" + body)

    def _key(self, content: bytes, package: str) -> str:
        hashed = self._reader.copy()
        hashed.update(package.encode() + b"\0" + content)
        return hashed.hexdigest()


@cache
def source_cache_file() -> Path:
    """Return the cache file of this installation, in the user's cache folder."""
    import platformdirs

    return Path(platformdirs.user_cache_dir("vastflow")) / "source" / "modules"


def _read(file: Path) -> dict[str, Any]:
    """Return the content of a cache file; empty where it is missing or damaged."""
    try:
        hashed, _, body = file.read_bytes().partition(b"\n")
        if hashlib.sha256(body).hexdigest().encode() == hashed:
            found: dict[str, Any] = json.loads(body)
            return found
    except OSError:
        pass
    return {}
