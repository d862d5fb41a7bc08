"""Transforms between the frames of the simulated robot."""

import math

from vastflow.sim.behavior.ros_graph import TRUE_FRAME
from vastflow.sim.loop.simulation import Simulation
from vastflow.sim.pose import Pose


def pose_between(simulation: Simulation, parent: str, robot: str) -> Pose | None:
    """Where the robot's frame is in another one; None as long as nobody knows.

    In the map's frame that is where Nav2 takes the robot to be, and for a frame of the truth where it is.
    """
    if robot.endswith(TRUE_FRAME):
        return simulation.true_pose
    if parent == "odom":
        return simulation.odometry
    return simulation.estimate if simulation.localized else None


def moved(before: Pose, after: Pose, duration_s: float) -> tuple[float, float]:
    """Speed (m/s) and yaw rate (rad/s) between two poses, without direction."""
    turned_rad = math.remainder(after.yaw_rad - before.yaw_rad, math.tau)
    driven_m = math.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
    return driven_m / duration_s, abs(turned_rad) / duration_s
