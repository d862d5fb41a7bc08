"""The world of a scenario's environment: its map, and its own file or how it differs from the map."""

from collections.abc import Mapping
from typing import Final

from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.world.difference import WorldDifference
from vastflow.sim.world.world import World, read_world

MAP_KEY: Final = "map_file"
WORLD_KEY: Final = "world"
GROUND_KEYS: Final = (MAP_KEY, WORLD_KEY)
"""Keys of files on whose ground things are placed: on that of the map where there are both."""
LONGEST_M: Final = 1000.0
SHORTEST_M: Final = 0.5
"""Minimum correlation length: offsets are computed at fractions of it all over the map."""
_NAMES: Final = ("seed", "wall_offset", "correlation_length", "missing_furniture")


def world_of(environment: Mapping[str, Value]) -> World | None:
    """Return the world of a scenario's environment; None if it names none.

    Raises:
        ScenarioError: a file can't be read or has changed, or the difference is none.
    """
    files = world_files(environment)
    map_file, own = files.get(MAP_KEY), files.get(WORLD_KEY)
    if map_file is not None:
        return read_world(map_file, difference_of(environment.get(WORLD_KEY)), own)
    found = None if own is None else read_world(own)
    return found if found is None or found.map is None else World(None, cells=found.map, source=own)  # it is not known


def world_files(values: Mapping[str, Value]) -> dict[str, FileContent]:
    """Return the files of a map and a world by their keys, as far as there are any."""
    found = {key: values.get(key) for key in GROUND_KEYS}
    return {key: value for key, value in found.items() if isinstance(value, FileContent)}


def ground_file(values: Mapping[str, Value]) -> FileContent | None:
    """Return the file on whose ground things are placed: the map, or the world's own where there is no map."""
    return next(iter(world_files(values).values()), None)


def world_file_of(value: Value) -> FileContent | None:
    """Return the world's own file under the key `world`, or None."""
    return value if isinstance(value, FileContent) else None


def difference_of(value: Value) -> WorldDifference | None:
    """Return the world's difference from the map under the key `world`, or None.

    Raises:
        ScenarioError: the value has another form, or a number is out of its bounds.
    """
    if value is None or isinstance(value, FileContent):
        return None
    if not isinstance(value, Mapping) or (unknown := set(value) - set(_NAMES)):
        found = repr(value) if not isinstance(value, Mapping) else ", ".join(sorted(unknown))
        raise ScenarioError(
            f"{WORLD_KEY}: expected the path of a world, or a mapping of {', '.join(_NAMES)}, as WorldVariation writes it, got {found}"
        )
    seed = value.get("seed", 0)
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise ScenarioError(f"{WORLD_KEY}.seed: expected a whole number from 0, got {seed!r}")
    difference = WorldDifference(
        seed,
        _number(value, "wall_offset", 0.0, 0.0, LONGEST_M),
        _number(value, "correlation_length", 2.0, SHORTEST_M, LONGEST_M),
        _number(value, "missing_furniture", 0.0, 0.0, 1.0),
    )
    return difference if difference.wall_offset_m > 0.0 or difference.missing_share > 0.0 else None


def _number(value: Mapping[str, Value], name: str, usual: float, least: float, most: float) -> float:
    found = value.get(name, usual)
    if isinstance(found, bool) or not isinstance(found, int | float) or not least <= found <= most:
        raise ScenarioError(f"{WORLD_KEY}.{name}: expected a number from {least:g} to {most:g}, got {found!r}")
    return float(found)
