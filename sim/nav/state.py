"""The navigation stack's whole state: preallocated arrays and two records, owned by one run."""

import math
from dataclasses import asdict, dataclass, fields
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.lidar import BEAMS, Lidar
from vastflow.sim.mission import Mission
from vastflow.sim.nav.amcl import Cloud, new_cloud
from vastflow.sim.nav.costmap import LOCAL_CELLS
from vastflow.sim.nav.navfn import new_potential, new_scratch
from vastflow.sim.nav.parameters import NavParameters
from vastflow.sim.prepared import PreparedMap
from vastflow.sim.robot import Robot
from vastflow.sim.streams import SUBSYSTEMS

TICK_S: Final = 0.05
"""The stack runs at 20 Hz: the controller's and the velocity smoother's rate."""

SUBSTEPS: Final = 5
"""Physics and actuator steps a tick: 100 Hz."""

ROW_TICKS: Final = 2
"""A recording has a row every second tick: 10 Hz."""

MAX_EVENTS: Final = 4096
OUTLINE_POINTS: Final = 32

NAVIGATE_TO_POSE, NAVIGATE_THROUGH_POSES, FOLLOW_WAYPOINTS = 0, 1, 2
MISSION_KINDS: Final = {
    "navigate_to_pose": NAVIGATE_TO_POSE,
    "navigate_through_poses": NAVIGATE_THROUGH_POSES,
    "follow_waypoints": FOLLOW_WAYPOINTS,
}

STARTING, FOLLOWING, SPINNING, WAITING, BACKING_UP, PAUSING, ENDED = 0, 1, 2, 3, 4, 5, 6
RUNNING, SUCCEEDED, ABORTED = 0, 1, 2

EVENT_RECOVERY, EVENT_GOAL_REACHED, EVENT_GOAL_MISSED, EVENT_PLAN_FAILED, EVENT_CONTROL_FAILED = 0, 1, 2, 3, 4
EVENT_KINDS: Final = ("recovery", "goal_reached", "goal_missed", "plan_failed", "control_failed")

CLEAR_LOCAL, CLEAR_GLOBAL, CLEAR_BOTH, SPIN, WAIT, BACK_UP = 0, 1, 2, 3, 4, 5
RECOVERIES: Final = ("clear local costmap", "clear global costmap", "clear both costmaps", "spin", "wait", "back up")

COLUMNS: Final = (
    "t_ms",
    "x_mm",
    "y_mm",
    "yaw_mrad",
    "estimated_x_mm",
    "estimated_y_mm",
    "estimated_yaw_mrad",
    "speed_mmps",
    "yaw_rate_mradps",
    "command_speed_mmps",
    "command_yaw_rate_mradps",
    "localized",
)

_REAL: Final = (
    # True pose of the tick before, true motion, true way driven.
    *("true_x", "true_y", "true_yaw", "true_v", "true_w", "distance"),
    # Odometry: pose in the odom frame, limited wheel command of the last step.
    *("odom_x", "odom_y", "odom_yaw", "wheel_v", "wheel_w"),
    # Odometry at the last filter update; transform map -> odom; estimate in the map.
    *("filter_odom_x", "filter_odom_y", "filter_odom_yaw", "map_odom_x", "map_odom_y", "map_odom_yaw", "x", "y", "yaw"),
    # Commands: of controller or behaviour, after the smoother.
    *("command_v", "command_w", "smooth_v", "smooth_w"),
    # End of the leg just planned, goal of the path, progress baseline (odom frame), what a behaviour has done so far.
    *("end_x", "end_y", "goal_x", "goal_y", "goal_yaw", "base_x", "base_y", "done", "last_yaw", "last_x", "last_y"),
)
_WHOLE: Final = (
    *(
        "tick",
        "status",
        "localized",
        "first_scan",
        "particles",
        "bins",
        "phase_local",
        "phase_global",
        "events",
        "rows",
    ),
    *("local_column", "local_row", "has_local", "clear_local", "clear_global", "outline_cost"),
    *("planned_goal", "root_column", "root_row", "path_n", "path_i", "tail_n", "dirty", "flooded_tick"),
    *("state", "until", "goal", "loop", "replan_in", "latched", "base_tick", "valid_tick"),
    *("attempts", "round_robin", "tried", "follow_retries", "plan_retries"),
    *("pending_code", "error_code", "recoveries", "missed"),
)
_WINDOW: Final = (LOCAL_CELLS, LOCAL_CELLS)
MEMORY: Final = np.dtype(
    [(name, np.float64) for name in _REAL]
    + [(name, np.int64) for name in _WHOLE]
    + [
        ("streams", np.uint64, (SUBSYSTEMS, 1)),
        ("velocities", np.float64, (SUBSTEPS, 2)),
        ("ranges", np.float64, (BEAMS,)),
        ("order", np.int64, (BEAMS,)),
        ("directions", np.float64, (BEAMS, 2)),
        ("points", np.float64, (2, BEAMS)),
        ("outline", np.float64, (OUTLINE_POINTS, 2)),
        ("local_layer", np.uint8, _WINDOW),
        ("local_scratch", np.uint8, _WINDOW),
        ("local_lethal", np.uint8, _WINDOW),
        ("local_costs", np.uint8, _WINDOW),
        ("event_rows", np.float64, (MAX_EVENTS, 6)),
    ],
    align=True,
)
"""What a run remembers, in one record: kernels get it as one pointer, which keeps them small and quick to compile.

`velocities` (speed, yaw rate) is the tick's result for physics; an event row is t, kind, x, y, what, value.
"""

_EXTRA: Final = (
    *("inscribed_radius", "resolution", "origin_x", "origin_y"),
    *("range_min", "range_max", "mount_x", "mount_y"),
    *("max_speed", "max_acceleration", "max_yaw_rate", "max_yaw_acceleration", "mission", "loops"),
)
PARAMETERS: Final = np.dtype([(f.name, np.float64) for f in fields(NavParameters)] + [(n, np.float64) for n in _EXTRA])
"""Parameters under their Nav2 names, and those of map, lidar, robot and mission."""


class Grids(NamedTuple):
    """The map and what the stack makes of it, all (H, W) but the stamp and the scratch.

    Attributes:
        layer: Global obstacle layer; `costs` the master costmap, `travel` NavFn's costs of it, `flooded` those at the
            time of the last flood, `potential` what that gave.
    """

    leap: Any
    cubed: Any
    static: Any
    stamp: Any
    layer: Any
    costs: Any
    travel: Any
    flooded: Any
    potential: Any
    scratch: Any


class Route(NamedTuple):
    """Goals (G, 3) x, y, yaw, and points (M, 2): the path and the legs behind the next goal in metres, a leg in cells."""

    goals: Any
    path: Any
    leg: Any
    tail: Any


@dataclass(frozen=True, eq=False)
class Stack:
    """Everything a run's ticks read and write.

    Attributes:
        p, m: (1,) records of `PARAMETERS` and `MEMORY`.
        obstacles: (K, 6) as in `vastflow.sim.lidar.scan`.
        rows: (R, 12) int32 of `COLUMNS`.
    """

    p: NDArray[np.void]
    m: NDArray[np.void]
    grids: Grids
    cloud: Cloud
    route: Route
    obstacles: NDArray[np.float64]
    rows: NDArray[np.int32]


def new_stack(
    prepared: PreparedMap,
    parameters: NavParameters,
    lidar: Lidar,
    robot: Robot,
    mission: Mission,
    obstacles: NDArray[np.float64],
    streams: NDArray[np.uint64],
    timeout_s: float,
) -> Stack:
    """A stack at rest at the mission's start, its estimate there with zero covariance, nothing planned."""
    shape = prepared.static.shape
    leg_points = 4 * max(shape)
    path_points = leg_points * (len(mission.goals) if mission.kind == "navigate_through_poses" else 1)
    memory = np.zeros(1, dtype=MEMORY)
    m, start = memory[0], mission.start
    m["true_x"], m["true_y"], m["true_yaw"] = start.x_m, start.y_m, start.yaw_rad
    m["map_odom_x"], m["map_odom_y"], m["map_odom_yaw"] = start.x_m, start.y_m, start.yaw_rad
    m["x"], m["y"], m["yaw"] = start.x_m, start.y_m, start.yaw_rad
    m["first_scan"], m["planned_goal"] = 1, -1
    m["streams"], m["directions"], m["ranges"] = streams, lidar.directions(), np.inf
    angles_rad = 2 * np.pi * np.arange(OUTLINE_POINTS) / OUTLINE_POINTS
    radius_m = parameters.robot_radius + parameters.footprint_padding
    m["outline"] = radius_m * np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])
    # A lethal cell under the outline lies at most this far from the centre's cell, so it costs at least that there.
    reach_cells = math.ceil(radius_m / prepared.occupancy.resolution_m) + 2
    middle = prepared.stamp.shape[0] // 2
    m["outline_cost"] = prepared.stamp[middle, middle + reach_cells] if reach_cells <= middle else 0
    return Stack(
        p=_parameter_record(parameters, lidar, robot, prepared, mission),
        m=memory,
        grids=Grids(
            leap=prepared.leap,
            cubed=prepared.cubed,
            static=prepared.static,
            stamp=prepared.stamp,
            layer=np.zeros(shape, dtype=np.uint8),
            costs=prepared.costs.copy(),
            travel=prepared.travel.copy(),
            flooded=prepared.travel.copy(),
            potential=new_potential(shape),
            scratch=new_scratch(shape),
        ),
        cloud=new_cloud(parameters.max_particles),
        route=Route(
            goals=np.array([[g.x_m, g.y_m, g.yaw_rad] for g in mission.goals]),
            path=np.zeros((path_points, 2)),
            leg=np.zeros((leg_points, 2)),
            tail=np.zeros((path_points, 2)),
        ),
        obstacles=obstacles,
        rows=np.zeros((int(timeout_s / (TICK_S * ROW_TICKS)) + 8, len(COLUMNS)), dtype=np.int32),
    )


def _parameter_record(
    parameters: NavParameters, lidar: Lidar, robot: Robot, prepared: PreparedMap, mission: Mission
) -> NDArray[np.void]:
    values: dict[str, float] = {
        **asdict(parameters),
        "inscribed_radius": parameters.inscribed_radius_m,
        "resolution": prepared.occupancy.resolution_m,
        "origin_x": prepared.occupancy.origin_xy_m[0],
        "origin_y": prepared.occupancy.origin_xy_m[1],
        "range_min": lidar.range_min_m,
        "range_max": lidar.range_max_m,
        "mount_x": lidar.mount_xyt[0],
        "mount_y": lidar.mount_xyt[1],
        "max_speed": robot.max_speed_mps,
        "max_acceleration": robot.max_acceleration_mps2,
        "max_yaw_rate": robot.max_yaw_rate_radps,
        "max_yaw_acceleration": robot.max_yaw_acceleration_radps2,
        "mission": MISSION_KINDS[mission.kind],
        "loops": mission.loops,
    }
    return np.array([tuple(float(values[name]) for name in PARAMETERS.names or ())], dtype=PARAMETERS)
