"""Worlds of bodies: as a reader beside the campaign file makes them, and as files of theirs in JSON."""

import hashlib
from pathlib import Path
from typing import ClassVar, Final

import platformdirs
from pydantic import TypeAdapter, ValidationError

from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.files import keep_folder, read_bytes
from vastflow.sim.plug_ins.effects import plug_in_code
from vastflow.sim.plug_ins.loading import module_of
from vastflow.sim.plug_ins.registry import FILE, plug_in_file
from vastflow.sim.plug_ins.snapshot import PlugInFile, snapshot_of
from vastflow.sim.world.bodies import Body
from vastflow.sim.world.readers.reader import FARTHEST_M, WorldError
from vastflow.sim.world.world import world_content

_BODIES: Final = TypeAdapter(tuple[Body, ...])
_NAME: Final = "world.bodies.json"


class Bodies:
    """Reader of lists of bodies in JSON."""

    suffixes: ClassVar[tuple[str, ...]] = (".bodies.json",)

    @staticmethod
    def files(path: Path) -> list[Path]:
        return [path]

    @staticmethod
    def read(path: Path) -> tuple[Body, ...]:
        try:
            bodies = _BODIES.validate_json(read_bytes(path, "a list of bodies"))
        except ValidationError as error:
            first = error.errors()[0]
            place = "".join(f"[{part!r}]" for part in first["loc"])
            raise WorldError(f"{path}: {place}: expected bodies, got one where {first['msg']}") from None
        for body in bodies:
            outline = body.outline
            is_near = all(abs(bound) <= 2 * FARTHEST_M for bound in outline.bounds)
            if not (is_near and outline.area > 0.0 and body.bottom_m < body.top_m):
                right = f"an area within {2 * FARTHEST_M:g} m of the origin, and heights in order"
                raise WorldError(f"{path}: {body.name}: expected {right}, got {body.shape} at {body.pose}")
        return bodies


def world_value(name: str, base: Path) -> FileContent:
    """Return a world by its file, or by the reader `file.py:Class` that makes it, both relative to `base`.

    A reader is given the path of its own file. The bodies that it gives are kept as a file: who runs in the world needs no reader.

    Raises:
        WorldError: no such file or class, one that can't be used, or whatever the class raises.
    """
    if FILE not in name:
        return world_content(base / name)
    file, class_name = plug_in_file(name, base), name.rpartition(":")[2]
    try:
        snapshot = snapshot_of(file, base)
        with plug_in_code():
            bodies = tuple(getattr(module_of(snapshot), class_name).read(file))
        content = _BODIES.dump_json(bodies, exclude_defaults=True, warnings="error")
    except WorldError:
        raise
    except Exception as error:
        raise WorldError(f"{file}: {class_name}: {type(error).__name__}: {' '.join(str(error).split())}") from error
    folder = Path(platformdirs.user_cache_dir("vastflow"), "worlds", hashlib.sha256(content).hexdigest()[:32])
    keep_folder(folder, {_NAME: content})
    found = world_content(folder / _NAME)
    return PlugInFile(found.path, found.digest, {name: snapshot})
