"""An environment: everything made of one floor plan, as files; and where producers keep theirs."""

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Final

import platformdirs

from vastflow.producers.floorplan.building import Building
from vastflow.producers.floorplan.geometry import Outline
from vastflow.producers.floorplan.grid import FloorGrid
from vastflow.sim.model.digest import FileContent, digest
from vastflow.sim.model.files import keep_folder

MAP: Final = "map.yaml"
PICTURE: Final = "map.pgm"
MESH: Final = "mesh.stl"
PLAN: Final = "floorplan.fpm"
PROVENANCE: Final = "provenance.json"

STORE: Final = "VASTFLOW_STORE"
FOLDER: Final = "environments"

_FOLDER: ContextVar[Path | None] = ContextVar("environments", default=None)


def solid_digest(building: Building) -> str:
    """Digest of walls, obstacles and openings to the micrometer, without their names."""

    def micrometers(outline: Outline) -> list[float]:
        return [round(coordinate, 6) + 0.0 for point in outline for coordinate in point]

    return digest(
        [[wall.height_m, micrometers(wall.outline)] for wall in building.walls],
        [[obstacle.height_m, micrometers(obstacle.outline)] for obstacle in building.obstacles],
        [[hole.depth_m, micrometers(hole.outline), micrometers(hole.shape)] for hole in building.holes],
    )


@contextlib.contextmanager
def environments_in(folder: Path) -> Iterator[None]:
    """Keep environments in `folder` inside of this context, as a worker does in its store."""
    token = _FOLDER.set(folder)
    try:
        yield
    finally:
        _FOLDER.reset(token)


def environments_folder() -> Path:
    """Return the folder of environments: from `environments_in`, or the store's."""
    if (chosen := _FOLDER.get()) is not None:
        return chosen
    root = os.environ.get(STORE, "")
    if "://" in root:  # an address; which folder of this machine belongs to it only its workers are told
        root = ""
    return (Path(root).expanduser() if root else Path(platformdirs.user_cache_dir("vastflow"), "store")) / FOLDER


def keep_environment(
    building: Building, grid: FloorGrid, text: str, provenance: Mapping[str, Any]
) -> tuple[FileContent, FileContent]:
    """Keep the files of a building in a folder named by their digest; return its map and its mesh.

    The same plan gives the same bytes. The digest of the map is that of the decoded map, as
    `vastflow.sim.world.world.map_content` has it; that of the mesh is of what is solid, whatever triangles a version of
    a library makes of it.

    Args:
        text: Text of the plan.
        provenance: Content of `provenance.json`, which is in no digest.
    """
    from vastflow.producers.floorplan.mesh import mesh_of, stl  # scipy takes a fifth of a second

    files = {
        MAP: grid.header(PICTURE),
        PICTURE: grid.picture(),
        MESH: stl(mesh_of(building)),
        PLAN: text.encode(),
    }
    name = digest({name: hashlib.sha256(content).hexdigest() for name, content in files.items()})
    folder = environments_folder().absolute() / name
    try:
        keep_folder(folder, files, {PROVENANCE: f"{json.dumps(provenance, indent=1)}\n".encode()})
    except OSError as error:
        raise OSError(f"can't keep an environment in {str(folder.parent)!r}: {error}") from error
    map_file = FileContent(str(folder / MAP), grid.occupancy.digest)
    return map_file, FileContent(str(folder / MESH), solid_digest(building))
