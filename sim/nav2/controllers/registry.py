"""How a controller is found: by its name in the entry-point group, or in a file of its own."""

import functools
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Final

from vastflow.sim.model.files import is_file
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.nav2.controllers.controller import Controller
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.mppi import MppiParameters
from vastflow.sim.nav2.parameters.parameter import ParameterGroup
from vastflow.sim.nav2.parameters.rpp import RppParameters
from vastflow.sim.plug_ins.loading import module_of
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.snapshot import Snapshot, snapshot_of

GROUP: Final = "vastflow.controllers"
FILE: Final = ".py:"
"""In the name of a controller in a file, `my_pursuit.py:PurePursuit`."""

OWN: Final = "file.py:Class for one of your own, relative to the parameter file"


_APART: Final[Mapping[str, type[ParameterGroup]]] = {
    "vastflow.sim.nav2.controllers.dwb:Dwb": DwbParameters,
    "vastflow.sim.nav2.controllers.mppi:Mppi": MppiParameters,
    "vastflow.sim.nav2.controllers.rpp:Rpp": RppParameters,
}
"""Entry points of controllers whose parameters stand apart from their kernels: who only reads a campaign needs no numba."""


class UnknownController(LookupError):
    """No controller can be had under a name: `what` was found, and what would be `right`."""

    def __init__(self, what: str, right: str) -> None:
        super().__init__(f"{what}; {right}")
        self.what = what
        self.right = right


@functools.cache
def known_controllers() -> Mapping[str, EntryPoint]:
    """The entry-point group `vastflow.controllers`: names as `plugin` has them in a Nav2 parameter file, sorted.

    Raises:
        RuntimeError: not even vastflow's own are there, as after an update of an editable install's source alone.
    """
    found = dict(sorted((entry.name, entry) for entry in entry_points(group=GROUP)))
    if not any(entry.module.startswith("vastflow.") for entry in found.values()):
        right = "install it again: pip install -e . in a checkout"
        raise RuntimeError(
            f"vastflow is installed without its controllers, its metadata is older than its source; {right}"
        )
    return found


def short_names() -> Mapping[str, str]:
    """What the key `controller` of a campaign file calls those that are installed, `mppi`, to their names in the group."""
    return dict(sorted((entry.attr.lower(), name) for name, entry in known_controllers().items()))


def short_name(name: str) -> str:
    """What the key `controller` calls an installed controller; the class of one in a file."""
    entry = known_controllers().get(name)
    return name.rpartition(":")[2] if entry is None else entry.attr.lower()


def name_of(kind: type[ParameterGroup]) -> str:
    """The name in the group of an installed controller, or of the one whose parameters these are."""
    own = f"{kind.__module__}:{kind.__qualname__}"
    value = next((value for value, parameters in _APART.items() if parameters is kind), own)
    return next(name for name, entry in known_controllers().items() if entry.value == value)


def controller_file(name: str, base: Path) -> Path:
    """The file in the name of a controller; a relative one lies below `base`."""
    return base / name.rpartition(":")[0]


def find_parameters(name: str, base: Path = Path(), snapshot: Snapshot | None = None) -> type[ParameterGroup]:
    """The parameters of the controller called `name`: a class of their own, or the controller's.

    Args and errors are those of `find_controller`.
    """
    entry = known_controllers().get(name)
    apart = None if entry is None else _APART.get(entry.value)
    return apart or find_controller(name, base, snapshot)


def find_controller(name: str, base: Path = Path(), snapshot: Snapshot | None = None) -> type[Controller]:
    """The class called `name` in the entry-point group, or `file.py:Class`.

    Args:
        base: The folder that a file is relative to.
        snapshot: The file as it was before, which is loaded in place of it.

    Raises:
        UnknownController: no such entry point, file or class, a class that is no controller, or a file that can't be loaded.
    """
    if FILE in name:
        found = _class_of_file(name, controller_file(name, base), snapshot)
    else:
        entry = known_controllers().get(name)
        if entry is None:
            right = f"{did_you_mean(name, known_controllers())}; {OWN}"
            raise UnknownController(f"no controller {name!r} is known", right)
        found = entry.load()
    if not (isinstance(found, type) and issubclass(found, Controller)):
        right = "a subclass of vastflow.sim.nav2.controllers.controller.Controller"
        raise UnknownController(f"{name!r} is no controller", right)
    return found


def _class_of_file(name: str, file: Path, snapshot: Snapshot | None) -> object:
    class_name = name.rpartition(":")[2]
    if snapshot is None and not is_file(file):
        raise UnknownController(f"no file {str(file)!r}", OWN)
    try:
        module = module_of(snapshot or snapshot_of(file, file.parent))
    except PlugInError as error:
        raise UnknownController(error.what, error.right) from None
    except Exception as error:
        what = f"{str(file)!r} can't be imported: {type(error).__name__}: {error}"
        raise UnknownController(what, "a Python module") from error
    if not hasattr(module, class_name):
        known = [each for each, kind in vars(module).items() if _is_own(kind, module.__name__)]
        right = did_you_mean(class_name, known, "a class of it that is a Controller", listed="it has:")
        raise UnknownController(f"{str(file)!r} has no class {class_name!r}", right)
    found: object = getattr(module, class_name)
    return found


def _is_own(found: object, module: str) -> bool:
    return isinstance(found, type) and issubclass(found, Controller) and found.__module__ == module
