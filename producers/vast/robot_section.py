"""The section `robot` of a family: the robot that drives, as parameters `robot.…` with their places."""

from collections.abc import Mapping
from typing import Annotated, Any, Final, TypeAlias, get_args

from pydantic import Field, WithJsonSchema

from vastflow.producers.faults import Fault, Location
from vastflow.producers.vast.document import Document
from vastflow.producers.vast.section import EmptyIsMap, Section
from vastflow.sim.nav2.parameters.robot import PRESETS, robot_keys
from vastflow.sim.world.robot_model import Drive

_NUMBER: Final = WithJsonSchema({"type": ["number", "null"]})
Quantity: TypeAlias = Annotated[Any, _NUMBER]
"""A quantity of a robot; `vastflow.sim.nav2.parameters.robot` reads and checks it."""
Flag: TypeAlias = Annotated[Any, WithJsonSchema({"type": ["boolean", "null"]})]


class LidarSpec(Section):
    """A laser scanner; what is not given is a TurtleBot 4's, but for the mount of one with angles of its own, which is 0."""

    x: Quantity = None
    """Of its mount in the robot's frame (m); -0.04 on a TurtleBot 4."""
    y: Quantity = None
    """Of its mount in the robot's frame (m)."""
    yaw: Quantity = None
    """Of its mount in the robot's frame (rad); the beams' angles begin there."""
    beams: Quantity = None
    """Beams of a scan, 2 to 4096; 360 on a TurtleBot 4."""
    angle_min: Quantity = None
    """Angle of the first beam (rad), counter-clockwise from the mount's yaw; with `angle_max`."""
    angle_max: Quantity = None
    """Angle of the last beam (rad), above `angle_min` by a turn at most."""
    range_min: Quantity = None
    """Shortest range it measures (m); 0.164 on a TurtleBot 4."""
    range_max: Quantity = None
    """What is as far away or farther gives no return (m); 20 on a TurtleBot 4."""
    rate: Quantity = None
    """Scans a second (Hz), 1 to 20; it is held as a whole number of ticks of 50 ms."""
    sweeps: Flag = None
    """Whether each beam has a time of its own in the scanner's turn, counter-clockwise, so that scans of a moving robot are distorted."""


class LatencySpec(Section):
    """How late sensors and computers are; what is not given is the preset's. A jitter is the mean of what comes on top of the least, drawn from
    an exponential distribution; what is older than 0.5 s is taken to come then."""

    preset: Annotated[Any, WithJsonSchema({"enum": [*PRESETS, None]})] = None
    """`ideal` (no latency, if not given), `gazebo`, or `loaded`."""
    scan_age: Quantity = None
    """From the end of a scan until AMCL, costmaps, and collision monitor have it: the least (s)."""
    scan_jitter: Quantity = None
    """Of the scan's age (s)."""
    odometry_rate: Quantity = None
    """Samples of odometry and its transform a second (Hz), 5 to 100."""
    tf_age: Quantity = None
    """From a sample of odometry until the stack has it: the least (s)."""
    tf_jitter: Quantity = None
    """Of odometry's age (s)."""
    controller_time: Quantity = None
    """From the begin of a controller cycle until its command: the least (s). No other begins meanwhile."""
    controller_jitter: Quantity = None
    """Of the controller's time (s)."""
    missed_cycles: Quantity = None
    """Share of the controller's cycles that are left out, 0 to 0.9."""
    smoother_in_step: Flag = None
    """Whether the velocity smoother runs right when a controller's cycle begins, or at a phase drawn for each run."""


class RobotSpec(Section):
    """The robot that drives; what is not given follows from the Nav2 parameters, or is a TurtleBot 4's, and the report says so."""

    radius: Quantity = None
    """Of a body that is a disc (m); without a body the local costmap's footprint is what meets walls."""
    polygon: Annotated[Any, WithJsonSchema({"type": ["array", "string", "null"]})] = None
    """Of a body that is none: `[[x, y], ...]` in the robot's frame (m), or Nav2's text of it."""
    drive: Annotated[Any, WithJsonSchema({"enum": [*get_args(Drive), None]})] = None
    """How it moves; what MPPI's motion model says where it isn't given."""
    min_turning_radius: Quantity = None
    """Of the tightest arc of an ackermann drive (m)."""
    mass: Quantity = None
    """Of the robot (kg), which counts where it pushes things."""
    max_speed: Quantity = None
    """Greatest speed of the wheels' drive (m/s), whatever is commanded."""
    max_acceleration: Quantity = None
    """Greatest acceleration and deceleration of the drive (m/s²)."""
    max_yaw_rate: Quantity = None
    """Greatest yaw rate of the drive (rad/s)."""
    max_yaw_acceleration: Quantity = None
    """Greatest yaw acceleration of the drive (rad/s²)."""
    lidar: Annotated[LidarSpec, EmptyIsMap] = Field(default_factory=LidarSpec)
    """The laser scanner."""
    latency: Annotated[LatencySpec, EmptyIsMap] = Field(default_factory=LatencySpec)
    """How late sensors and computers are."""


def robot_places(
    document: Document, location: Location, fixed: Mapping[str, Location]
) -> tuple[dict[str, Location], list[Fault]]:
    """Places of the quantities below `location`, by their keys, and a fault for each that is a fixed parameter too.

    What the section has that no robot has is for its model to say.
    """
    found: dict[str, Location] = {}
    faults: list[Fault] = []
    for key in robot_keys() if document.known(location) == location else ():
        where = (*location, *key.split(".")[1:])
        if document.known(where) != where or document.value(where) is None:
            continue
        if key in fixed:
            line, _ = document.place(fixed[key], "key")
            faults.append(document.fault(where, f"a second {key!r}", f"one; the first is in line {line}", "key"))
        found[key] = where
    return found, faults
