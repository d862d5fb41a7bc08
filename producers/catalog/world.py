"""The producer of worlds that are not as the robot's map has them."""

import itertools
from collections.abc import Iterator, Mapping
from typing import Annotated, Final

import numpy as np
from pydantic import Field, model_validator

from vastflow.producers.model import producer
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.numbers import DEFAULT_ROBOT_DIAMETER_M, Count, NotNegatives, Positive, Seed
from vastflow.producers.model.producer import Draws, Producer
from vastflow.producers.places.ground import map_of
from vastflow.producers.places.stops import GOAL_KEY, GOALS_KEY, START_KEY, given_goals, given_start
from vastflow.sim.model.digest import Value, digest
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Dimension
from vastflow.sim.world.environment import LONGEST_M, MAP_KEY, SHORTEST_M, WORLD_KEY, world_of
from vastflow.sim.world.occupancy import OccupancyMap

OFFSET_KEY: Final = "_wall_offset_m"
MISSING_KEY: Final = "_missing_furniture"
"""Provenance: what was asked for, also where nothing differs, so that it can be compared."""
TRIES: Final = 20
"""Worlds that are drawn until the robot finds a path in one."""
STEEPEST: Final = 0.2
"""Greatest `wall_offset` as a share of `correlation_length`: beyond it walls tear."""


class WorldParameters(producer.Parameters):
    """Parameters of `WorldVariation`."""

    wall_offset: NotNegatives = (0.0,)
    """Standard deviation of what walls are offset by along x and along y (m), smoothly from place to place; one value or several. 0: as on the map."""
    correlation_length: Annotated[Positive, Field(ge=SHORTEST_M, le=LONGEST_M)] = 2.0
    """Distance (m) at which the offsets of two places have lost most of what they share: small for bent walls, large for moved rooms; 0.5 m at the least."""
    missing_furniture: NotNegatives = (0.0,)
    """Probability of each piece of furniture on the map to be gone; one value or several. Furniture is what stands apart from the walls
    and is at most 2 m long."""
    count: Count = 1
    """Worlds drawn of each combination in which something differs."""
    robot_diameter: Positive = DEFAULT_ROBOT_DIAMETER_M
    """Diameter of the robot that must stand at its stops and find a path (m)."""
    seed: Seed = 0
    """Seed of the draws."""

    @model_validator(mode="after")
    def _check(self) -> "WorldParameters":
        if max(self.missing_furniture) > 1.0:
            found = f"{max(self.missing_furniture):g}"
            raise ValueError(f"missing_furniture: expected a probability from 0 to 1, got {found}")
        if (widest := max(self.wall_offset)) > (most := STEEPEST * self.correlation_length):
            right = f"expected at most {most:g} at a correlation_length of {self.correlation_length:g} m"
            raise ValueError(f"wall_offset: {right}, got {widest:g}, at which walls tear")
        return self


class WorldVariation(Producer[WorldParameters]):
    """A world with walls or furniture that differ from the robot's map.

    The robot is given the map all the same; bodies, lidar, and clearances are of the world. Where nothing differs, the configuration is
    what it is without this producer. Furniture that the map lacks is `ObstacleVariation`'s.
    """

    Parameters = WorldParameters

    reads = (MAP_KEY, START_KEY, GOAL_KEY, GOALS_KEY)
    needs = (MAP_KEY,)

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        return {WORLD_KEY: self.parameters.dimension or "environment"}

    @property
    def most_choices(self) -> int:
        return self.parameters.count * len(self.parameters.wall_offset) * len(self.parameters.missing_furniture)

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield `count` worlds of each offset and, within it, of each share of missing furniture; one where nothing differs.

        A world depends on the seed, what is read, its offset, its share and its number among equals.
        """
        for offset_m, missing in itertools.product(self.parameters.wall_offset, self.parameters.missing_furniture):
            noted: dict[str, Value] = {OFFSET_KEY: offset_m, MISSING_KEY: missing}
            if not offset_m and not missing:
                yield Fragment(noted)
                continue
            for number in range(1, self.parameters.count + 1):
                requested: dict[str, Value] = {
                    "wall_offset": offset_m,
                    "correlation_length": self.parameters.correlation_length,
                    "missing_furniture": missing,
                    "world": number,
                }
                world = self._world(inputs, requested, draws(int(digest(requested)[:16], 16)))
                yield Rejection(world, requested) if isinstance(world, str) else Fragment({WORLD_KEY: world, **noted})

    def _world(
        self, inputs: Mapping[str, Value], requested: Mapping[str, Value], rng: np.random.Generator
    ) -> dict[str, Value] | str:
        """The first drawn world in which the robot finds a path, or the reason why none was found."""
        try:
            map_file = map_of(inputs)
            start = given_start(inputs, START_KEY)
            goals = given_goals(inputs, GOALS_KEY) or given_goals(inputs, GOAL_KEY)
        except ValueError as error:
            return str(error)
        stops = {"the start": start, **{f"goal {i}": goal for i, goal in enumerate(goals, 1)}}
        asked = {name: value for name, value in requested.items() if name != "world"}
        reason = ""
        for _ in range(TRIES):
            value: dict[str, Value] = {"seed": int(rng.integers(2**31)), **asked}
            world = world_of({MAP_KEY: map_file, WORLD_KEY: value})
            assert world is not None
            reason = self._blocked(world.walls, stops)
            if not reason:
                return value
        return f"in none of {TRIES} worlds that were drawn does the robot find a path. In the last one, {reason}"

    def _blocked(self, world: OccupancyMap, stops: Mapping[str, Pose | None]) -> str:
        """Why the robot finds no path in a world; empty where it does."""
        from skimage.measure import label  # half a second with what follows

        from vastflow.sim.world import octile

        radius_cells = octile.whole_cells(self.parameters.robot_diameter / 2, world.resolution_m)
        passable = octile.inflated_free(world.free, radius_cells)
        cells = {name: world.cell_of(pose.x_m, pose.y_m) for name, pose in stops.items() if pose}
        for name, cell in cells.items():
            if not world.contains(*cell) or not passable[cell]:
                return f"a wall stands at {name}"
        labels = label(passable, connectivity=2)
        return "walls part the start from a goal" if len({int(labels[cell]) for cell in cells.values()}) > 1 else ""
