"""The world that a robot drives in, and the map that it has of it."""

import functools
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from vastflow.sim.model.digest import FileContent
from vastflow.sim.world.bodies import Body, walls_of
from vastflow.sim.world.difference import WorldDifference, differing
from vastflow.sim.world.map_file import read_map
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.readers.reader import bodies_of

CACHED_WORLDS: Final = 2
"""Number of cached worlds that differ from their map. Each has up to four times its cells, of 10 bytes each, and belongs to
one configuration."""


@dataclass(frozen=True, eq=False)
class World:
    """A world that a robot drives in.

    Attributes:
        map: What the robot knows of it.
        difference: How the walls differ from the map; None where they do not.
        bodies: What stands in it, read from a file of its own; None where the map says what does.
    """

    map: OccupancyMap
    difference: WorldDifference | None = None
    bodies: tuple[Body, ...] | None = None

    @cached_property
    def walls(self) -> OccupancyMap:
        """The walls as they stand, in the map's frame: what bodies meet and lidars see."""
        walls = self.map if self.bodies is None else walls_of(self.bodies, self.map)
        return walls if self.difference is None else differing(walls, self.difference)


def read_world(
    map_file: FileContent, difference: WorldDifference | None = None, world_file: FileContent | None = None
) -> World:
    """Return the world of a map, a difference from it, or a file; the last few are kept.

    Raises:
        MapError: the map can't be read, or has changed since the campaign was read.
        WorldError: the same of the world's file.
    """
    if difference is None and world_file is None:
        return World(read_map(map_file))
    return _other_world(map_file, difference, world_file)


@functools.lru_cache(maxsize=CACHED_WORLDS)
def _other_world(map_file: FileContent, difference: WorldDifference | None, world_file: FileContent | None) -> World:
    return World(read_map(map_file), difference, None if world_file is None else bodies_of(world_file))
