"""The interface of world readers, and their errors."""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Final, Protocol

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.world.bodies import Body
from vastflow.sim.world.occupancy import OccupancyMap

GROUP: Final = "vastflow.worlds"
MOST_BODIES: Final = 100_000
FARTHEST_M: Final = 10_000.0
"""Greatest distance of a body from the origin, and greatest size."""


class WorldError(ScenarioError):
    """A map or world file that can't be used."""


class MissingWorld(WorldError):
    """A map or world file, or a map's picture, that does not exist."""


class WorldReader(Protocol):
    """A reader of one kind of world file.

    Attributes:
        suffixes: Ends of the names of its files, such as `.sdf`.
    """

    suffixes: ClassVar[tuple[str, ...]]

    @staticmethod
    def read(path: Path) -> Sequence[Body] | OccupancyMap:
        """Return the bodies of a file, finite and in the map's frame, or a grid of cells.

        Raises:
            WorldError: the file can't be used; with its place, the problem, and what was expected.
            Unreadable: it can't be read at all.
        """

    @staticmethod
    def files(path: Path) -> Sequence[Path]:
        """Return the files that are read, the named one first; raises as `read`."""
