"""Registries: plug-ins of one kind, found by entry-point name or in a file."""

import functools
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.files import is_file
from vastflow.sim.model.names import did_you_mean, nearest
from vastflow.sim.model.parameter import ParameterGroup
from vastflow.sim.plug_ins.loading import module_of
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.snapshot import PlugInFile, Snapshot, snapshot_of

FILE: Final = ".py:"
"""Name of a plug-in in a file, such as `my_pursuit.py:PurePursuit`."""

PlugIn = TypeVar("PlugIn")


@functools.cache
def known_plug_ins(group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group by name, sorted; to look through all distributions takes 10 ms."""
    return dict(sorted((entry.name, entry) for entry in entry_points(group=group)))


@dataclass(frozen=True, eq=False)
class Registry(Generic[PlugIn]):
    """The plug-ins of one kind.

    Attributes:
        group: Entry-point group.
        noun: The kind, in words.
        base: Base class of all of them.
        beside: The file that a plug-in's own file is relative to.
        apart: Entry points of plug-ins whose parameters stand apart from their kernels: a campaign is read without numba.
        is_beside_campaign: True if `base` is the campaign's folder, of which a plug-in may read no file unnoticed either.
    """

    group: str
    noun: str
    base: type[PlugIn]
    beside: str
    apart: Mapping[str, type[ParameterGroup]] = field(default_factory=dict)
    is_beside_campaign: bool = False

    @property
    def own(self) -> str:
        """Hint for naming a plug-in in a user's own file."""
        return f"file.py:Class for one of your own, relative to the {self.beside}"

    @functools.cached_property
    def known(self) -> Mapping[str, EntryPoint]:
        """The entry points of the group by name, sorted.

        Raises:
            RuntimeError: not even vastflow's own are there, as after an update of an editable install's source alone.
        """
        found = known_plug_ins(self.group)
        if not any(entry.module.startswith("vastflow.") for entry in found.values()):
            right = "Install it again: pip install -e . in a checkout"
            raise RuntimeError(
                f"vastflow is installed without its {self.noun}s, as its metadata is older than its source. {right}."
            )
        return found

    def name_of(self, kind: type) -> str:
        """Return the name of an installed plug-in, or of the plug-in with these parameters."""
        own = f"{kind.__module__}:{kind.__qualname__}"
        value = next((value for value, parameters in self.apart.items() if parameters is kind), own)
        return next(name for name, entry in self.known.items() if entry.value == value)

    def parameters(self, name: str, base: Path = Path(), snapshot: Snapshot | None = None) -> type[Any]:
        """Return the parameters of the plug-in called `name`: a class of their own, or the plug-in's; see `find`."""
        entry = self.known.get(name)
        apart = None if entry is None else self.apart.get(entry.value)
        return apart or self.find(name, base, snapshot)

    def find(self, name: str, base: Path = Path(), snapshot: Snapshot | None = None) -> type[PlugIn]:
        """Return the class called `name` in the entry-point group, or `file.py:Class`.

        Args:
            base: The folder that a file is relative to.
            snapshot: The file as it was before, which is loaded in place of it.

        Raises:
            PlugInError: no such entry point, file or class, a class of another kind, or code that can't be loaded.
        """
        entry = self.known.get(name)
        if FILE not in name and entry is None:
            near = nearest(name, self.known)
            right = f"did you mean {near!r}?" if near else f"expected one of {', '.join(self.known)}, or {self.own}"
            raise PlugInError(f"unknown {self.noun} {name!r}", right)
        try:
            found = entry.load() if entry else self._class_of_file(name, base, snapshot)
        except PlugInError:
            raise
        except Exception as error:
            raise PlugInError(f"{name!r} can't be imported: {type(error).__name__}: {error}") from error
        if not (isinstance(found, type) and issubclass(found, self.base)):
            right = f"expected a subclass of {self.base.__module__}.{self.base.__name__}"
            raise PlugInError(f"{name!r} is not a {self.noun}", right)
        return found

    def of(self, value: Value) -> type[PlugIn]:
        """Return the class that a configuration's value names: an entry point, or what `plug_in_value` gives.

        Raises:
            PlugInError: there is none, or the file is not the one that the campaign was read with.
        """
        if isinstance(value, str) and FILE not in value:
            return self.find(value)
        match value:
            case [FileContent() as file, str() as name]:
                path = Path(file.path)
                kept = next(iter(file.plug_ins.values())) if isinstance(file, PlugInFile) else None
                snapshot = kept or snapshot_of(path, path.parent)
                if snapshot.digest != file.digest:
                    raise PlugInError(f"{file.path} changed since the campaign was read", "run the campaign again")
                return self.find(f"{path}:{name}", snapshot=snapshot)
        raise PlugInError(f"unknown {self.noun} {value!r}", f"expected one of {', '.join(self.known)}, or {self.own}")

    def _class_of_file(self, name: str, base: Path, snapshot: Snapshot | None) -> object:
        file, class_name = plug_in_file(name, base), name.rpartition(":")[2]
        if snapshot is None and not is_file(file):
            raise PlugInError(f"there is no file {str(file)!r}", f"name {self.own}")
        module = module_of(snapshot or snapshot_of(file, base if self.is_beside_campaign else file.parent))
        if not hasattr(module, class_name):
            known = [
                each
                for each, kind in vars(module).items()
                if isinstance(kind, type) and issubclass(kind, self.base) and kind.__module__ == module.__name__
            ]
            right = did_you_mean(class_name, known, f"expected a class of it that is a {self.base.__name__}")
            raise PlugInError(f"{str(file)!r} has no class {class_name!r}", right)
        found: object = getattr(module, class_name)
        return found


def plug_in_value(name: Value, base: Path) -> Value:
    """Return the value of a plug-in's name: of `file.py:Class` below `base` the file and the class.

    What names no file that can be copied stays as it is, and is a fault of the scenario.
    """
    if isinstance(name, str) and FILE in name and is_file(file := plug_in_file(name, base)):
        with suppress(PlugInError):
            snapshot = snapshot_of(file, base)
            return [PlugInFile(str(file), snapshot.digest, {name: snapshot}), name.rpartition(":")[2]]
    return name


def plug_in_file(name: str, base: Path) -> Path:
    """Return the file in a plug-in's name; relative paths start at `base`."""
    return base / name.rpartition(":")[0]
