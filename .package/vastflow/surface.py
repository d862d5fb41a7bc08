"""The flat surface: where its names come from, and what earlier names became."""

import ast
import sys
import warnings
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any, Final

SURFACES: Final = {"vastflow": "__init__.py", "vastflow.plugins": "plugins.py"}
"""Modules whose names stay, to their files here. What a type checker imports in one is what it has."""

MOVED: Final[Mapping[str, tuple[str, ...]]] = {
    "vastflow.oracles.conformance": ("vastflow.oracles.judgment.conformance",),
    "vastflow.oracles.evidence.rates": ("vastflow.oracles.statistics.intervals",),
    "vastflow.oracles.judgement.conformance": ("vastflow.oracles.judgment.conformance",),
    "vastflow.oracles.judgement.oracle": ("vastflow.oracles.judgment.oracle",),
    "vastflow.oracles.judgement.registry": ("vastflow.oracles.judgment.registry",),
    "vastflow.oracles.judgement.verdict": ("vastflow.oracles.judgment.verdict",),
    "vastflow.oracles.notebook.recorded_tables": ("vastflow.oracles.results.executed",),
    "vastflow.oracles.oracle": ("vastflow.oracles.judgment.oracle", "vastflow.oracles.judgment.registry"),
    "vastflow.oracles.rates": ("vastflow.oracles.statistics.intervals",),
    "vastflow.oracles.recorded_tables": ("vastflow.oracles.results.executed",),
    "vastflow.oracles.results.recorded_tables": ("vastflow.oracles.results.executed",),
    "vastflow.oracles.situation": ("vastflow.oracles.observation.situation",),
    "vastflow.oracles.trace": ("vastflow.oracles.observation.trace",),
    "vastflow.oracles.verdict": ("vastflow.oracles.judgment.verdict",),
    "vastflow.producers.configuration": ("vastflow.producers.model.configuration",),
    "vastflow.producers.conformance": ("vastflow.producers.model.conformance",),
    "vastflow.producers.producer": ("vastflow.producers.model.producer",),
    "vastflow.sim.digest": ("vastflow.sim.model.digest",),
    "vastflow.sim.nav.controllers.conformance": ("vastflow.sim.nav2.controllers.conformance",),
    "vastflow.sim.nav.controllers.controller": (
        "vastflow.sim.nav2.controllers.controller",
        "vastflow.sim.kernels.plug_in",
    ),
    "vastflow.sim.nav.controllers.registry": ("vastflow.sim.nav2.parameter_files.plug_ins",),
    "vastflow.sim.nav.footprint": ("vastflow.sim.nav2.costmaps.window",),
    "vastflow.sim.nav.parameters.parameter": ("vastflow.sim.model.parameter",),
    "vastflow.sim.nav2.controllers.registry": ("vastflow.sim.nav2.parameter_files.plug_ins",),
    "vastflow.sim.nav2.parameters.parameter": ("vastflow.sim.model.parameter",),
    "vastflow.sim.nav2.planners.registry": ("vastflow.sim.nav2.parameter_files.plug_ins",),
    "vastflow.sim.recording": ("vastflow.sim.model.recording",),
    "vastflow.sim.recordings.recording": ("vastflow.sim.model.recording",),
    "vastflow.sim.world.robot": ("vastflow.sim.world.motion",),
}
"""Modules of earlier versions that their pages named, to the modules that have their names now; and names that left the surface,
such as `vastflow.plugins.Gone`, to what they were. An entry stays for one version."""

_FOLDER: Final = Path(__file__).parent


@cache
def homes(surface: str) -> Mapping[str, tuple[str, str]]:
    """Names of a module of the surface, to the module and the name there."""
    tree = ast.parse((_FOLDER / SURFACES[surface]).read_bytes())
    imports = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))
    return {
        alias.asname: (node.module, alias.name)
        for node in imports
        if node.module
        for alias in node.names
        if alias.asname
    }


def named(surface: str, name: str) -> Any:
    """Return what a name of the surface stands for, imported now; the `__getattr__` of its modules.

    Raises:
        AttributeError: it has no such name.
    """
    known = homes(surface)
    if name == "__all__":
        return sorted(known.keys() - {"open"})  # a star would hide Python's own
    if name in known:
        home, own = known[name]
        return getattr(import_module(home), own)
    if moved := MOVED.get(f"{surface}.{name}"):
        _warn(f"{surface}.{name}", "use one of the names in the page of its kind of plug-in")
        home, _, own = moved[0].rpartition(".")
        return getattr(import_module(home), own)
    raise AttributeError(f"module {surface!r} has no attribute {name!r}")


def origins(name: str) -> Iterator[str]:
    """Yield the modules and names that an import of `name` leads to.

    It is `name` itself, unless that is of the surface or has moved."""
    place, _, own = name.removesuffix(".*").rpartition(".")
    if name.removesuffix(".*") in SURFACES:  # nobody knows which of its names are used
        yield from (home for home, _ in homes(name.removesuffix(".*")).values())
    elif place in SURFACES and own in homes(place):
        yield ".".join(homes(place)[own])
    else:
        yield from MOVED.get(name) or MOVED.get(place) or (name,)


def spec_of(name: str) -> ModuleSpec | None:
    """The module of an earlier version of this name, or a package around one; None for any other."""
    if name in MOVED and name.rpartition(".")[0] not in SURFACES:
        return ModuleSpec(name, _Moved())
    if any(each.startswith(f"{name}.") for each in MOVED):
        return ModuleSpec(name, _Moved(), is_package=True)
    return None


class _Moved(Loader):
    """Makes modules that have the names of those that took their place, and warns whoever imports one."""

    def create_module(self, spec: ModuleSpec) -> None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        places = MOVED.get(module.__name__, ())

        def attribute(name: str) -> Any:
            for place in places:
                if hasattr(found := import_module(place), name):
                    return getattr(found, name)
            raise AttributeError(f"module {module.__name__!r} has no attribute {name!r}")

        module.__dict__["__getattr__"] = attribute
        if places:
            _warn(module.__name__, f"it is {places[0]} now")


def _warn(name: str, what: str) -> None:
    """Warn at the line that imports, in its author's file if it is a plug-in's copy."""
    frame, depth = sys._getframe(1), 1
    while frame.f_back and _is_ours(frame.f_code.co_filename):
        frame, depth = frame.f_back, depth + 1
    spec = frame.f_globals.get("__spec__")
    file, snapshot = frame.f_code.co_filename, getattr(getattr(spec, "loader", None), "snapshot", None)
    if snapshot is not None and Path(file).is_relative_to(snapshot.folder):
        file = str(snapshot.origin / Path(file).relative_to(snapshot.folder))
    text = f"{name} goes with the next version: {what}. Import from vastflow.plugins or vastflow, whose names stay."
    warnings.warn_explicit(text, DeprecationWarning, file, frame.f_lineno)


def _is_ours(file: str) -> bool:
    return file.startswith(("<frozen importlib", f"{_FOLDER}/"))
