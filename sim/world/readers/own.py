"""Worlds that a reader beside the campaign file makes, kept as files of their bodies."""

import hashlib
from pathlib import Path
from typing import Final

import platformdirs

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import message_of
from vastflow.sim.model.files import keep_folder
from vastflow.sim.plug_ins.effects import plug_in_code, watched
from vastflow.sim.plug_ins.loading import module_of
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import FILE, plug_in_file
from vastflow.sim.plug_ins.snapshot import PlugInFile, snapshot_of
from vastflow.sim.world.environment import difference_of
from vastflow.sim.world.readers.body_list import BODIES
from vastflow.sim.world.readers.reader import WorldError
from vastflow.sim.world.readers.registry import checked_bodies
from vastflow.sim.world.world import world_content

_NAME: Final = "world.bodies.json"


def world_value(value: Value, base: Path) -> Value:
    """Return the world of a file, or of the reader `file.py:Class`, relative to `base`; a difference as it is.

    A reader is given the path of the copy of its own file, with the files that it declares beside it. The bodies that it gives are kept as a file: who runs in the world needs no reader.

    Raises:
        WorldError: no such file or class, one that can't be used, or whatever the class raises.
        ScenarioError: another value, that is no difference from the map.
    """
    if not isinstance(value, str):
        difference_of(value)
        return value
    if FILE not in value:
        return world_content(base / value)
    file, class_name = plug_in_file(value, base), value.rpartition(":")[2]
    try:
        snapshot = snapshot_of(file, base)
        reader = getattr(module_of(snapshot), class_name)
        with plug_in_code(), watched(snapshot):
            bodies = tuple(reader.read(snapshot.file))
        content = BODIES.dump_json(bodies, exclude_defaults=True, warnings="error")
        checked_bodies(bodies, f"{file}: {class_name}")
        folder = Path(platformdirs.user_cache_dir("vastflow"), "worlds", hashlib.sha256(content).hexdigest()[:32])
        keep_folder(folder, {_NAME: content})
    except WorldError:
        raise
    except PlugInError as error:
        raise WorldError(message_of(f"{file}: {class_name}: {error.problem}", error.expected)) from None
    except Exception as error:
        raise WorldError(f"{file}: {class_name}: {type(error).__name__}: {' '.join(str(error).split())}") from error
    found = world_content(folder / _NAME)
    return PlugInFile(found.path, found.digest, {value: snapshot})
