"""The robot's body, limits, and scanner, as given by a campaign or derived from its navigation stack."""

from collections.abc import Iterator, Mapping
from typing import Final

from vastflow.sim.model.elementary import hypot
from vastflow.sim.model.polygon import Vertices, vertices_of
from vastflow.sim.model.rates import held_hz
from vastflow.sim.nav2.parameter_files.command_chain import NO_SMOOTHER
from vastflow.sim.nav2.parameter_files.interpretation import is_omni
from vastflow.sim.nav2.parameters.mppi import MotionModel, MppiParameters
from vastflow.sim.nav2.parameters.servers import SmacPlannerHybrid, VelocitySmoother
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.system.facts import RobotFact, Source
from vastflow.sim.system.robot import IDEAL, Latency, LidarParameters, OdometryDrift
from vastflow.sim.world.noise_registry import GaussianDropoutParameters
from vastflow.sim.world.robot_model import TURTLEBOT_4, TURTLEBOT_4_LIDAR, TURTLEBOT_4_RADIUS_M, Drive, Lidar, Robot

_DEFAULT_SMOOTHER: Final = VelocitySmoother()
_GREATEST_SPEEDS: Final = ("vx_max", "max_vel_x", "desired_linear_vel")
"""Parameters of MPPI, DWB and RPP."""

_DRIVES: Final[Mapping[MotionModel, Drive]] = {"DiffDrive": "differential", "Ackermann": "ackermann", "Omni": "omni"}
"""MPPI's motion models to the drives that they are of."""


def robot_of(parameters: NavParameters) -> Robot:
    """Return the robot that drives with a stack's parameters.

    What the section `robot` gives counts. Else its body is the local costmap's polygon without padding, or a disc of `robot_radius`;
    of the radius in Nav2's default file it is the TurtleBot 4 that this file is for. Its actuators are the TurtleBot 4's, and
    stronger where the velocity smoother allows more than it does in the default file. Its drive is that of MPPI's motion model, and
    omni where DWB samples motion to the side.
    """
    given = parameters.robot
    vertices, radius_m = _body(parameters)
    speed, acceleration, yaw_rate, yaw_acceleration = _limits(parameters)
    return Robot(  # what is given is greater than 0
        radius_m,
        given.mass or TURTLEBOT_4.mass_kg,
        given.max_speed or speed,
        given.max_acceleration or acceleration,
        given.max_yaw_rate or yaw_rate,
        given.max_yaw_acceleration or yaw_acceleration,
        vertices,
        *_drive(parameters),
    )


def lidar_of(parameters: NavParameters) -> Lidar:
    """Return the scanner of the section `robot`, or the TurtleBot 4's."""
    given, own = parameters.robot.lidar, TURTLEBOT_4_LIDAR
    if given == LidarParameters():
        return own
    beams = given.beams or own.beams
    first_rad, last_rad, usual = own.angle_min_rad, own.angle_max_rad, own.mount_xyt
    if given.angle_min is not None and given.angle_max is not None:
        # The default mount is at the center if the scanner's angles are given.
        first_rad, last_rad, usual = given.angle_min, given.angle_max, (0.0, 0.0, 0.0)
    mount = zip((given.x, given.y, given.yaw), usual, strict=True)
    x_m, y_m, yaw_rad = (assumed if each is None else each for each, assumed in mount)
    return Lidar(
        beams,
        first_rad,
        (last_rad - first_rad) / (beams - 1),
        own.range_min_m if given.range_min is None else given.range_min,
        own.range_max_m if given.range_max is None else given.range_max,
        own.rate_hz if given.rate is None else held_hz(given.rate),
        (x_m, y_m, yaw_rad),
        bool(given.sweeps),
    )


def robot_facts(parameters: NavParameters) -> tuple[RobotFact, ...]:
    """Return the simulator's assumptions about the robot in words."""
    noise = parameters.lidar_noise
    of_noise = () if isinstance(noise, GaussianDropoutParameters) else (_given("lidar noise", type(noise).__name__),)
    return (
        *_driving_facts(parameters),
        *_lidar_facts(parameters),
        *of_noise,
        *_latency_facts(parameters.latency),
        *_drift_facts(parameters.odometry),
    )


def _body(parameters: NavParameters) -> tuple[Vertices, float]:
    """Return the vertices, and the distance of the farthest or a disc's radius (m)."""
    given, costmap = parameters.robot, parameters.local_costmap
    if given.radius is not None:
        return (), given.radius
    vertices = vertices_of(given.polygon or costmap.footprint)
    if vertices:
        return vertices, max(hypot(x_m, y_m) for x_m, y_m in vertices)
    return (), TURTLEBOT_4.radius_m if costmap.robot_radius == TURTLEBOT_4_RADIUS_M else costmap.robot_radius


def _drive(parameters: NavParameters) -> tuple[Drive, float]:
    """Return the drive and the least turning radius (m), as given or as MPPI or Hybrid-A* assumes."""
    given, controller, planner = parameters.robot, parameters.controller, parameters.planner
    modeled: MotionModel = "Omni" if is_omni(controller) else "DiffDrive"
    if isinstance(controller, MppiParameters):
        modeled = controller.motion_model
    assumed = "ackermann" if given.min_turning_radius is not None else _DRIVES[modeled]
    drive = given.drive or assumed
    if drive != "ackermann":
        return drive, 0.0
    if given.min_turning_radius is not None:
        return drive, given.min_turning_radius
    if isinstance(controller, MppiParameters) and modeled == "Ackermann":
        return drive, controller.AckermannConstraints.min_turning_r
    assert isinstance(planner, SmacPlannerHybrid)  # the document would have been refused, see `interpretation`
    return drive, planner.minimum_turning_radius


def _limits(parameters: NavParameters) -> tuple[float, float, float, float]:
    """Return speed, acceleration, yaw rate, and yaw acceleration that follow from the stack."""
    own, smoother = TURTLEBOT_4, parameters.velocity_smoother
    if smoother == NO_SMOOTHER:
        asked = (getattr(parameters.controller, name, 0.0) for name in _GREATEST_SPEEDS)
        speed_mps = max(own.max_speed_mps, *asked)
        return speed_mps, own.max_acceleration_mps2, own.max_yaw_rate_radps, own.max_yaw_acceleration_radps2
    forward, _, turning = (
        max(high, -low) for high, low in zip(smoother.max_velocity, smoother.min_velocity, strict=True)
    )
    return (
        max(own.max_speed_mps, forward),
        _acceleration(smoother, 0, own.max_acceleration_mps2),
        max(own.max_yaw_rate_radps, turning),
        _acceleration(smoother, 2, own.max_yaw_acceleration_radps2),
    )


def _acceleration(smoother: VelocitySmoother, axis: int, own: float) -> float:
    """Return the greatest acceleration on an axis: the smoother's, or the robot's own for default limits."""
    limits = smoother.max_accel[axis], smoother.max_decel[axis]
    usual = _DEFAULT_SMOOTHER.max_accel[axis], _DEFAULT_SMOOTHER.max_decel[axis]
    return own if limits == usual else max(own, limits[0], -limits[1])


def _driving_facts(parameters: NavParameters) -> Iterator[RobotFact]:
    given, robot, own = parameters.robot, robot_of(parameters), TURTLEBOT_4
    body = f"polygon of {len(robot.vertices)} vertices" if robot.vertices else f"disc of {robot.radius_m:g} m"
    is_turtlebots = not robot.vertices and robot.radius_m == own.radius_m
    has_body = given.radius is not None or given.polygon is not None
    yield RobotFact("body", body, _source(has_body, is_turtlebots))
    yield RobotFact("drive", robot.drive, _source(given.drive is not None, robot.drive == own.drive))
    if robot.min_turning_radius_m > 0.0:
        radius = f"{robot.min_turning_radius_m:g} m"
        yield RobotFact("turning radius at least", radius, _source(given.min_turning_radius is not None, False))
    for quantity, unit, described, name in (
        ("mass", "kg", given.mass, "mass_kg"),
        ("speed up to", "m/s", given.max_speed, "max_speed_mps"),
        ("acceleration up to", "m/s²", given.max_acceleration, "max_acceleration_mps2"),
        ("yaw rate up to", "rad/s", given.max_yaw_rate, "max_yaw_rate_radps"),
        ("yaw acceleration up to", "rad/s²", given.max_yaw_acceleration, "max_yaw_acceleration_radps2"),
    ):
        value: float = getattr(robot, name)
        yield RobotFact(quantity, f"{value:g} {unit}", _source(described is not None, value == getattr(own, name)))


def _lidar_facts(parameters: NavParameters) -> Iterator[RobotFact]:
    given, lidar = parameters.robot.lidar, lidar_of(parameters)
    x_m, y_m, yaw_rad = lidar.mount_xyt
    held = "" if given.rate in (None, lidar.rate_hz) else f" ({given.rate:g} Hz is no whole number of 50 ms ticks)"
    own: Source = "a TurtleBot 4's"
    mounted: Source = own if given.angle_min is None else "assumed"
    for quantity, value, described, assumed in (
        ("lidar mounted at x", f"{x_m:g} m", given.x, mounted),
        ("lidar mounted at y", f"{y_m:g} m", given.y, mounted),
        ("lidar turned by", f"{yaw_rad:.4g} rad", given.yaw, mounted),
        ("with", f"{lidar.beams} beams", given.beams, own),
        ("from", f"{lidar.angle_min_rad:.4g} to {lidar.angle_max_rad:.4g} rad", given.angle_min, own),
        ("ranges above", f"{lidar.range_min_m:g} m", given.range_min, own),
        ("ranges below", f"{lidar.range_max_m:g} m", given.range_max, own),
        ("scans at", f"{lidar.rate_hz:.4g} Hz{held}", given.rate, own),
    ):
        yield RobotFact(quantity, value, assumed if described is None else "given")
    if lidar.sweeps:
        yield _given("beams one after the other over", f"{1.0 / lidar.rate_hz:.4g} s a turn")


def _latency_facts(latency: Latency) -> Iterator[RobotFact]:
    if latency == IDEAL:
        yield RobotFact("scans, odometry, and commands", "without latency", "no real robot's")
        return
    for quantity, least_s, jitter_s in (
        ("scans late by", latency.scan_age, latency.scan_jitter),
        ("odometry late by", latency.tf_age, latency.tf_jitter),
        ("commands late by", latency.controller_time, latency.controller_jitter),
    ):
        if least_s or jitter_s:
            yield _given(quantity, f"{least_s:g} s + {jitter_s:g} s in the mean")
    if latency.odometry_rate != IDEAL.odometry_rate:
        yield _given("odometry at", f"{latency.odometry_rate:g} Hz")
    if latency.missed_cycles:
        yield _given("share of missed controller cycles", f"{latency.missed_cycles:g}")
    if not latency.smoother_in_step:
        yield _given("velocity smoother", "out of step with the controller")


def _drift_facts(odometry: OdometryDrift) -> Iterator[RobotFact]:
    for name, value in odometry:
        if value:
            unit = "m" if name.startswith("translation") else "rad"
            yield _given(f"odometry's {name.replace('_', ' ')}", f"{value:g} {unit}")


def _given(quantity: str, value: str) -> RobotFact:
    return RobotFact(quantity, value, "given")


def _source(is_given: bool, is_turtlebots: bool) -> Source:
    if is_given:
        return "given"
    return "a TurtleBot 4's" if is_turtlebots else "from the Nav2 parameters"
