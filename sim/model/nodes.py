"""The nodes of a campaign's runs: processes of ROS 2 that drive the robot, and how they are met."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final, Literal, TypeAlias

TOPICS: Final[Mapping[str, str]] = {
    "amcl_pose": "/amcl_pose",
    "clock": "/clock",
    "cmd_vel": "/cmd_vel",
    "goal": "/goal_pose",
    "initialpose": "/initialpose",
    "joint_states": "/joint_states",
    "map": "/map",
    "odom": "/odom",
    "rosout": "/rosout",
    "scan": "/scan",
    "tf": "/tf",
    "tf_static": "/tf_static",
}
"""Role to topic, as Nav2's bringup has them."""
FRAMES: Final[Mapping[str, str]] = {"map": "map", "odom": "odom", "base": "base_link", "laser": "base_scan"}
"""Role to frame (REP 105)."""
ACTIONS: Final[Mapping[str, str]] = {
    name: f"/{name}" for name in ("navigate_to_pose", "navigate_through_poses", "follow_waypoints")
}
HOST_LATE: Final = "the host was late"
"""What the fault of a run begins with whose time the host did not keep."""
RECORDED: Final = ("/plan", "/local_costmap/costmap", "/global_costmap/costmap", "/cmd_vel", "/amcl_pose")
MESSAGES: Final = "ros2"
"""Folder of a run's outputs: `messages.csv` has time, topic, type, and size of each recorded message, `messages.cdr` their contents."""

Readiness: TypeAlias = Literal["topic", "action", "node", "log", "port", ""]


@dataclass(frozen=True, slots=True)
class NodeProcess:
    """A process that belongs to a run, such as a node or a launch file.

    Attributes:
        command: Program and arguments.
        ready, ready_at: What shows that it is ready: a topic that is published, an action that is served, a node, a line of its log
            that contains a text, or a TCP port of the loopback; empty where it need not be waited for.
        ready_within_s: Host time after which it counts as broken.
    """

    name: str
    command: tuple[str, ...]
    environment: Mapping[str, str] = field(default_factory=dict)
    ready: Readiness = ""
    ready_at: str = ""
    ready_within_s: float = 30.0


@dataclass(frozen=True, slots=True)
class Nodes:
    """The nodes that drive the robot.

    Attributes:
        processes: Processes in the order of their start.
        python: The Python that imports rclpy.
        time: Whether a tick waits for the answer to each scan, or for the host's clock.
        answer: Topic whose messages answer scans, in lock step.
        answer_within_s: Host time after which a missing answer breaks the run.
        real_time_factor: Simulated seconds in a second of the host, where time is paced.
        most_late: Share of paced ticks that may be late; with more the run is broken.
        most_waiting: Share of paced time for which a thread may wait for a CPU; with more the run is broken.
        mission: Whether missions are Nav2's actions, or goals on a topic.
        goal_tolerance_m: Distance of the true pose from the goal that has reached it, for goals on a topic.
        localization: Who publishes the transform from the map to odometry: `nodes`, or `ideal`, the bridge by the true pose.
        stamped: Whether commands are `TwistStamped`.
        record: Topics of the nodes that are recorded.
        joints: Names of the `left` and `right` wheel, `wheel_radius` and `track` (m), for /joint_states; None where it is not published.
    """

    processes: tuple[NodeProcess, ...] = ()
    python: str = "python3"
    time: Literal["lock_step", "paced"] = "lock_step"
    answer: str = "/cmd_vel"
    answer_within_s: float = 10.0
    real_time_factor: float = 1.0
    most_late: float = 0.02
    most_waiting: float = 0.2
    mission: Literal["action", "topic"] = "action"
    goal_tolerance_m: float = 0.25
    localization: Literal["nodes", "ideal"] = "nodes"
    stamped: bool = False
    topics: Mapping[str, str] = field(default_factory=lambda: TOPICS)
    frames: Mapping[str, str] = field(default_factory=lambda: FRAMES)
    actions: Mapping[str, str] = field(default_factory=lambda: ACTIONS)
    record: tuple[str, ...] = RECORDED
    joints: Mapping[str, Any] | None = None

    @property
    def words(self) -> str:
        """Their names, and how time goes."""
        names = ", ".join(each.name for each in self.processes) or "that the scenario starts"
        time = "in lock step" if self.time == "lock_step" else f"paced at {self.real_time_factor:g} times real time"
        return f"{names}; {time}"

    @property
    def content(self) -> dict[str, Any]:
        """The nodes as a value."""
        return {
            **asdict(self),
            "processes": [{**asdict(each), "command": [*each.command]} for each in self.processes],
            "record": [*self.record],
        }


def nodes_of(content: Mapping[str, Any]) -> Nodes:
    """Return the nodes with this `content`."""
    processes = tuple(NodeProcess(**{**each, "command": tuple(each["command"])}) for each in content["processes"])
    return Nodes(**{**content, "processes": processes, "record": tuple(content["record"])})
