"""Start and goals of a configuration: is there room for the robot that the local costmap has?"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.paper.published import LOCAL_RADIUS_M
from vastflow.sim.maps import OccupancyMap, load_map
from vastflow.sim.octile import passable


class Room:
    """Where on the maps of a campaign directory a robot of the local costmap's radius can stand.

    Args:
        environments: The directory's folder of maps.
    """

    def __init__(self, environments: Path) -> None:
        self._environments = environments
        self._free: dict[str, tuple[OccupancyMap, NDArray[np.bool_]]] = {}

    def at_all_stops(self, environment: str, factors: Mapping[str, Any]) -> bool:
        """Whether no stop is nearer to a wall than the radius, by the cells' centres.

        Args:
            environment: Digest of the map.
            factors: Keys of the configuration, with its start and its goal or goals.

        Raises:
            ValueError, OSError: the map is damaged.
        """
        occupancy, free = self._of(environment)
        goals = factors["goal_poses"] if "goal_poses" in factors else [factors["goal_pose"]]
        cells = [occupancy.cell_of(at["position"]["x"], at["position"]["y"]) for at in (factors["start_pose"], *goals)]
        return all(occupancy.contains(*cell) and bool(free[cell]) for cell in cells)

    def _of(self, environment: str) -> tuple[OccupancyMap, NDArray[np.bool_]]:
        if environment not in self._free:
            occupancy = load_map(self._environments / environment / "map.yaml")
            self._free[environment] = occupancy, passable(occupancy, LOCAL_RADIUS_M)
        return self._free[environment]
