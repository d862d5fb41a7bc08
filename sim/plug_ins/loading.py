"""Loading: a plug-in found, its module from its snapshot, and its code as a value.

Each snapshot is a package of a name of its own, so that two plug-ins may have helpers of one name, and an edited helper is never
taken for the one before.
"""

import builtins
import functools
import hashlib
import importlib
import importlib.machinery
import importlib.metadata
import importlib.util
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from vastflow.sim.model.digest import Value, digest, file_digest
from vastflow.sim.plug_ins.effects import plug_in_code, watched
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.snapshot import Snapshot

_PACKAGE: Final = "vastflow_plug_in_"
_DIGITS: Final = 16

_permitted: ContextVar[Collection[str] | None] = ContextVar("permitted", default=None)


@contextmanager
def code_from(contents: Collection[str]) -> Iterator[None]:
    """Let the body open only plug-ins, and start only programs, whose digests are in `contents`."""
    token = _permitted.set(contents)
    try:
        yield
    finally:
        _permitted.reset(token)


def is_limited() -> bool:
    """Whether a body of `code_from` is executed."""
    return _permitted.get() is not None


def check_permitted(place: object, *contents: str) -> None:
    """Raise `PlugInError` if `code_from` does not permit code of these digests."""
    permitted = _permitted.get()
    if permitted is not None and any(content not in permitted for content in contents):
        what = f"{str(place)!r} is code of others that you have not permitted"
        raise PlugInError(what, "permit it by --trust")


def module_name(snapshot: Snapshot) -> str:
    """Name of the module that a plug-in's file is."""
    return f"{package_name(snapshot)}.{_dotted(snapshot.entry)}"


def package_name(snapshot: Snapshot) -> str:
    """Package name of a snapshot, made of its content and original path, which its classes show."""
    own = digest(snapshot.digest, str(snapshot.origin), str(snapshot.campaign), str(snapshot.folder))
    return f"{_PACKAGE}{own[:_DIGITS]}"


def module_of(snapshot: Snapshot) -> ModuleType:
    """Return the module of a plug-in's file, executed once in a process; raises what its code raises."""
    open_package(snapshot)
    with plug_in_code(), watched(snapshot):
        return importlib.import_module(module_name(snapshot))  # waits while another thread executes it


def open_package(snapshot: Snapshot) -> ModuleType:
    """The package of a snapshot, its copies checked; nothing of the plug-in is executed yet.

    Raises:
        PlugInError: a copy has changed, or `code_from` does not permit the plug-in.
    """
    name = package_name(snapshot)
    check_permitted(snapshot.origin / snapshot.entry, *snapshot.files.values())
    if name not in sys.modules:
        snapshot.check()
        if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
            sys.meta_path.insert(0, _Finder())
        spec = importlib.machinery.ModuleSpec(name, SnapshotLoader(name, snapshot.folder, snapshot), is_package=True)
        sys.modules.setdefault(name, importlib.util.module_from_spec(spec))  # another thread may have been first
    return sys.modules[name]


def empty_module(snapshot: Snapshot) -> ModuleType:
    """Return the module for a plug-in's file that is no Python, such as a notebook; one a process."""
    name = module_name(snapshot)
    open_package(snapshot)
    if name not in sys.modules:
        spec = importlib.machinery.ModuleSpec(name, SnapshotLoader(name, snapshot.file, snapshot))
        module = importlib.util.module_from_spec(spec)
        module.__file__ = str(snapshot.file)
        module.__dict__["__builtins__"] = frozen_builtins(snapshot)
        sys.modules.setdefault(name, module)
    return sys.modules[name]


def snapshot_behind(kind: type) -> Snapshot | None:
    """The snapshot that a class is from; None for one of an installed package."""
    loader = getattr(getattr(sys.modules.get(kind.__module__), "__spec__", None), "loader", None)
    return loader.snapshot if isinstance(loader, SnapshotLoader) else None


def frozen_builtins(snapshot: Snapshot) -> dict[str, Any]:
    """Python's built-in names, with an import that takes a snapshot's neighbors from the snapshot."""
    home = ".".join([package_name(snapshot), *filter(None, [_dotted(f"{snapshot.home}/__init__.py")])])
    inside = f"{snapshot.home}/" if snapshot.home else ""
    beside = {place.removeprefix(inside).partition("/")[0] for place in snapshot.modules if place.startswith(inside)}
    beside = {name.removesuffix(".py") for name in beside}

    def frozen_import(
        name: str,
        globals: Mapping[str, object] | None = None,
        locals: Mapping[str, object] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        top = name.partition(".")[0]
        if level or top not in beside:
            return builtins.__import__(name, globals, locals, fromlist or (), level)
        if fromlist:
            return builtins.__import__(f"{home}.{name}", globals, locals, fromlist, 0)
        importlib.import_module(f"{home}.{name}")
        return sys.modules[f"{home}.{top}"]

    return {**builtins.__dict__, "__import__": frozen_import}


class SnapshotLoader(importlib.machinery.SourceFileLoader):
    """Execute a copy without writing bytecode."""

    def __init__(self, fullname: str, path: Path, snapshot: Snapshot) -> None:
        super().__init__(fullname, str(path))
        self.snapshot = snapshot

    def exec_module(self, module: ModuleType) -> None:
        """Execute the copy; a folder without `__init__.py` has nothing to execute."""
        if Path(self.path).is_file():
            module.__dict__["__builtins__"] = frozen_builtins(self.snapshot)
            super().exec_module(module)

    def set_data(self, path: str, data: Any, *, _mode: int = 0o666) -> None:
        """Skip writing bytecode next to the copies."""


class _Finder:
    """Finds the modules of snapshots whose packages are loaded."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        top, *parts = name.split(".")
        if not parts or not top.startswith(_PACKAGE) or top not in sys.modules:
            return None
        spec = sys.modules[top].__spec__
        loader = spec.loader if spec else None
        if not isinstance(loader, SnapshotLoader):
            return None
        snapshot, own = loader.snapshot, ".".join(parts)
        places = {_dotted(place): place for place in snapshot.modules}
        if own not in places:
            folder = SnapshotLoader(name, snapshot.folder, snapshot)
            is_folder = any(each.startswith(f"{own}.") for each in places)
            return importlib.machinery.ModuleSpec(name, folder, is_package=True) if is_folder else None
        snapshot.read(places[own])
        file = snapshot.folder / places[own]
        package = [str(file.parent)] if file.name == "__init__.py" else None
        return importlib.util.spec_from_file_location(
            name, file, loader=SnapshotLoader(name, file, snapshot), submodule_search_locations=package
        )


def _dotted(place: str) -> str:
    """Return a place as a module name, with points in names of folders and files replaced."""
    *folders, last = place.split("/")
    stem, _, _ = last.rpartition(".")
    parts = [part for part in folders if part] if last == "__init__.py" else [*folders, stem]
    return ".".join(part.replace(".", "_") for part in parts)


OWN: Final = "vastflow."


def code_value(kind: type) -> Value:
    """Identify the code of a class: its files to the byte, and the versions of their imports.

    None for vastflow's own, which the source digest of execution has. Of a class from a file that is its snapshot, of an
    installed one its package.
    """
    if kind.__module__.startswith(OWN):
        return None
    if (snapshot := snapshot_behind(kind)) is not None:
        return [snapshot.digest, _versions(snapshot.outside)]
    top = kind.__module__.partition(".")[0]
    folders = [Path(folder) for folder in getattr(sys.modules[top], "__path__", ())]
    files = [file for folder in folders for file in folder.rglob("*.py")] or [Path(sys.modules[top].__file__ or "")]
    stamps = [(str(file), status.st_size, status.st_mtime_ns) for file in sorted(files) if (status := file.stat())]
    return [_content(tuple(stamps)), _versions((top,))]


@functools.lru_cache(maxsize=16)
def _content(files: tuple[tuple[str, int, int], ...]) -> str:
    """Return the digest of files by path, size, and time of the last change (ns since 1970)."""
    return hashlib.sha256("".join(file_digest(file) for file, _, _ in files).encode()).hexdigest()


def _versions(imported: tuple[str, ...]) -> dict[str, str]:
    names = (name for top in imported for name in distributions().get(top, ()))
    return {name: importlib.metadata.version(name) for name in names}


@functools.cache
def distributions() -> Mapping[str, list[str]]:
    """Return import name to the distributions that are installed under it; takes a tenth of a second."""
    return importlib.metadata.packages_distributions()
