"""Parameters of the two costmaps and their layers."""

from typing import Any, Final, Literal

from pydantic import field_validator

from vastflow.sim.model.parameter import ParameterGroup, derived, parameter
from vastflow.sim.model.polygon import vertices_of

NEVER_HZ: Final = 1e-9
"""The rate of a costmap that is not published."""


class InflationLayer(ParameterGroup):
    """Inflation: radius in meters, scaling per meter."""

    enabled: bool = parameter(True)
    inflation_radius: float = parameter(0.70, 0.0, 100.0, below=0.0)
    cost_scaling_factor: float = parameter(3.0, 0.0, 1e6)


class StaticLayer(ParameterGroup):
    """The map as it was given."""

    enabled: bool = parameter(True)


class ObstacleLayer(ParameterGroup):
    """Marking and clearing by the scan, in meters.

    Attributes:
        short_clearing_cells: A beam clears to its end but for these cells: 2 in a VoxelLayer, 0 in an ObstacleLayer.
    """

    enabled: bool = parameter(True)
    footprint_clearing_enabled: bool = parameter(True)
    marking: bool = parameter(True)
    clearing: bool = parameter(True)
    obstacle_max_range: float = parameter(2.5, 0.0, 1000.0, mirrored=True, above=1000.0)
    obstacle_min_range: float = parameter(0.0, 0.0, 1000.0, mirrored=True, above=1000.0)
    raytrace_max_range: float = parameter(3.0, 0.0, 1000.0, below=0.0, above=1000.0)
    short_clearing_cells: int = derived(0)


class DenoiseLayer(ParameterGroup):
    """Groups of fewer lethal cells than `minimal_group_size` become free.

    Cells of a group touch by edges (4), or by corners too (8).
    """

    enabled: bool = parameter(True)
    minimal_group_size: int = parameter(2, 0, 10_000, below=0)
    group_connectivity_type: Literal[4, 8] = parameter(8)

    @field_validator("group_connectivity_type", mode="before")
    @classmethod
    def _eight(cls, value: Any) -> Any:
        """Take 8 for all but 4, as Nav2 does."""
        return 8 if isinstance(value, int) and not isinstance(value, bool) and value != 4 else value


class KeepoutFilter(ParameterGroup):
    """Cells that a mask raises after all layers, see `vastflow.sim.nav2.costmaps.filters`.

    Attributes:
        override_lethal_cost: Whether cells are raised to `lethal_override_cost` alone while the robot is on a lethal cell of the mask.
    """

    enabled: bool = derived(True)
    override_lethal_cost: bool = parameter(False)
    lethal_override_cost: int = parameter(
        252, 0, 255, needs=("override_lethal_cost", True, "override_lethal_cost is false"), below=252
    )


class SpeedFilter(ParameterGroup):
    """A limit on the controller's speed, `base + multiplier · value` of the mask where the robot is.

    Attributes:
        type: Unit of the limit: 1 a share of the controller's own in percent, 2 meters per second.
    """

    enabled: bool = derived(True)
    type: int = parameter(1, 1, 2)
    base: float = parameter(0.0, -1e6, 1e6)
    multiplier: float = parameter(1.0, -1e6, 1e6)


class Costmap(ParameterGroup):
    """One costmap: rates in Hz, lengths in meters.

    `publish_frequency` counts in the local costmap; size, origin, and `resolution` do not in a global costmap with a static layer,
    which takes them from the map.

    Attributes:
        rolling_window: Whether it moves with the robot, or stays with its corner at `origin_x`, `origin_y`.
        sized_by_map: Of the global costmap: whether it has a static layer, if only one that is not enabled.
        in_odom: Of the global costmap: whether it is in the odom frame. Then the robot has no map, and no AMCL.
        footprint: The robot's polygon as Nav2's text, which then counts in place of `robot_radius`; `[]` for a disc.
    """

    update_frequency: float = parameter(5.0, 0.05, 1000.0, least=0.0)
    publish_frequency: float = parameter(2.0, NEVER_HZ, 1000.0, below=NEVER_HZ)
    width: int = parameter(3, 1, 100, least=1)
    height: int = parameter(3, 1, 100, least=1)
    resolution: float = parameter(0.05, 0.01, 1.0, least=1e-9)
    rolling_window: bool = parameter(True)
    origin_x: float = parameter(0.0, -1e5, 1e5)
    origin_y: float = parameter(0.0, -1e5, 1e5)
    sized_by_map: bool = derived(True)
    in_odom: bool = derived(False)
    robot_radius: float = parameter(0.22, 0.01, 10.0, mirrored=True)
    footprint: str = parameter("[]")
    footprint_padding: float = parameter(0.01, -10.0, 10.0)
    track_unknown_space: bool = parameter(False)
    static_layer: StaticLayer = StaticLayer()
    obstacle_layer: ObstacleLayer = ObstacleLayer()
    denoise_layer: DenoiseLayer = DenoiseLayer(enabled=False)
    inflation_layer: InflationLayer = InflationLayer()
    keepout_filter: KeepoutFilter = KeepoutFilter(enabled=False)
    speed_filter: SpeedFilter = SpeedFilter(enabled=False)

    @field_validator("footprint")
    @classmethod
    def _polygon(cls, footprint: str) -> str:
        vertices_of(footprint)
        return footprint


def local_costmap() -> Costmap:
    """Nav2 Jazzy's local costmap: a rolling window without the static layer, marked by a VoxelLayer."""
    return Costmap(static_layer=StaticLayer(enabled=False), obstacle_layer=ObstacleLayer(short_clearing_cells=2))


def global_costmap() -> Costmap:
    """Nav2 Jazzy's global costmap: as large as the map, updated each second."""
    return Costmap(update_frequency=1.0, publish_frequency=1.0, track_unknown_space=True, rolling_window=False)
