"""What varies: of each configuration, the values by which its outcome may be explained."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from vastflow.oracles.directory.configuration_table import ConfigurationTable
from vastflow.sim.reading.world import WORLD_KEY

MEASURED: Final[Mapping[str, str]] = {"_path_length": "path length (m)"}
"""Numbers that follow from how a configuration was drawn, and what they are called."""

WORLD: Final[Mapping[str, str]] = {"_wall_offset_m": "wall offset (m)", "_missing_furniture": "missing furniture"}
"""Likewise how far its world was to differ from the robot's map; 0 is a level like others."""

SURROUNDINGS: Final[Mapping[str, str]] = {
    "_narrowest_passage_m": "narrowest passage (m)",
    "_start_clearance_m": "clearance at start (m)",
    "_goal_clearance_m": "clearance at goal (m)",
    "_turning_rad": "turning (rad)",
    "_obstacles_near_path": "obstacles near the path",
}
"""Likewise what surrounds the path that was drawn, which nobody chose."""

_PLACED: Final = "_obstacles"
"""Of a configuration whose obstacles producers placed, so that its surroundings are known with them."""
_DIGITS: Final = 2
"""Of both: a centimeter, which is less than a cell of a map."""


def chosen_values(configurations: ConfigurationTable, k: int) -> dict[str, Any]:
    """The factors of the configuration at index `k`; a world that a producer drew is told by the numbers of `WORLD`."""
    told = WORLD.keys() & configurations.provenances[k].keys()
    return {key: value for key, value in configurations.factors[k].items() if not told or key != WORLD_KEY}


def varied_rows(
    configurations: ConfigurationTable, chosen: Iterable[int], environments: Mapping[str, str]
) -> list[dict[str, Any]]:
    """The factors of the configurations at the indices `chosen`, and the numbers of `MEASURED` and `WORLD` that they have.

    Args:
        environments: Names of maps by their digests, where they have names.
    """
    return [
        {
            **{key: named(value, environments) for key, value in chosen_values(configurations, k).items()},
            **{name: value for name, value in _measured(configurations.provenances[k], MEASURED).items() if value},
            **_measured(configurations.provenances[k], WORLD),
        }
        for k in chosen
    ]


def surroundings_rows(configurations: ConfigurationTable, chosen: Iterable[int]) -> list[dict[str, float]]:
    """The numbers of `SURROUNDINGS` that the configurations at the indices `chosen` have.

    Of one whose obstacles stand in the campaign file none is known, for its path was drawn without them.
    """
    return [
        _measured(configurations.provenances[k], SURROUNDINGS)
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
