"""Source digests: the code that a result follows from, found by reading it, without running it."""

import ast
import copy
import functools
import importlib.metadata
import importlib.util
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from vastflow.sim.model.digest import digest, file_digest
from vastflow.sim.plug_ins import neighbors
from vastflow.sim.plug_ins.loading import distributions, snapshot_behind
from vastflow.sim.plug_ins.snapshot import Snapshot
from vastflow.surface import origins
from vastflow.tasks.keys import code_digest
from vastflow.tasks.keys.code_digest import Module, SourceCache, source_cache_file, tree_digest
from vastflow.tasks.store.source_files import SourceFiles, source_files

PACKAGES: Final = tuple(f"vastflow.{name}" for name in ("sim", "producers", "oracles", "tasks", "campaigns.scenarios"))

NUMERIC_LIBRARIES: Final[Mapping[str, tuple[str, ...]]] = {
    "PIL": ("pillow",),
    "lark": ("lark",),
    "llvmlite": ("llvmlite",),
    "manifold3d": ("manifold3d", "numpy"),
    "numba": ("llvmlite", "numba", "numpy"),
    "numpy": ("numpy",),
    "py_trees": ("py_trees",),
    "pyarrow": ("pyarrow",),
    "pymunk": ("pymunk",),
    "scipy": ("numpy", "scipy"),
    "shapely": ("numpy", "shapely"),
    "skimage": ("numpy", "scikit-image", "scipy"),
    "yaml": ("pyyaml",),
}
"""Import name to the distributions whose versions can change a number or a stored byte."""

READING: Final = (
    "vastflow.sim.nav2.controllers.conformance",
    "vastflow.sim.nav2.parameter_files",
    "vastflow.sim.nav2.parameters",
    "vastflow.sim.nav2.planners.conformance",
    "vastflow.sim.nav2.system",
    "vastflow.sim.model.names",
    "vastflow.sim.model.parameter",
    "vastflow.sim.plug_ins",
    "vastflow.sim.reading",
    "vastflow.sim.scenario.definition",
    "vastflow.sim.scenario.language",
    "vastflow.sim.system",
    "vastflow.sim.world.environment",
    "vastflow.sim.world.map_file",
    "vastflow.sim.world.noise_conformance",
    "vastflow.sim.world.noise_registry",
    "vastflow.sim.world.readers",
)
"""Packages that read and check, and load plug-ins. No result follows from their code: keys hold the values they read, and
the snapshots of plug-ins."""

PLUG_IN: Final = "plug-in"
"""Name of a plug-in's file in a digest, wherever it lies. Files that it uses begin with this and a slash."""

_CODE: Final = (".py", ".pyc", ".typed")


@dataclass(frozen=True, slots=True)
class Code:
    """Code that a result follows from.

    Attributes:
        modules: Name of each module to the digest of its code.
        data: Package to the digest of its data, for packages whose data is read.
        libraries: Distribution to its version, where it can change a number or a stored byte.
    """

    modules: Mapping[str, str]
    data: Mapping[str, str]
    libraries: Mapping[str, str]

    @property
    def digest(self) -> str:
        """Digest of all three."""
        data = [dict(self.data)] if self.data else []
        return digest([list(module) for module in self.modules.items()], *data, dict(self.libraries))


class SourceTree:
    """Python packages as text, with the files read so far.

    Args:
        packages: Import name of each package to its folder. Imports that lead elsewhere are not followed.
        files: Import name to file of modules that are in no package.
        cache: File in which what was read is kept for other processes; None for none.
    """

    def __init__(
        self, packages: Mapping[str, Path], files: Mapping[str, Path] | None = None, cache: Path | None = None
    ) -> None:
        self._packages = dict(packages)
        self._files = dict(files or {})
        self._cache = SourceCache(
            cache, [Path(module) for module in (__file__, code_digest.__file__, neighbors.__file__)]
        )
        self._read: dict[Path, Module] = {}
        self._places: dict[str, Path | None] = {}
        self._codes: dict[tuple[str, ...], Code] = {}

    def digest(self, *entries: str) -> str:
        """Digest of the code of `entries`, modules or `package.*`, with all that they import and read.

        Left out are the packages that read and check (see `READING`), comments, docstrings, and the folder's place.

        Raises:
            ModuleNotFoundError: an entry is not in the tree.
        """
        return self.code(*entries).digest

    def code(self, *entries: str) -> Code:
        """Return all that `digest` is a digest of.

        Raises:
            ModuleNotFoundError: an entry is not in the tree.
        """
        if entries not in self._codes:
            found = self._code(entries)
            if PLUG_IN in found.modules:  # a user may be editing it
                return found
            self._codes[entries] = found
        return self._codes[entries]

    def _code(self, entries: tuple[str, ...]) -> Code:
        modules = self._closure(self._named(entries))
        self._cache.keep()
        data = {package for module in modules.values() for package in module.data}
        imported = {name.partition(".")[0] for module in modules.values() for name in module.imports}
        libraries = sorted({library for name in imported for library in NUMERIC_LIBRARIES.get(name, ())})
        return Code(
            {name: module.code for name, module in sorted(modules.items())},
            {package: self.data_digest(package) for package in sorted(data)},
            {library: _version(library) for library in libraries},
        )

    def files(self) -> SourceFiles:
        """The source files of all packages of the tree, as they are now."""
        return source_files(self._packages.values())

    def plug_in_digest(self, plug_in: type) -> str:
        """Digest of the code behind a class.

        A class of the tree has its module's digest. One from another package is followed inside that package and into the
        tree; one from a file beside a campaign is its snapshot with what that uses of the tree.
        """
        top = plug_in.__module__.partition(".")[0]
        code = self.plug_in_code(plug_in)
        return digest(code.digest, _version(top)) if self._is_elsewhere(plug_in) else code.digest

    def plug_in_code(self, plug_in: type) -> Code:
        """Return the code behind a class; a plug-in's own file is called `PLUG_IN`."""
        name = plug_in.__module__
        if self._file(name) is not None:
            return self.code(name)
        if (snapshot := snapshot_behind(plug_in)) is not None:
            return self._frozen_code(snapshot)
        top = name.partition(".")[0]
        if self._is_elsewhere(plug_in):
            return self._with({top: Path(next(iter(sys.modules[top].__path__)))}, {}).code(name)
        single = sys.modules[name].__file__
        if single is None:
            raise ModuleNotFoundError(f"{plug_in!r} has no source file. A plug-in is a Python file or package")
        return self._with({}, {PLUG_IN: Path(single)}).code(PLUG_IN)

    def _frozen_code(self, snapshot: Snapshot) -> Code:
        """Return the code and data of a snapshot, and the versions of all that it imports from elsewhere."""
        own = {snapshot.local_name(place): snapshot.folder / place for place in snapshot.modules}
        own = {PLUG_IN if file == snapshot.file else f"{PLUG_IN}/{name}": file for name, file in own.items()}
        live = {top: place for top in snapshot.outside if (place := live_source(top)) is not None}
        packages = {top: place for top, place in live.items() if place.is_dir()}
        single = {top: place for top, place in live.items() if not place.is_dir()}
        code = self._with(packages, {**own, **single}).code(*own)
        data = {f"{PLUG_IN}/{snapshot.local_name(place)}": sha256 for place, sha256 in snapshot.data.items()}
        others = [top for top in snapshot.outside if top not in live and top not in NUMERIC_LIBRARIES]
        versions = {name: _version(name) for top in others for name in distributions().get(top, [top])}
        return Code(code.modules, {**code.data, **data}, {**code.libraries, **versions})

    def _is_elsewhere(self, plug_in: type) -> bool:
        """True if a class is from a package that is not in the tree."""
        name = plug_in.__module__
        if snapshot_behind(plug_in) is not None:
            return False
        return self._file(name) is None and getattr(sys.modules[name.partition(".")[0]], "__path__", None) is not None

    def _with(self, packages: Mapping[str, Path], files: Mapping[str, Path]) -> "SourceTree":
        """Return a wider tree that has read what this one has."""
        wider = copy.copy(self)  # with the same cache, and the modules that were read
        wider._packages = {**self._packages, **packages}
        wider._files = {**self._files, **files}
        wider._places = {name: file for name, file in self._places.items() if file and name not in files}
        wider._codes = {}
        return wider

    def _closure(self, entries: tuple[str, ...]) -> dict[str, Module]:
        found: dict[str, Module] = {}
        waiting = []
        for entry in entries:
            if self._file(entry) is None:
                raise ModuleNotFoundError(f"no module {entry!r} in {', '.join(sorted(self._packages))}")
            waiting += _with_parents(entry)
        while waiting:
            name = waiting.pop()
            file = self._file(name)
            if name in found or file is None:
                continue
            found[name] = self._module(name, file)
            meant = (origin for imported in found[name].imports for origin in origins(imported))
            used = (imported for imported in meant if not _only_reads(name, imported))
            waiting += [part for imported in used for part in _with_parents(imported)]
        return found

    def _named(self, entries: tuple[str, ...]) -> tuple[str, ...]:
        """Return entries by name; `package.*` is every module of a package except for reading ones."""
        found: list[str] = []
        for entry in entries:
            package, star, _ = entry.partition(".*")
            folder = self._folder(package) if star else None
            names = [entry] if folder is None else sorted(f"{package}.{file.stem}" for file in folder.glob("*.py"))
            found += [name.removesuffix(".__init__") for name in names if not (star and _is_below(name, READING))]
        return tuple(found)

    def _module(self, name: str, file: Path) -> Module:
        if file not in self._read or name == PLUG_IN:  # a user may be editing a plug-in
            package = name if file.name == "__init__.py" else name.rpartition(".")[0]
            if file.suffix == ".ipynb":
                from vastflow.oracles.judgment.notebook import notebook_code

                content = notebook_code(file).encode()
            else:
                content = file.read_bytes()
            if (module := self._cache.find(content, package)) is None:
                module = _module_of(content, package)
                self._cache.add(content, package, module)
            self._read[file] = module
        return self._read[file]

    def data_digest(self, package: str) -> str:
        """Digest of the data files of a package of the tree and its folders, by name and content."""
        folder = self._folder(package)
        if folder is None:
            return ""
        files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file.suffix not in _CODE]
        return digest([[file.relative_to(folder).as_posix(), file_digest(file)] for file in files])

    def _folder(self, name: str) -> Path | None:
        for package, folder in self._packages.items():
            if name == package or name.startswith(package + "."):
                return folder.joinpath(*name[len(package) :].split(".")[1:])
        return None

    def _file(self, name: str) -> Path | None:
        if name not in self._places:
            self._places[name] = self._search(name)
        return self._places[name]

    def _search(self, name: str) -> Path | None:
        if name in self._files:
            return self._files[name]
        place = self._folder(name)
        for file in (place / "__init__.py", place.with_suffix(".py")) if place else ():
            if file.is_file():
                return file
        return None


def installed_tree() -> SourceTree:
    """Return the packages of vastflow that results follow from, as this process would import them."""
    return SourceTree(folders_of(PACKAGES), cache=source_cache_file())


def folders_of(packages: Iterable[str]) -> dict[str, Path]:
    """Return the folder of each package, as this process would import it.

    Raises:
        ModuleNotFoundError: one is not installed as a package.
    """
    folders = {}
    for package in packages:
        spec = importlib.util.find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            raise ModuleNotFoundError(f"{package} is not installed as a package")
        folders[package] = next(place for place in map(Path, spec.submodule_search_locations) if place.is_dir())
    return folders


def _module_of(content: bytes, package: str) -> Module:
    tree = ast.parse(content)
    nodes = list(ast.walk(tree))
    return Module(tree_digest(tree), frozenset(neighbors.imports_of(nodes, package)), frozenset(_data_packages(nodes)))


def _data_packages(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """Yield packages named in calls of `importlib.resources.files` and `importlib.util.find_spec`."""
    for node in nodes:
        if isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in ("files", "find_spec") and isinstance(node.args[0].value, str):
                yield node.args[0].value


def _only_reads(importer: str, imported: str) -> bool:
    """True if an import leads from code of vastflow that computes to code that reads and checks."""
    return _is_below(importer, ("vastflow",)) and _is_below(imported, READING) and not _is_below(importer, READING)


@functools.cache
def _is_below(name: str, packages: tuple[str, ...]) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in packages)


def _with_parents(name: str) -> list[str]:
    parts = name.split(".")
    return [".".join(parts[: k + 1]) for k in range(len(parts))]


def live_source(top: str) -> Path | None:
    """Return the folder or file of a module outside of installed distributions, whose versions identify them."""
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return None
    if spec is None:
        return None
    origin = next(iter(spec.submodule_search_locations or ()), spec.origin)
    place = Path(origin or "")
    if not origin or not (place.is_dir() or place.suffix == ".py"):
        return None
    return None if {"site-packages", "dist-packages"} & {*place.parts} else place


def _version(distribution: str) -> str:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return ""
