"""Varying values of each configuration, which may explain its outcome."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.results.tables import ConfigurationTable
from vastflow.oracles.results.units import numbers_of
from vastflow.sim.world.environment import MAP_KEY, WORLD_KEY

MEASURED: Final[Mapping[str, str]] = {"_path_length": "path length (m)"}
"""Provenance keys of numbers that follow from a draw, to their names; they are no factors."""

WORLD: Final[Mapping[str, str]] = {"_wall_offset_m": "wall offset (m)", "_missing_furniture": "missing furniture"}
"""Provenance keys of differences between world and map, to the names of factors."""

PATH_PROPERTIES: Final[Mapping[str, str]] = {
    "_narrowest_passage_m": "narrowest passage (m)",
    "_start_clearance_m": "clearance at start (m)",
    "_goal_clearance_m": "clearance at goal (m)",
    "_turning_rad": "turning (rad)",
    "_obstacles_near_path": "obstacles near the path",
}
"""Provenance keys of what surrounds a drawn path, to their names."""

_PLACED: Final = "_obstacles"
"""Provenance key of placed obstacles, with which properties of the path are known."""
_DIGITS: Final = 2
"""Centimeters: less than a cell of a map."""
_REQUESTED: Final = "_requested_"
"""Prefix of the provenance key of what the campaign file requested for a drawn value."""
_DRAW: Final = "draw"
"""Name, among requested values, of the number of a draw, which nobody chose."""


def chosen_values(configurations: ConfigurationTable, k: int) -> dict[str, Any]:
    """Values that the campaign file requests of configuration `k`, in place of values drawn from them."""
    requested = {n: value for n, (_, value) in _requested(configurations, k).items() if n.split(".")[-1] != _DRAW}
    steps = configurations.written[k]
    drawn = {key for keys in steps if any(key.startswith(_REQUESTED) for key in keys) for key in keys}
    drawn.discard(MAP_KEY)
    if WORLD.keys() & configurations.provenances[k].keys():
        drawn.add(WORLD_KEY)
    given = {key: value for key, value in configurations.factors[k].items() if key not in drawn}
    return given | requested | _measured(configurations.provenances[k], WORLD)


def chosen_rows(
    configurations: ConfigurationTable, chosen: Iterable[int], environments: Mapping[str, str]
) -> list[dict[str, Any]]:
    """`chosen_values` of the configurations `chosen`, files by their names."""
    return [
        {key: named(value, environments) for key, value in chosen_values(configurations, k).items()} for k in chosen
    ]


def matched_sets(configurations: ConfigurationTable, chosen: Sequence[int], factor: str) -> NDArray[np.int64]:
    """Numbers (m,) that are equal for configurations that are equal in all but `factor`.

    Values drawn from the factor, such as places of obstacles, may differ; poses may not.
    """
    abstracts = configurations.table["abstract"].to_pylist()
    return numbers_of([abstracts[k], *_all_but(configurations, k, factor)] for k in chosen)


def _all_but(configurations: ConfigurationTable, k: int, factor: str) -> list[Any]:
    requested = _requested(configurations, k)
    source = WORLD_KEY if factor in WORLD.values() else factor
    if factor in requested:
        source = _REQUESTED + requested[factor][0]
    own = {key for keys in configurations.written[k] if source in keys for key in keys} | {source}
    content = {name: dict(part) for name, part in configurations.contents[k].items() if part}
    for name, part in content.items():
        for key in own & part.keys():
            if name != "task" or key == factor:
                del part[key]
    beside = {name: value for name, (_, value) in requested.items() if name != factor}
    worlds = {name: value for name, value in _measured(configurations.provenances[k], WORLD).items() if name != factor}
    return [content, beside, worlds]


def _requested(configurations: ConfigurationTable, k: int) -> dict[str, tuple[str, Any]]:
    """Name to key and value of all requested values behind draws; a repeated name is prefixed by its key."""
    found: dict[str, tuple[str, Any]] = {}
    for note, values in configurations.provenances[k].items():
        if note.startswith(_REQUESTED):
            key = note.removeprefix(_REQUESTED)
            found |= {f"{key}.{name}" if name in found else name: (key, value) for name, value in values.items()}
    return found


def varied_rows(
    configurations: ConfigurationTable, chosen: Iterable[int], environments: Mapping[str, str]
) -> list[dict[str, Any]]:
    """All values of the configurations `chosen`: given, drawn, requested, and the numbers of `MEASURED`.

    Args:
        environments: Names of maps by digest.
    """
    return [
        {
            **{key: named(value, environments) for key, value in configurations.factors[k].items()},
            **{key: named(value, environments) for key, value in chosen_values(configurations, k).items()},
            **{name: value for name, value in _measured(configurations.provenances[k], MEASURED).items() if value},
        }
        for k in chosen
    ]


def path_property_rows(configurations: ConfigurationTable, chosen: Iterable[int]) -> list[dict[str, float]]:
    """The numbers of `PATH_PROPERTIES` of the configurations `chosen`; none if obstacles of the file were not known to the draw."""

    def has_obstacles(value: Any) -> bool:
        return isinstance(value, list) and any(isinstance(item, dict) and "spawn_pose" in item for item in value)

    return [
        _measured(configurations.provenances[k], PATH_PROPERTIES)
        if _PLACED in configurations.provenances[k] or not any(map(has_obstacles, configurations.factors[k].values()))
        else {}
        for k in chosen
    ]


def _measured(provenance: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, float]:
    found = ((name, provenance.get(key)) for key, name in names.items() if key in provenance)
    return {name: round(value, _DIGITS) for name, value in found if isinstance(value, int | float)}


def named(value: Any, environments: Mapping[str, str]) -> Any:
    """A value, a file by its name or the beginning of its digest."""
    if isinstance(value, dict) and set(value) == {"file"}:
        return environments.get(value["file"], str(value["file"])[:8])
    return value
