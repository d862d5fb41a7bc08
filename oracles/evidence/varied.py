"""What varies: of each configuration, the values by which its outcome may be explained."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.results.tables import ConfigurationTable
from vastflow.sim.reading.world import WORLD_KEY

MEASURED: Final[Mapping[str, str]] = {"_path_length": "path length (m)"}
"""Numbers that follow from how a configuration was drawn, and what they are called. None of them is a factor."""

WORLD: Final[Mapping[str, str]] = {"_wall_offset_m": "wall offset (m)", "_missing_furniture": "missing furniture"}
"""Likewise how far its world was to differ from the robot's map; 0 is a level like others."""

PATH_PROPERTIES: Final[Mapping[str, str]] = {
    "_narrowest_passage_m": "narrowest passage (m)",
    "_start_clearance_m": "clearance at start (m)",
    "_goal_clearance_m": "clearance at goal (m)",
    "_turning_rad": "turning (rad)",
    "_obstacles_near_path": "obstacles near the path",
}
"""Likewise what surrounds the path that was drawn, which nobody chose."""

_PLACED: Final = "_obstacles"
"""Of a configuration whose obstacles producers placed, so that its path's properties are known with them."""
_DIGITS: Final = 2
"""Of both: a centimeter, which is less than a cell of a map."""


_REQUESTED: Final = "_requested_"
"""Before the key of a drawn value: what the campaign file requested there, by the file's names."""
_DRAW: Final = "draw"
"""Name, in what was requested, of the number among equals, which nobody chose."""


def chosen_values(configurations: ConfigurationTable, k: int) -> dict[str, Any]:
    """What the campaign file requests of the configuration at index `k`: of what was drawn, the values by which it was."""
    requested = {n: value for n, (_, value) in _requested(configurations, k).items() if n.split(".")[-1] != _DRAW}
    drawn = {key for step in configurations.steps[k] if _is_drawn(step["keys"]) for key in step["keys"]}
    drawn.discard("map_file")
    if WORLD.keys() & configurations.provenances[k].keys():
        drawn.add(WORLD_KEY)
    given = {key: value for key, value in configurations.factors[k].items() if key not in drawn}
    return given | requested | _measured(configurations.provenances[k], WORLD)


def chosen_rows(
    configurations: ConfigurationTable, chosen: Iterable[int], environments: Mapping[str, str]
) -> list[dict[str, Any]]:
    """`chosen_values` of the configurations at the indices `chosen`, files by their names."""
    return [
        {key: named(value, environments) for key, value in chosen_values(configurations, k).items()} for k in chosen
    ]


def matched_sets(configurations: ConfigurationTable, chosen: Sequence[int], factor: str) -> NDArray[np.int64]:
    """(m,) numbers that are equal for configurations that are equal in all but `factor`, poses and obstacles included.

    What follows from the factor where it was drawn, such as the places of obstacles, may differ. Poses may not.
    """
    keys = [json.dumps(_all_but(configurations, k, factor), sort_keys=True) for k in chosen]
    numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    return np.array([numbers[key] for key in keys], dtype=np.int64)


def _all_but(configurations: ConfigurationTable, k: int, factor: str) -> list[Any]:
    requested = _requested(configurations, k)
    source = (
        _REQUESTED + requested[factor][0] if factor in requested else WORLD_KEY if factor in WORLD.values() else factor
    )
    own = {key for step in configurations.steps[k] if source in step["keys"] for key in step["keys"]} | {source}
    content = {name: dict(part) for name, part in configurations.contents[k].items() if part}
    for name, part in content.items():
        for key in own & part.keys():
            if name != "task" or key == factor:
                del part[key]
    beside = {name: value for name, (_, value) in requested.items() if name != factor}
    worlds = {name: value for name, value in _measured(configurations.provenances[k], WORLD).items() if name != factor}
    return [content, beside, worlds, configurations.table["abstract"][k].as_py()]


def _requested(configurations: ConfigurationTable, k: int) -> dict[str, tuple[str, Any]]:
    """Name to key and value of all that was requested of what was drawn; of two keys, the second has its name before it."""
    found: dict[str, tuple[str, Any]] = {}
    for note, values in configurations.provenances[k].items():
        if note.startswith(_REQUESTED):
            key = note.removeprefix(_REQUESTED)
            found |= {f"{key}.{name}" if name in found else name: (key, value) for name, value in values.items()}
    return found


def _is_drawn(keys: Iterable[str]) -> bool:
    return any(key.startswith(_REQUESTED) for key in keys)


def varied_rows(
    configurations: ConfigurationTable, chosen: Iterable[int], environments: Mapping[str, str]
) -> list[dict[str, Any]]:
    """All values of the configurations at the indices `chosen`: given, drawn, requested, and the numbers of `MEASURED`.

    Args:
        environments: Names of maps by their digests, where they have names.
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
    """The numbers of `PATH_PROPERTIES` that the configurations at the indices `chosen` have.

    Of one whose obstacles stand in the campaign file none is known, for its path was drawn without them.
    """
    return [
        _measured(configurations.provenances[k], PATH_PROPERTIES)
        if _PLACED in configurations.provenances[k] or not any(map(_has_obstacles, configurations.factors[k].values()))
        else {}
        for k in chosen
    ]


def _has_obstacles(value: Any) -> bool:
    return isinstance(value, list) and any(isinstance(item, dict) and "spawn_pose" in item for item in value)


def _measured(provenance: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, float]:
    found = {name: provenance.get(key) for key, name in names.items()}
    return {name: round(value, _DIGITS) for name, value in found.items() if isinstance(value, int | float)}


def named(value: Any, environments: Mapping[str, str]) -> Any:
    """A file by the name that people know of it, or by the beginning of its digest."""
    if isinstance(value, dict) and set(value) == {"file"}:
        return environments.get(value["file"], str(value["file"])[:8])
    return value
