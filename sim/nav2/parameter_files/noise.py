"""The lidar's noise as a scenario's value: a name, or a file with its content, and a class in it."""

from contextlib import suppress
from pathlib import Path

from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.files import is_file
from vastflow.sim.model.parameter import ParameterGroup
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import FILE, plug_in_file
from vastflow.sim.plug_ins.snapshot import PlugInFile, snapshot_of
from vastflow.sim.world.noise_registry import NOISE_PLUG_INS


def noise_value(name: Value, base: Path) -> Value:
    """Return the value of a model's name: of `file.py:Class` below `base` the file and the class.

    What names no file that can be copied stays as it is, and is a fault of the scenario.
    """
    if isinstance(name, str) and FILE in name and is_file(file := plug_in_file(name, base)):
        with suppress(PlugInError):
            snapshot = snapshot_of(file, base)
            return [PlugInFile(str(file), snapshot.digest, {name: snapshot}), name.rpartition(":")[2]]
    return name


def noise_of(chosen: Value) -> type[ParameterGroup]:
    """Return the parameters of the model that a value names.

    Raises:
        PlugInError: there is none, or the file is not the one that the campaign was read with.
    """
    if isinstance(chosen, str) and FILE not in chosen:
        return NOISE_PLUG_INS.parameters(chosen)
    match chosen:
        case [FileContent() as file, str() as name]:
            path = Path(file.path)
            kept = next(iter(file.plug_ins.values())) if isinstance(file, PlugInFile) else None
            snapshot = kept or snapshot_of(path, path.parent)
            if snapshot.digest != file.digest:
                raise PlugInError(f"{file.path} changed since the campaign was read", "run the campaign again")
            return NOISE_PLUG_INS.find(f"{path}:{name}", snapshot=snapshot)
    known = ", ".join(NOISE_PLUG_INS.known)
    raise PlugInError(f"no lidar noise model {chosen!r} is known", f"known: {known}; {NOISE_PLUG_INS.own}")
