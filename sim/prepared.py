"""What is computed once per map and robot, and shared by all runs on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.lidar import Lidar, leap_table
from vastflow.sim.maps import OccupancyMap
from vastflow.sim.nav.amcl import likelihood_cubed
from vastflow.sim.nav.inflation import FREE, LETHAL, UNKNOWN, cost_stamp, inflate
from vastflow.sim.nav.navfn import travel_costs
from vastflow.sim.nav.parameters import NavParameters
from vastflow.sim.walls import WallIndex


@dataclass(frozen=True, eq=False)
class PreparedMap:
    """Read-only tables of one map; a run copies what it writes to.

    Attributes:
        leap: What the lidar casts against.
        cubed: AMCL's likelihood field.
        static: (H, W) uint8 of 0, 254, 255: the static layer.
        stamp: Inflation round one cell.
        travel: (H, W) uint8: NavFn's costs of the inflated static layer.
    """

    occupancy: OccupancyMap
    walls: WallIndex
    leap: NDArray[np.uint8]
    cubed: NDArray[np.float32]
    static: NDArray[np.uint8]
    stamp: NDArray[np.uint8]
    costs: NDArray[np.uint8]
    travel: NDArray[np.uint8]


def prepare(occupancy: OccupancyMap, lidar: Lidar, parameters: NavParameters) -> PreparedMap:
    """Tables of a map for a robot with these parameters."""
    occupied = np.ascontiguousarray(occupancy.occupied)
    cubed = likelihood_cubed(
        occupied,
        occupancy.resolution_m,
        range_max_m=lidar.range_max_m,
        z_hit=parameters.z_hit,
        z_rand=parameters.z_rand,
        sigma_hit_m=parameters.sigma_hit,
        likelihood_max_dist_m=parameters.laser_likelihood_max_dist,
    )
    # The trinary static layer: what is neither occupied nor unknown is free.
    static = np.where(occupied, LETHAL, np.where(occupancy.cells < 0, UNKNOWN, FREE)).astype(np.uint8)
    inflation = (
        occupancy.resolution_m,
        parameters.inscribed_radius_m,
        parameters.inflation_radius,
        parameters.cost_scaling_factor,
    )
    costs = inflate(static, *inflation)
    return PreparedMap(
        occupancy,
        WallIndex(occupancy),
        leap_table(occupied),
        cubed,
        static,
        cost_stamp(*inflation),
        costs,
        travel_costs(costs, parameters.allow_unknown),
    )
