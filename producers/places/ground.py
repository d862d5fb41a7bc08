"""The ground: a map, and the cells where a robot of given size can stand."""

import functools
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainSerializer, PlainValidator, ValidationInfo, WithJsonSchema
from pydantic_core import PydanticCustomError

from vastflow.producers.model.configuration import Rejection
from vastflow.producers.model.faults import MISSING_FILE
from vastflow.producers.model.producer import ROOM_KEY
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.files import is_file
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.nav2.parameter_files.costmaps import MASK_KEYS
from vastflow.sim.world.map_file import MapError, MissingMap, load_map, map_content
from vastflow.sim.world.occupancy import OccupancyMap


@dataclass
class MapSearch:
    """Finds the maps of one campaign file.

    A map is looked for below the file's folder first, then by the same relative path below `map_dir`. Of an absolute path, which is one
    of another machine, the longest end counts that is there. Where it was found is in no digest: those cover what the maps hold.

    Attributes:
        base: The campaign file's folder.
        map_dir: Folder of maps that are not beside the file.
        borrowed: Path of each map that was found there, to its name in the campaign file; grows with `content`.
    """

    base: Path
    map_dir: Path | None = None
    borrowed: dict[str, str] = field(default_factory=dict)

    def content(self, name: str) -> FileContent:
        """The map that the campaign file calls `name`.

        Raises:
            MissingMap: it is in neither place.
            MapError: it is no map.
            ValueError: the name is none that a file can have.
        """
        path = self.base / name
        if is_file(path):
            return map_content(path)
        if self.map_dir is None:
            if os.path.lexists(path):
                return map_content(path)
            raise MissingMap(
                f"{path}: no such file; a map is a map_server YAML file, here or at this place in a folder that --map-dir names"
            )
        there = [self.map_dir / end for end in _ends(name)]
        borrowed = next((each for each in there if is_file(each)), None)
        if borrowed is None:
            offered = self._offered()
            right = did_you_mean(name, offered) if offered else f"another --map-dir; {self.map_dir} has no map"
            raise MissingMap(f"{path}: no such file, and no {there[-1]}; {right}")
        found = map_content(borrowed)
        self.borrowed[found.path] = name
        return found

    def _offered(self) -> list[str]:
        """Return the names of possible maps in `map_dir`, at most two folders deep."""
        assert self.map_dir is not None
        patterns = ("*.yaml", "*/*.yaml", "*/*/*.yaml")
        found = [file for pattern in patterns for file in self.map_dir.glob(pattern)]
        return sorted(Path(os.path.relpath(file, self.map_dir)).as_posix() for file in found)


def _ends(name: str) -> list[str]:
    """Return the paths to look for below another folder; of an absolute path its ends, the longest first."""
    parts = Path(name).parts
    return ["/".join(parts[k:]) for k in range(1, len(parts))] if Path(name).is_absolute() else [name]


MAP_KEY: Final = "map_file"
MAP_FILE_KEYS: Final = (MAP_KEY, *MASK_KEYS)
"""Keys whose values are paths of maps."""


@dataclass(frozen=True, eq=False)
class Ground:
    """The cells of a map on which a robot's center may be.

    Attributes:
        room_m: How far from walls its center is wherever it begins or ends.
        radius_cells: The robot's radius, rounded up to whole cells.
        passable: (H, W), True where the robot fits.
        stops: (H, W), True where it may begin or end: where it fits and has that room.
        cells: (N, 2) row and column of each passable cell, in reading order.
        component: (N,) number of the connected component of each of `cells`, from 1.
        component_cells: (N,) how many cells that component has.
    """

    occupancy: OccupancyMap
    robot_diameter_m: float
    room_m: float
    radius_cells: int
    passable: NDArray[np.bool_]
    stops: NDArray[np.bool_]
    cells: NDArray[np.int64]
    component: NDArray[np.int64]
    component_cells: NDArray[np.int64]

    @property
    def robot_text(self) -> str:
        """The robot, for a sentence."""
        return f"a robot {self.robot_diameter_m:g} m across"

    @property
    def stopping_robot_text(self) -> str:
        """The robot with the room that it has where it begins or ends, for a sentence."""
        return f"{self.robot_text} that stops {self.room_m:.3f} m from walls" if self.room_m else self.robot_text

    def stands(self, x_m: float, y_m: float) -> bool:
        """Whether the robot can stand at a map position."""
        row, column = self.occupancy.cell_of(x_m, y_m)
        return self.occupancy.contains(row, column) and bool(self.passable[row, column])


@functools.lru_cache(maxsize=4)
def ground_of(map_file: FileContent, robot_diameter_m: float, room_m: float = 0.0) -> Ground:
    """The ground of a robot on a map; kept for the next evaluation, a large map costs half a second.

    Args:
        room_m: How far from the nearest wall its center must be to begin or end there.

    Raises:
        MapError: the file can't be read any more, or holds another map than when the campaign was read.
    """
    from skimage.measure import label  # half a second with what follows, see `vastflow.producers.places.cells`

    from vastflow.sim.world import octile

    occupancy = occupancy_of(map_file)
    radius_cells = octile.whole_cells(robot_diameter_m / 2, occupancy.resolution_m)
    passable = octile.inflated_free(occupancy.free, radius_cells)
    labels = label(passable, connectivity=2)
    component = labels[passable].astype(np.int64)
    component_cells = np.bincount(component)[component]
    stops = passable & ~_near(occupancy.occupied, room_m / occupancy.resolution_m)
    cells = np.argwhere(passable)
    return Ground(occupancy, robot_diameter_m, room_m, radius_cells, passable, stops, cells, component, component_cells)


def _near(occupied: NDArray[np.bool_], room_cells: float) -> NDArray[np.bool_]:
    """(H, W), True where an occupied cell, all of its square, begins at most `room_cells` from a cell's center."""
    from scipy import ndimage

    near = np.zeros_like(occupied)
    for rows in range(math.floor(room_cells + 0.5) + 1 if room_cells > 0.0 else 0):
        along = math.floor(math.sqrt(room_cells**2 - max(rows - 0.5, 0.0) ** 2) + 0.5)
        wide = ndimage.maximum_filter1d(occupied, 2 * along + 1, axis=1, mode="constant")
        near[: len(near) - rows] |= wide[rows:]
        near[rows:] |= wide[: len(near) - rows]
    return near


@functools.lru_cache(maxsize=4)
def occupancy_of(map_file: FileContent) -> OccupancyMap:
    """The map of a file's value; kept for the next question.

    Raises:
        MapError: as of `ground_of`.
    """
    occupancy = load_map(map_file.path)
    if occupancy.digest != map_file.digest:
        raise MapError(f"{map_file.path}: was changed while the campaign ran; start it again")
    return occupancy


def map_of(inputs: Mapping[str, Value], parameter: FileContent | str | None) -> FileContent | Rejection:
    """The map a producer works on: its own parameter, the key that names, or the configuration's `map_file`."""
    if isinstance(parameter, FileContent):
        return parameter
    key = map_key(parameter)
    found = inputs.get(key)
    if isinstance(found, FileContent):
        return found
    return Rejection(f"the configuration's {key} is {found!r}, not a map file", {})


def room_of(inputs: Mapping[str, Value]) -> float:
    """Return the distance from walls at which the robot may begin or end (m); 0 by default."""
    found = inputs.get(ROOM_KEY)
    return float(found) if isinstance(found, int | float) else 0.0


def map_key(parameter: FileContent | str | None) -> str:
    """The configuration's key that holds the map."""
    return parameter.removeprefix("@") if isinstance(parameter, str) else MAP_KEY


def map_needed(parameter: FileContent | str | None) -> tuple[str, ...]:
    """The key of the map that must have been written before; none where the parameters name a file."""
    return () if isinstance(parameter, FileContent) else (map_key(parameter),)


def map_value(value: Any, info: ValidationInfo) -> FileContent:
    """Read a path as a map, by the validation context's `maps`, else relative to its `base`, the campaign file's folder.

    Raises:
        PydanticCustomError: no text, or no map there.
    """
    if isinstance(value, FileContent):
        return value
    if not isinstance(value, str):
        raise PydanticCustomError(
            "map_file", "expected the path of a map_server YAML file, got {found}", {"found": repr(value)}
        )
    try:
        return _search(info).content(value)
    except MapError as error:
        kind = MISSING_FILE if isinstance(error, MissingMap) else "map_file"
        raise PydanticCustomError(kind, "{error}", {"error": str(error)}) from None


def _search(info: ValidationInfo) -> MapSearch:
    context = info.context or {}
    found = context.get("maps")
    return found if isinstance(found, MapSearch) else MapSearch(Path(context.get("base", ".")))


def _map_parameter(value: Any, info: ValidationInfo) -> FileContent | str | None:
    if value is None or (isinstance(value, str) and value.startswith("@")):
        return value
    return map_value(value, info)


def serializable(value: Value) -> Value:
    """`value` for JSON, files as `{"file": digest}`."""
    if isinstance(value, FileContent):
        return {"file": value.digest}
    if isinstance(value, Mapping):
        return {key: serializable(item) for key, item in value.items()}
    return [serializable(item) for item in value] if isinstance(value, list | tuple) else value


MapParameter: TypeAlias = Annotated[
    FileContent | str | None,
    PlainValidator(_map_parameter),
    PlainSerializer(serializable, return_type=Any),
    WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "null"}]}),
]
"""A map file, or `@key` of the configuration's key that holds one, or nothing: the configuration's `map_file`."""
