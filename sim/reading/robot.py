"""The robot that drives: its body and its limits, after what its navigation stack is told of it."""

import math
from typing import Final

from vastflow.sim.nav.parameters.interpretation import NO_SMOOTHER
from vastflow.sim.nav.parameters.servers import VelocitySmoother
from vastflow.sim.nav.parameters.stack import NavParameters
from vastflow.sim.nav.polygon import vertices_of
from vastflow.sim.world.robot_model import Robot

TURTLEBOT_4: Final = Robot()
TURTLEBOT_4_RADIUS_M: Final = 0.22
"""`robot_radius` of Nav2's default file: larger than the TurtleBot 4 that it is for."""
_DEFAULT_SMOOTHER: Final = VelocitySmoother()
_GREATEST_SPEEDS: Final = ("vx_max", "max_vel_x", "desired_linear_vel")
"""Parameters of MPPI, DWB and RPP."""


def robot_of(parameters: NavParameters) -> Robot:
    """The robot that a stack's parameters describe.

    Its body is the local costmap's polygon without padding, or a disc of `robot_radius`; of the radius in Nav2's default file
    it is the TurtleBot 4 that this file is for. Its actuators are the TurtleBot 4's, and stronger where the velocity smoother
    allows more than it does in the default file.
    """
    costmap, smoother = parameters.local_costmap, parameters.velocity_smoother
    vertices = vertices_of(costmap.footprint)
    radius_m = TURTLEBOT_4.radius_m if costmap.robot_radius == TURTLEBOT_4_RADIUS_M else costmap.robot_radius
    if vertices:
        radius_m = max(math.hypot(x_m, y_m) for x_m, y_m in vertices)
    if smoother == NO_SMOOTHER:
        asked = (getattr(parameters.controller, name, 0.0) for name in _GREATEST_SPEEDS)
        return Robot(radius_m, max_speed_mps=max(TURTLEBOT_4.max_speed_mps, *asked), vertices=vertices)
    forward, _, turning = (
        max(high, -low) for high, low in zip(smoother.max_velocity, smoother.min_velocity, strict=True)
    )
    return Robot(
        radius_m,
        max_speed_mps=max(TURTLEBOT_4.max_speed_mps, forward),
        max_acceleration_mps2=_acceleration(smoother, 0, TURTLEBOT_4.max_acceleration_mps2),
        max_yaw_rate_radps=max(TURTLEBOT_4.max_yaw_rate_radps, turning),
        max_yaw_acceleration_radps2=_acceleration(smoother, 2, TURTLEBOT_4.max_yaw_acceleration_radps2),
        vertices=vertices,
    )


def _acceleration(smoother: VelocitySmoother, axis: int, own: float) -> float:
    """What the actuators reach on an axis: the smoother's limits, unless they are the default file's, which no TurtleBot 4 reaches."""
    limits = smoother.max_accel[axis], smoother.max_decel[axis]
    usual = _DEFAULT_SMOOTHER.max_accel[axis], _DEFAULT_SMOOTHER.max_decel[axis]
    return own if limits == usual else max(own, limits[0], -limits[1])
