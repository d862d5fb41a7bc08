"""The world that a robot drives in, and the map that it has of it."""

import functools
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from vastflow.sim.model.digest import FileContent
from vastflow.sim.world.difference import WorldDifference, differing
from vastflow.sim.world.map_file import read_map
from vastflow.sim.world.occupancy import OccupancyMap

CACHED_WORLDS: Final = 2
"""Number of cached worlds that differ from their map. Each has up to four times its cells, of 10 bytes each, and belongs to
one configuration."""


@dataclass(frozen=True, eq=False)
class World:
    """A world that a robot drives in.

    Attributes:
        map: What the robot knows of it.
        difference: How the walls differ from the map; None where they do not.
    """

    map: OccupancyMap
    difference: WorldDifference | None = None

    @cached_property
    def walls(self) -> OccupancyMap:
        """The walls as they stand, in the map's frame: what bodies meet and lidars see."""
        return self.map if self.difference is None else differing(self.map, self.difference)


def read_world(map_file: FileContent, difference: WorldDifference | None = None) -> World:
    """Return the world of a map's file and of a difference from it; the last few are kept.

    Raises:
        MapError: the map can't be read, or has changed since the campaign was read.
    """
    return World(read_map(map_file)) if difference is None else _differing_world(map_file, difference)


@functools.lru_cache(maxsize=CACHED_WORLDS)
def _differing_world(map_file: FileContent, difference: WorldDifference) -> World:
    return World(read_map(map_file), difference)
