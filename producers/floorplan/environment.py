"""An environment: everything made of one floor plan, as files; and where producers keep theirs."""

import contextlib
import hashlib
import json
import os
import shutil
import uuid
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import platformdirs

from vastflow.producers.floorplan.building import Building
from vastflow.producers.floorplan.grid import FloorGrid
from vastflow.producers.floorplan.plan import Outline
from vastflow.sim.model.digest import FileContent, digest

MAP: Final = "map.yaml"
PICTURE: Final = "map.pgm"
MESH: Final = "mesh.stl"
PLAN: Final = "floorplan.fpm"
PROVENANCE: Final = "provenance.json"

STORE: Final = "VASTFLOW_STORE"
FOLDER: Final = "environments"

_FOLDER: ContextVar[Path | None] = ContextVar("environments", default=None)


@dataclass(frozen=True)
class Environment:
    """The files of an environment.

    Attributes:
        files: Name to content: map, picture, mesh and plan. The same plan gives the same bytes.
        map_digest: Of the decoded map, as `vastflow.sim.world.map_file.map_content` has it.
        mesh_digest: Of what is solid, whatever triangles a version of a library makes of it.
        provenance: Where it came from; in no digest.
    """

    files: Mapping[str, bytes]
    map_digest: str
    mesh_digest: str
    provenance: Mapping[str, Any]

    @property
    def digest(self) -> str:
        """Digest of the names and contents of the files."""
        return digest({name: hashlib.sha256(content).hexdigest() for name, content in self.files.items()})


def environment_of(building: Building, grid: FloorGrid, text: str, provenance: Mapping[str, Any]) -> Environment:
    """The environment of a building, `text` being its plan."""
    from vastflow.producers.floorplan.mesh import mesh_of, stl  # scipy takes a fifth of a second

    files = {
        MAP: grid.header(PICTURE),
        PICTURE: grid.picture(),
        MESH: stl(mesh_of(building)),
        PLAN: text.encode(),
    }
    return Environment(files, grid.occupancy.digest, solid_digest(building), provenance)


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
    """Return the folder of environments: that of `environments_in`, or the store's."""
    if (chosen := _FOLDER.get()) is not None:
        return chosen
    root = os.environ.get(STORE, "")
    if "://" in root:  # an address; which folder of this machine belongs to it only its workers are told
        root = ""
    return (Path(root).expanduser() if root else Path(platformdirs.user_cache_dir("vastflow"), "store")) / FOLDER


def keep(environment: Environment) -> tuple[FileContent, FileContent]:
    """Write the environment into a folder named by its digest, unless it is there, whole: the map and the mesh.

    Another process may do the same at the same time: the folder appears whole, whoever is first.
    """
    root = environments_folder().absolute()
    place = root / environment.digest
    if not _is_whole(place, environment):
        prepared = root / f".{uuid.uuid4().hex}"
        prepared.mkdir(parents=True)
        for name, content in environment.files.items():
            (prepared / name).write_bytes(content)
        (prepared / PROVENANCE).write_text(json.dumps(environment.provenance, indent=1) + "\n", encoding="utf-8")
        _move(prepared, place, environment)
    return (
        FileContent(str(place / MAP), environment.map_digest),
        FileContent(str(place / MESH), environment.mesh_digest),
    )


def _is_whole(place: Path, environment: Environment) -> bool:
    try:
        return all((place / name).read_bytes() == content for name, content in environment.files.items())
    except OSError:
        return False


def _move(prepared: Path, place: Path, environment: Environment) -> None:
    """Move a folder into place; what lies there is another writer's, or damaged and in the way."""
    with contextlib.suppress(OSError):
        prepared.rename(place)
        return
    if not _is_whole(place, environment):
        with contextlib.suppress(OSError):
            place.rename(prepared.with_suffix(".damaged"))
        shutil.rmtree(prepared.with_suffix(".damaged"), ignore_errors=True)
        with contextlib.suppress(OSError):
            prepared.rename(place)
            return
    shutil.rmtree(prepared, ignore_errors=True)
    if not _is_whole(place, environment):
        raise OSError(f"can't keep an environment in {str(place.parent)!r}")
