"""Neighbors: the files that a plug-in's results depend on, found without running it."""

import ast
import importlib.util
import io
import os
import sys
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from vastflow.sim.model.faults import Got, Invalid
from vastflow.sim.model.files import Unreadable, is_inside, read_bytes
from vastflow.surface import SURFACES

FILES: Final = "files"
"""Name under which a class, or a notebook at its top, declares the data files it reads."""

MOST_BYTES: Final = 100_000_000
"""Maximum size of one plug-in with all of its files."""

_NEVER_BESIDE: Final = sys.stdlib_module_names | {"vastflow"}
_IMPORTING: Final = ("importlib.import_module", "import_module", "__import__")
_PATTERN: Final = frozenset("*?[")
_ENVIRONMENT: Final = frozenset({"os.environ", "os.getenv", "os.environb", "os.getenvb"})
_PROGRAMS: Final = frozenset({"os.system", "os.popen"})
_PROGRAMS_OF: Final = "subprocess"


class PlugInError(Invalid):
    """A plug-in that can't be taken."""


@dataclass(frozen=True, slots=True)
class Hidden:
    """An input that cannot be followed, such as the result of `os.getenv`."""

    file: Path
    line: int
    name: str
    what: str


@dataclass(slots=True)
class Neighbors:
    """Files and modules that a plug-in's file uses.

    Attributes:
        modules: Python files by absolute path, with what is in them; the plug-in's own is the first.
        data: Declared data files by absolute path, with what is in them.
        outside: Top-level names of modules that it imports from elsewhere, neither Python's own nor vastflow's.
        hidden: Inputs that can't be followed.
    """

    modules: dict[Path, bytes] = field(default_factory=dict)
    data: dict[Path, bytes] = field(default_factory=dict)
    outside: set[str] = field(default_factory=set)
    hidden: list[Hidden] = field(default_factory=list)


def neighbors_of(file: Path, code: str | None = None, within: Path | None = None) -> Neighbors:
    """Follow a plug-in's imports to modules in its folder, and read its declared data files.

    Args:
        file: Absolute path.
        code: The Python in it, of a file that is no Python, such as a notebook: there `files` stands at its top.
        within: Folder that must contain all of it, links followed, such as a stranger's; None for a user's own, which may use others.

    Raises:
        PlugInError: a file can't be read or parsed, lies elsewhere, or a declaration is wrong.
    """
    found, home = Neighbors(), None if within is None else os.path.realpath(within)
    waiting = [file]
    while waiting:
        module = waiting.pop()
        if module in found.modules:
            continue
        found.modules[module] = _content(module, home)
        tree = _tree(module, code.encode() if code is not None and module == file else found.modules[module])
        nodes = list(ast.walk(tree))
        inside = module.parent.relative_to(file.parent).parts if module.is_relative_to(file.parent) else ()
        for name in dict.fromkeys(imports_of(nodes, ".".join(inside))):
            top = name.partition(".")[0]
            if is_beside(top, file.parent):
                waiting += _executed(name, file.parent)
            elif top not in _NEVER_BESIDE:
                found.outside.add(top)
        for names in _declared(tree, is_notebook=code is not None and module == file):
            for path in _files(names, module, home):
                found.data.setdefault(path, b"")
        found.hidden += _hidden(nodes, module)
    for path in found.data:
        found.data[path] = _content(path, home)
    return found


def _tree(file: Path, content: bytes) -> ast.Module:
    try:
        encoding, _ = tokenize.detect_encoding(io.BytesIO(content).readline)  # by a coding cookie, if there is one
        return ast.parse(content.decode(encoding))
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        where = f"{str(file)!r}" + (f", line {line}" if line else "")
        words = getattr(error, "msg", None) or str(error)
        raise PlugInError(f"{where} can't be imported: {type(error).__name__}: {words}") from None


def _check_within(file: Path, home: str | None) -> None:
    if home is not None and not is_inside(file, home):
        raise PlugInError(Got(str(file)), f"a file of a plug-in in {home!r}")


def _content(file: Path, home: str | None) -> bytes:
    _check_within(file, home)
    try:
        return read_bytes(file, "a file of a plug-in", MOST_BYTES)
    except Unreadable as error:
        raise PlugInError(f"{str(file)!r}: {error}") from None


def imports_of(nodes: list[ast.AST], package: str) -> Iterator[str]:
    """Yield the names of all imports in a module of `package`, also inside functions and in calls with a literal.

    Of `from a import b` both `a` and `a.b`, or `a.b` alone where `a` is the flat surface.
    """
    inside = package.split(".") if package else []
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = inside[: len(inside) - node.level + 1] if node.level else []
            base += [node.module] if node.module else []
            if base and ".".join(base) not in SURFACES:  # of which only the names count that are taken
                yield ".".join(base)
            yield from (".".join([*base, alias.name]) for alias in node.names if alias.name != "*" or base)
        elif isinstance(node, ast.Call) and node.args and isinstance(first := node.args[0], ast.Constant):
            yield from [first.value] if isinstance(first.value, str) and ast.unparse(node.func) in _IMPORTING else []


def is_beside(top: str, root: Path) -> bool:
    """Whether an import of this top-level name means a module or package in the folder `root`.

    A folder without `__init__.py` comes after whatever is installed under its name, as for Python. Names of Python's own modules
    mean these.
    """
    if top in _NEVER_BESIDE:
        return False
    if (root / f"{top}.py").is_file() or (root / top / "__init__.py").is_file():
        return True
    return any((root / top).rglob("*.py")) and importlib.util.find_spec(top) is None


def _executed(name: str, root: Path) -> Iterator[Path]:
    """Files below `root` that an import of `name` executes."""
    parts = name.split(".")
    place = root
    for k, part in enumerate(parts):
        if part == "*":
            yield from sorted(place.glob("*.py"))
        elif (place / part).is_dir() and ((place / part / "__init__.py").is_file() or k < len(parts) - 1):
            place = place / part
            if (place / "__init__.py").is_file():
                yield place / "__init__.py"
        elif (place / f"{part}.py").is_file():
            yield place / f"{part}.py"
            return
        else:
            return


def _declared(tree: ast.Module, is_notebook: bool) -> Iterator[list[str]]:
    """Yield the declarations `files` of subclasses, of readers, and at a notebook's top, except in parameter models."""
    bodies = [
        node.body
        for node in tree.body
        if isinstance(node, ast.ClassDef)
        and not any(ast.unparse(base).endswith(("Parameters", "Model")) for base in node.bases[:1])
        and (node.bases or any(isinstance(each, ast.FunctionDef) and each.name == "read" for each in node.body))
    ]
    for body in [tree.body] if is_notebook else bodies:
        for statement in body:
            if isinstance(statement, ast.Assign) and len(statement.targets) == 1:
                target, value = statement.targets[0], statement.value
            elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
                target, value = statement.target, statement.value
            else:
                continue
            if isinstance(target, ast.Name) and target.id == FILES:
                yield _names(value, statement.lineno)


def _names(value: ast.expr, line: int) -> list[str]:
    try:
        names = ast.literal_eval(value)
    except (ValueError, TypeError, RecursionError, MemoryError):
        names = None
    if isinstance(names, list | tuple) and all(isinstance(name, str) and name for name in names):
        return list(names)
    found = ast.unparse(value)[:80]
    raise PlugInError(Got(f"{FILES} = {found} in line {line}"), f'names of files, such as {FILES} = ["limits.json"]')


def _files(names: list[str], module: Path, home: str | None) -> Iterator[Path]:
    """Declared files: each by its name, all below a folder, or what matches a pattern."""
    for name in names:
        if Path(name).is_absolute():
            raise PlugInError(Got(f"{name!r} in {FILES} of {module.name}"), "a path relative to the plug-in's folder")
        place = module.parent / name
        _check_within(place, home)  # before a folder outside is looked through
        if not _PATTERN.isdisjoint(name):
            found = [each for each in module.parent.glob(name) if each.is_file()]
        elif place.is_dir():
            found = [each for each in place.rglob("*") if each.is_file()]
        elif place.exists():
            found = [place]
        else:
            raise PlugInError(f"{module.name} declares {name!r} in {FILES}", f"there is none beside {str(module)!r}")
        yield from sorted(Path(os.path.abspath(each)) for each in found)


def _hidden(nodes: list[ast.AST], module: Path) -> Iterator[Hidden]:
    meant: dict[str, str] = {}  # by a name that is imported
    for node in nodes:
        if isinstance(node, ast.Import):
            meant |= {alias.asname: alias.name for alias in node.names if alias.asname}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            meant |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
    for node in nodes:
        if not isinstance(node, ast.Attribute | ast.Name):
            continue
        first, _, rest = ast.unparse(node).partition(".")
        name = meant.get(first, first) + (f".{rest}" if rest else "")
        if name in _ENVIRONMENT:
            yield Hidden(module, node.lineno, name, "what it reads of the environment")
        elif name in _PROGRAMS or (name.startswith(f"{_PROGRAMS_OF}.") and name.count(".") == 1):
            yield Hidden(module, node.lineno, name, "what another program reads")
