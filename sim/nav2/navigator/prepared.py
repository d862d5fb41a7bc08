"""Tables that are computed once per map and robot and shared by all runs on it.

Three parts are kept for the maps used last, each by what it depends on: a campaign that varies the robot's radius shares
walls and likelihood field, one that varies AMCL's parameters the costs.
"""

import functools
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.nav2.amcl.sensor import likelihood_cubed, usable_range_m
from vastflow.sim.nav2.costmaps.costmap import denoised
from vastflow.sim.nav2.costmaps.filters import NOTHING, Mask, keepout_mask, on_map, with_keepout
from vastflow.sim.nav2.costmaps.inflation import FREE, LETHAL, UNKNOWN, cost_stamp, inflation_of, with_unknown
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, outline_of
from vastflow.sim.nav2.navigator.kernels import with_kernels
from vastflow.sim.nav2.parameters.costmap import Costmap
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.planners.binding import prepared as planner_prepared
from vastflow.sim.nav2.planners.planner import Planner, PlannerSetting
from vastflow.sim.world.bodies import Body, outlines_of
from vastflow.sim.world.occupancy import UNKNOWN as UNSEEN
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.physics import WallIndex
from vastflow.sim.world.robot_model import Lidar
from vastflow.sim.world.skip_table import SkipTable, skip_table_of
from vastflow.sim.world.world import CACHED_MAPS, CACHED_WORLDS, World

Cells: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class PreparedMap:
    """Read-only tables of one map; runs copy the parts that they change.

    Attributes:
        occupancy: Map that the robot knows; the walls where it has none. Its grid's frame is that of all poses.
        world: The walls as they stand.
        skips: Skip table of the world's walls, which the lidar casts against.
        cubed: AMCL's likelihood field.
        static: (H, W) uint8 of 0, 254, 255: the static layer; without one what its window has before any scan.
        static_costs: (H, W) uint8 inflation of its lethal cells; the costs are that with its unknown cells.
        stamp, local_stamp: Inflation round one cell of the global and of the local costmap.
        keepout: (H, W) uint8, the keepout mask on the global costmap, which is in its costs; (0, 0) without that filter.
        planning: The planner's setting on this map, with the costs.
        local_keepout: The keepout mask for the local costmap.
        speed_mask: That of the speed filter.
    """

    occupancy: OccupancyMap
    world: OccupancyMap
    walls: WallIndex
    skips: SkipTable
    cubed: NDArray[np.float32]
    static: Cells
    static_costs: Cells
    stamp: Cells
    keepout: Cells
    planning: PlannerSetting
    local_stamp: Cells
    local_keepout: Mask
    speed_mask: OccupancyMap | None


def prepare(
    world: World,
    lidar: Lidar,
    parameters: NavParameters,
    keepout: OccupancyMap | None = None,
    speed: OccupancyMap | None = None,
) -> PreparedMap:
    """Tables of a world for a robot with these parameters, computed once for each map object.

    Args:
        keepout, speed: The masks of the costmaps' filters.
    """
    q = parameters.amcl
    occupancy = world.ground
    geometry = (_geometry if world.walls is occupancy else _other_geometry)(world.walls, world.bodies or ())
    range_max_m = usable_range_m(q, lidar.range_min_m, lidar.range_max_m)[1]
    local, everywhere = parameters.local_costmap, parameters.global_costmap
    known = _nothing() if everywhere.in_odom else occupancy
    cubed = _likelihood(known, range_max_m, q.z_hit, q.z_rand, q.sigma_hit, q.laser_likelihood_max_dist)
    mask = keepout if everywhere.keepout_filter.enabled else None
    grid = occupancy if everywhere.sized_by_map else _window(everywhere)
    tables = _costs(grid, everywhere, mask)[:4]
    planning = _planning(grid, everywhere, mask, with_kernels(parameters.planner))
    local_keepout = keepout_mask(keepout if local.keepout_filter.enabled else None, occupancy)
    local_stamp = _stamp(local, local.resolution)
    return PreparedMap(occupancy, *geometry, cubed, *tables, planning, local_stamp, local_keepout, speed)


@functools.cache
def _nothing() -> OccupancyMap:
    """Return a map of one cell, which stands for none."""
    return OccupancyMap(np.zeros((1, 1), dtype=np.int8), 1.0, (0.0, 0.0))


@functools.lru_cache(maxsize=CACHED_MAPS)
def _window(costmap: Costmap) -> OccupancyMap:
    """Return the grid of a global costmap without a static layer, of which nothing is known."""
    shape = int(costmap.height / costmap.resolution), int(costmap.width / costmap.resolution)
    cells = np.full(shape, UNSEEN, dtype=np.int8)
    return OccupancyMap(cells, costmap.resolution, (costmap.origin_x, costmap.origin_y))


@functools.lru_cache(maxsize=CACHED_MAPS)
def _geometry(walls: OccupancyMap, bodies: tuple[Body, ...]) -> tuple[OccupancyMap, WallIndex, SkipTable]:
    outlines = outlines_of(bodies, walls) if bodies else None
    return walls, WallIndex(walls, bodies), skip_table_of(walls.occupied, outlines)


_other_geometry = functools.lru_cache(maxsize=CACHED_WORLDS)(_geometry.__wrapped__)


@functools.lru_cache(maxsize=CACHED_MAPS)
def _likelihood(
    occupancy: OccupancyMap, range_max_m: float, z_hit: float, z_rand: float, sigma_hit_m: float, max_dist_m: float
) -> NDArray[np.float32]:
    return likelihood_cubed(
        *(occupancy.occupied, occupancy.resolution_m),
        range_max_m=range_max_m,
        z_hit=z_hit,
        z_rand=z_rand,
        sigma_hit_m=sigma_hit_m,
        likelihood_max_dist_m=max_dist_m,
    )


@functools.lru_cache(maxsize=CACHED_MAPS)
def _costs(
    occupancy: OccupancyMap, costmap: Costmap, mask: OccupancyMap | None
) -> tuple[Cells, Cells, Cells, Cells, Cells, Cells]:
    static = np.full(occupancy.shape, FREE, dtype=np.uint8)
    if (
        costmap.static_layer.enabled or not costmap.sized_by_map
    ):  # trinary: what is neither occupied nor unknown is free
        unknown = UNKNOWN if costmap.track_unknown_space else FREE
        static = np.where(occupancy.occupied, LETHAL, np.where(occupancy.cells < 0, unknown, FREE)).astype(np.uint8)
    if costmap.denoise_layer.enabled:
        static = denoised(static, costmap.denoise_layer)
    stamp = _stamp(costmap, occupancy.resolution_m)
    static_costs = inflation_of(static, stamp)
    keepout = on_map(keepout_mask(mask, occupancy), occupancy)
    costs = with_keepout(with_unknown(static, static_costs), keepout)
    free_costs = np.minimum(with_keepout(static_costs, keepout), costs) if (static == UNKNOWN).any() else costs
    if keepout.size and costmap.keepout_filter.override_lethal_cost:
        least = np.uint8(costmap.keepout_filter.lethal_override_cost)
        free_costs = np.where(keepout == NOTHING, free_costs, np.minimum(free_costs, least))
    return static, static_costs, stamp, keepout, costs, free_costs


@functools.lru_cache(maxsize=CACHED_MAPS)
def _planning(occupancy: OccupancyMap, costmap: Costmap, mask: OccupancyMap | None, planner: Planner) -> PlannerSetting:
    costs = _costs(occupancy, costmap, mask)[4:]
    setting = PlannerSetting(*costs, costmap, occupancy.resolution_m, occupancy.origin_xy_m)
    return planner_prepared(planner, setting)


def _stamp(costmap: Costmap, resolution_m: float) -> NDArray[np.uint8]:
    layer = costmap.inflation_layer
    if not layer.enabled:
        return np.array([[LETHAL]], dtype=np.uint8)
    return cost_stamp(
        resolution_m, inscribed_radius_m(outline_of(costmap)), layer.inflation_radius, layer.cost_scaling_factor
    )
