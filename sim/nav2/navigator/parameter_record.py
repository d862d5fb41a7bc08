"""The parameters as kernels read them, one record a run."""

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.record import record
from vastflow.sim.model.elementary import hypot
from vastflow.sim.model.polygon import MOST_VERTICES, circumscribed_radius_m
from vastflow.sim.model.rates import ticks_of
from vastflow.sim.nav2.controllers.controller import PlanCut
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, outline_of
from vastflow.sim.nav2.navigator.collision_monitor import ZONE, zone_rows, zones_reach_m
from vastflow.sim.nav2.navigator.prepared import PreparedMap
from vastflow.sim.nav2.parameters.servers import MOST_ZONES
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.system.robot import IDEAL, OdometryDrift
from vastflow.sim.world.robot_model import Lidar, Robot


def parameter_record(
    parameters: NavParameters, lidar: Lidar, robot: Robot, prepared: PreparedMap, plan_cut: PlanCut, leg_overlap: int
) -> NDArray[np.void]:
    """Return the groups of the parameters, `plan_cut`, further numbers, `initial_covariance`, and zones."""
    apart = ("controller", "lidar_noise", "planner", "robot")
    groups = {name: group for name, group in parameters if name not in apart} | {"plan_cut": plan_cut}
    outline = outline_of(parameters.local_costmap)
    frame = prepared.occupancy.frame
    zones, smoother = parameters.collision_monitor.zones, parameters.velocity_smoother
    zone_values, zone_points = zone_rows(zones)
    fastest_mps = hypot(*(max(smoother.max_velocity[axis], -smoother.min_velocity[axis]) for axis in (0, 1)))
    extra: dict[str, float] = {
        "inscribed_radius": inscribed_radius_m(outline),
        "circumscribed_radius": circumscribed_radius_m(outline),
        "resolution": prepared.occupancy.resolution_m,
        "world_resolution": prepared.world.resolution_m,
        "origin_x": prepared.occupancy.origin_xy_m[0],
        "origin_y": prepared.occupancy.origin_xy_m[1],
        "grid_yaw": frame.yaw_rad,
        "grid_cos": frame.turn[0],
        "grid_sin": frame.turn[1],
        "scan_ticks": ticks_of(lidar.rate_hz),
        "control_ticks": ticks_of(parameters.controller_server.controller_frequency),
        "local_ticks": ticks_of(parameters.local_costmap.update_frequency),
        "publish_ticks": ticks_of(parameters.local_costmap.publish_frequency),
        "global_ticks": ticks_of(parameters.global_costmap.update_frequency),
        "range_min": lidar.range_min_m,
        "range_max": lidar.range_max_m,
        "mount_x": lidar.mount_xyt[0],
        "mount_y": lidar.mount_xyt[1],
        "angle_increment": lidar.angle_increment_rad,
        "sweeps": lidar.sweeps,
        "late": lidar.sweeps or parameters.latency != IDEAL,
        "drifts": parameters.odometry != OdometryDrift(),
        "max_speed": robot.max_speed_mps,
        "max_acceleration": robot.max_acceleration_mps2,
        "max_yaw_rate": robot.max_yaw_rate_radps,
        "max_yaw_acceleration": robot.max_yaw_acceleration_radps2,
        "min_turning_radius": robot.min_turning_radius_m,
        "is_omni": float(robot.drive == "omni"),
        "without_map": parameters.global_costmap.in_odom,
        "mission": 0,
        "leg_overlap": leg_overlap,
        "loops": 0,
        "zone_count": len(zones),
        "zones_reach": zones_reach_m(zone_values[: len(zones)], fastest_mps, 1.0 / lidar.rate_hz),
    }
    q = parameters.perturbation
    in_grid = frame.covariance_to_grid(q.initial_pose_covariance_xx, q.initial_pose_covariance_yy)
    types, rows = zip(*map(record, groups.values()), strict=True)
    dtype = np.dtype(
        [
            *zip(groups, types, strict=True),
            *((name, np.float64) for name in extra),
            ("initial_covariance", np.float64, (4,)),
            ("zones", np.float64, (MOST_ZONES, len(ZONE))),
            ("zone_points", np.float64, (MOST_ZONES, MOST_VERTICES, 2)),
        ],
        align=True,
    )
    covariance = *in_grid, q.initial_pose_covariance_yaw
    row = (*rows, *map(float, extra.values()), covariance, zone_values, zone_points)
    return np.array([row], dtype=dtype)
