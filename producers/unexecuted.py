"""Producers that files of version 1 use and whose machinery does not exist yet: read and checked, not executed."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from typing import Annotated, TypeAlias

from pydantic import Field

from vastflow.producers import producer
from vastflow.producers.configuration import Fragment, Rejection
from vastflow.producers.faults import NOT_EXECUTED
from vastflow.producers.ground import MAP_KEY, MapParameter, map_key
from vastflow.producers.obstacle import ObstacleParameters
from vastflow.producers.producer import Draws, P, Producer
from vastflow.producers.quantities import (
    DEFAULT_ROBOT_DIAMETER_M,
    Count,
    NotNegative,
    Number,
    Positive,
    Positives,
    Seed,
)
from vastflow.producers.stops import (
    GOAL_KEY,
    GOALS_KEY,
    START_KEY,
    GoalsParameter,
    StartParameter,
    start_key,
)
from vastflow.sim.digest import FileContent, Value
from vastflow.sim.scenario import Dimension

MESH_KEY = "mesh_file"

Files: TypeAlias = Annotated[tuple[str, ...], Field(min_length=1)]
MapAndMesh: TypeAlias = Annotated[tuple[str, ...], Field(min_length=2, max_length=2)]
Key: TypeAlias = Annotated[str, Field(min_length=1)]


class UnexecutedProducer(Producer[P]):
    """A producer that can be asked what it reads and writes, and nothing more."""

    executed = False

    @property
    def reads(self) -> tuple[str, ...]:
        """What it needs, as far as the flow of data is checked."""
        return self.needs

    @property
    @abstractmethod
    def writes(self) -> Mapping[str, Dimension | None]:
        """Keys it will write."""

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Refuse.

        Raises:
            NotImplementedError: always; `Campaign.unexecutable` says so before anything runs.
        """
        raise NotImplementedError(f"{type(self).__name__} is {NOT_EXECUTED}")


class FloorplanVariationParameters(producer.Parameters):
    """Of `FloorplanVariation`.

    Attributes:
        name: Keys of the map and of the mesh.
        variation_files: Variation DSL files (`.variation`), relative to the campaign file.
        num_variations: Environments drawn from each file.
    """

    name: MapAndMesh = (MAP_KEY, MESH_KEY)
    variation_files: Files
    num_variations: Count = 1
    seed: Seed = 0


class FloorplanVariation(UnexecutedProducer[FloorplanVariationParameters]):
    """Floor plans with drawn dimensions, as map and mesh."""

    Parameters = FloorplanVariationParameters

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        """The map and the mesh."""
        return dict.fromkeys(self.parameters.name, self.parameters.dimension or "environment")


class FloorplanGenerationParameters(producer.Parameters):
    """Of `FloorplanGeneration`.

    Attributes:
        name: Keys of the map and of the mesh.
        floorplans: FloorPlan DSL files (`.fpm`), relative to the campaign file.
    """

    name: MapAndMesh = (MAP_KEY, MESH_KEY)
    floorplans: Files


class FloorplanGeneration(UnexecutedProducer[FloorplanGenerationParameters]):
    """Floor plans as they are written, as map and mesh."""

    Parameters = FloorplanGenerationParameters

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        """The map and the mesh."""
        return dict.fromkeys(self.parameters.name, self.parameters.dimension or "environment")


class RasterParameters(producer.Parameters):
    """Of `PathVariationRasterized`.

    Attributes:
        start_pose: Key of the start, or the start itself.
        num_goal_poses: Number of goals.
        raster_size: Spacing of the points that are tried as stops (m).
        raster_offset_x, raster_offset_y: Of the raster from the map's origin (m).
        path_length: Octile length from the start through the goals (m), one value or several.
        path_length_tolerance: How much a length may miss `path_length` by (m).
        robot_diameter: Of the disc that must fit all along the path (m).
        map_file: A map for the path, in place of the configuration's own.
    """

    start_pose: StartParameter = START_KEY
    num_goal_poses: Count = 1
    map_file: MapParameter = None
    raster_size: Positive
    raster_offset_x: Number = 0.0
    raster_offset_y: Number = 0.0
    path_length: Positives
    path_length_tolerance: NotNegative = 0.5
    robot_diameter: Positive = DEFAULT_ROBOT_DIAMETER_M


class PathVariationRasterized(UnexecutedProducer[RasterParameters]):
    """Start and goals between the points of a raster, the promised way apart."""

    Parameters = RasterParameters

    @property
    def needs(self) -> tuple[str, ...]:
        """The map, unless the parameters name a file."""
        return _map_needed(self.parameters.map_file)

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        """Start and goal, or goals where there are several, and the map where the parameters name a file."""
        tag = self.parameters.dimension or "task"
        goal = GOAL_KEY if self.parameters.num_goal_poses == 1 else GOALS_KEY
        own_map: dict[str, Dimension | None] = (
            {MAP_KEY: "environment"} if isinstance(self.parameters.map_file, FileContent) else {}
        )
        return {start_key(self.parameters.start_pose): tag, goal: tag, **own_map}


class TriggeredObstacleParameters(ObstacleParameters):
    """Of `ObstacleVariationWithDistanceTrigger`: those of `ObstacleVariation`, for one obstacle, and its trigger.

    Attributes:
        spawn_trigger_point: Key of the point at which the obstacle appears.
        spawn_trigger_threshold: Key of the distance (m) from that point at which the robot triggers it.
        trigger_distance: That distance (m), one value or several.
        start_pose, goal_pose: Keys of the path's ends, or the poses themselves.
    """

    spawn_trigger_point: Key
    spawn_trigger_threshold: Key
    trigger_distance: Positives
    start_pose: StartParameter = START_KEY
    goal_pose: GoalsParameter = GOAL_KEY


class ObstacleVariationWithDistanceTrigger(UnexecutedProducer[TriggeredObstacleParameters]):
    """An obstacle that appears on the path when the robot comes near."""

    Parameters = TriggeredObstacleParameters

    @property
    def needs(self) -> tuple[str, ...]:
        """The map, unless the parameters name a file."""
        return _map_needed(self.parameters.map_file)

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        """The list with the obstacle, its trigger's point and distance."""
        asked = self.parameters
        keys = (asked.name, asked.spawn_trigger_point, asked.spawn_trigger_threshold)
        return {key.removeprefix("@"): asked.dimension or "environment" for key in keys}


def _map_needed(map_file: FileContent | str | None) -> tuple[str, ...]:
    return () if isinstance(map_file, FileContent) else (map_key(map_file),)
