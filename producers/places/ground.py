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
from pydantic import Field, PlainSerializer, PlainValidator, ValidationInfo, WithJsonSchema
from pydantic_core import PydanticCustomError
from shapely.geometry import Polygon
from shapely.geometry.polygon import orient

from vastflow.producers.model.faults import MISSING_FILE
from vastflow.producers.model.producer import ROOM_KEY
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import message_of
from vastflow.sim.model.files import is_file
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.system.keys import MASK_KEYS
from vastflow.sim.world.environment import MAP_KEY
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.readers.reader import MissingWorld
from vastflow.sim.world.world import map_content, read_grid


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
            MissingWorld: it is in neither place.
            WorldError: it is no map.
            ValueError: the name is none that a file can have.
        """
        path = self.base / name
        if is_file(path) or (self.map_dir is None and os.path.lexists(path)):
            return map_content(path)
        if self.map_dir is None:
            right = "Expected a map_server YAML file, here or at this place in a folder that --map-dir names."
            raise MissingWorld(f"{path}: No such file. {right}")
        parts = Path(name).parts
        ends = ["/".join(parts[k:]) for k in range(1, len(parts))] if Path(name).is_absolute() else [name]
        there = [self.map_dir / end for end in ends]
        borrowed = next(filter(is_file, there), None)
        if borrowed is None:
            files = [file for depth in ("*", "*/*", "*/*/*") for file in self.map_dir.glob(f"{depth}.yaml")]
            offered = sorted(file.relative_to(self.map_dir).as_posix() for file in files)
            right = did_you_mean(name, offered, f"{str(self.map_dir)!r} has no map, so name another --map-dir")
            raise MissingWorld(f"{path}: {message_of(f'no such file, and no {there[-1]}', right)}")
        found = map_content(borrowed)
        self.borrowed[found.path] = name
        return found


MAP_FILE_KEYS: Final = (MAP_KEY, *MASK_KEYS)
"""Keys whose values are paths of maps."""


@dataclass(frozen=True, eq=False)
class Ground:
    """The cells of a map on which a robot's center may be.

    Attributes:
        room_m: Least distance of its center from walls wherever it begins or ends.
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
def ground_of(file: FileContent, robot_diameter_m: float, room_m: float = 0.0) -> Ground:
    """Return the ground of a robot on a map, or in a world without one; kept, as it is costly.

    Args:
        room_m: Least distance of its center from the nearest wall to begin or end there.

    Raises:
        WorldError: the file can't be read any more, or holds something else than when the campaign was read.
    """
    # Half a second for these, also where others import them in functions: none where all paths are in the store.
    from skimage.measure import label

    from vastflow.sim.world import octile

    occupancy = read_grid(file)
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
        along = math.floor(math.sqrt(room_cells * room_cells - max(rows - 0.5, 0.0) * max(rows - 0.5, 0.0)) + 0.5)
        wide = ndimage.maximum_filter1d(occupied, 2 * along + 1, axis=1, mode="constant")
        near[: len(near) - rows] |= wide[rows:]
        near[rows:] |= wide[: len(near) - rows]
    return near


def touched_cells(occupancy: OccupancyMap, area: Polygon, reach_cells: float = 0.5) -> NDArray[np.int64]:
    """(K, 2) row and column of the map's cells, walls or not, that a convex area touches.

    Args:
        reach_cells: Distance from a cell's center to the sides of the square that counts; 0: the center lies in the area.
    """
    outline = occupancy.frame.points_to_grid(np.array(orient(area).exterior.coords))
    occupancy = occupancy.upright
    (left, bottom), (right, top) = outline.min(axis=0).tolist(), outline.max(axis=0).tolist()
    first = np.maximum(occupancy.cell_of(left, bottom), 0)
    last = np.minimum(occupancy.cell_of(right, top), np.array(occupancy.shape) - 1)
    if np.any(last < first):  # it lies beside the map, however far
        return np.empty((0, 2), dtype=np.int64)
    rows, columns = np.mgrid[first[0] : last[0] + 1, first[1] : last[1] + 1]
    cells = np.column_stack((rows.ravel(), columns.ravel()))
    centers = (cells[:, ::-1] + 0.5) * occupancy.resolution_m + occupancy.origin_xy_m
    sides = np.diff(outline, axis=0)
    normals = np.column_stack((sides[:, 1], -sides[:, 0]))
    # Separating axes: the grid's own are the bounds above. A tenth of the time of one shapely box a cell.
    beyond = centers[:, :1] * normals[:, 0] + centers[:, 1:] * normals[:, 1] - np.sum(outline[:-1] * normals, axis=1)
    most = np.abs(normals).sum(axis=1) * occupancy.resolution_m * reach_cells
    return np.asarray(cells[~np.any(beyond > most, axis=1)])


def map_of(inputs: Mapping[str, Value], parameter: FileContent | str | None = None) -> FileContent:
    """The file on whose ground a producer places: its own parameter, that under a key, or the configuration's `map_file`.

    Raises:
        ValueError: there is none.
    """
    found = parameter if isinstance(parameter, FileContent) else inputs.get(map_key(parameter))
    if not (found and isinstance(found, FileContent)):
        raise ValueError(f"the configuration's {map_key(parameter)} is {found!r}, not a map file")
    return found


def room_of(inputs: Mapping[str, Value]) -> float:
    """Return the distance from walls at which the robot may begin or end (m); 0 by default."""
    found = inputs.get(ROOM_KEY)
    return float(found) if isinstance(found, int | float) else 0.0


def map_key(parameter: FileContent | str | None) -> str:
    """The configuration's key that holds the map, or the world."""
    return parameter.removeprefix("@") if isinstance(parameter, str) else MAP_KEY


def map_needed(parameter: FileContent | str | None) -> tuple[str, ...]:
    """The key of the map that must have been written before; none where the parameters name a file."""
    return () if isinstance(parameter, FileContent) else (map_key(parameter),)


def map_value(value: Any, info: ValidationInfo) -> FileContent:
    """Read a path as a map, by the validation context's `maps`, else relative to its `base`, the campaign file's folder.

    Raises:
        ValueError: no text, or no map there.
    """
    if isinstance(value, FileContent):
        return value
    if not (isinstance(value, str) and value):
        raise ValueError(f"expected the path of a map_server YAML file, got {value!r}")
    context = info.context or {}
    search: MapSearch = context.get("maps") or MapSearch(Path(context.get("base", ".")))
    try:
        return search.content(value)
    except MissingWorld as error:
        raise PydanticCustomError(MISSING_FILE, "{error}", {"error": str(error)}) from None


def _map_parameter(value: Any, info: ValidationInfo) -> FileContent | str | None:
    if value is None:  # of a family with a world and no map, the world
        return (info.context or {}).get(GROUND)
    return value if isinstance(value, str) and value.startswith("@") else map_value(value, info)


def serializable(value: Value) -> Value:
    """`value` for JSON, files as `{"file": digest}`."""
    if isinstance(value, FileContent):
        return {"file": value.digest}
    if isinstance(value, Mapping):
        return {key: serializable(item) for key, item in value.items()}
    return [serializable(item) for item in value] if isinstance(value, list | tuple) else value


GROUND: Final = "ground"
"""Key of the validation context with the default of a `MapParameter`."""
MapParameter: TypeAlias = Annotated[
    FileContent | str | None,
    Field(validate_default=True),
    PlainValidator(_map_parameter),
    PlainSerializer(serializable, return_type=Any),
    WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "null"}]}),
]
"""A map file, or `@key` of the configuration's key that holds one, or nothing: the configuration's `map_file`, or its `world` where
it has no map."""
