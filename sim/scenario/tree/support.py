"""The simulated part of a ROS graph, what actions require of it, and what can't be run."""

import functools
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

from vastflow.sim.model.faults import Fault, ScenarioError
from vastflow.sim.scenario.definition import Call, ScenarioDefinition, behaviors_of
from vastflow.sim.scenario.evaluation import evaluate

Rhythm: TypeAlias = Literal["steady", "latched", "amcl", "command", "plan", "scenario"]


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of the simulated robot.

    Attributes:
        type: Type of its messages, as a scenario names it.
        rhythm: When a message comes: all the time, once before the run begins, with each update of AMCL, with each command of the
            controller, as long as there is a plan, or when a scenario publishes one.
        publishers: Nodes, without their slash; none where only a scenario publishes.
        subscribers: Nodes, without their slash.
        has_content: Whether members of its messages can be looked at.
    """

    type: str
    rhythm: Rhythm
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...] = ()
    has_content: bool = True


_COSTMAP: Final = "nav_msgs.msg.OccupancyGrid"

TOPICS: Final[Mapping[str, Topic]] = {
    "/amcl_pose": Topic("geometry_msgs.msg.PoseWithCovarianceStamped", "amcl", ("amcl",)),
    "/clock": Topic("rosgraph_msgs.msg.Clock", "steady", ("ros_gz_bridge",)),
    "/cmd_vel": Topic("geometry_msgs.msg.Twist", "command", ("collision_monitor",), ("ros_gz_bridge",)),
    "/cmd_vel_nav": Topic("geometry_msgs.msg.Twist", "command", ("controller_server",), ("velocity_smoother",)),
    "/cmd_vel_smoothed": Topic("geometry_msgs.msg.Twist", "command", ("velocity_smoother",), ("collision_monitor",)),
    "/global_costmap/costmap": Topic(_COSTMAP, "steady", ("global_costmap",), (), False),
    "/goal_pose": Topic("geometry_msgs.msg.PoseStamped", "scenario", (), ("bt_navigator",)),
    "/initialpose": Topic("geometry_msgs.msg.PoseWithCovarianceStamped", "scenario", (), ("amcl",)),
    "/local_costmap/costmap": Topic(_COSTMAP, "steady", ("local_costmap",), (), False),
    "/map": Topic(_COSTMAP, "latched", ("map_server",), ("amcl", "global_costmap"), False),
    "/odom": Topic("nav_msgs.msg.Odometry", "steady", ("ros_gz_bridge",), ("bt_navigator", "controller_server")),
    "/particle_cloud": Topic("nav2_msgs.msg.ParticleCloud", "amcl", ("amcl",), (), False),
    "/plan": Topic("nav_msgs.msg.Path", "plan", ("planner_server",)),
    "/robot_description": Topic("std_msgs.msg.String", "latched", ("robot_state_publisher",), (), False),
    "/scan": Topic("sensor_msgs.msg.LaserScan", "steady", ("ros_gz_bridge",), ("amcl", "local_costmap")),
    "/tf": Topic("tf2_msgs.msg.TFMessage", "steady", ("amcl", "ros_gz_bridge"), ("amcl",), False),
    "/tf_static": Topic("tf2_msgs.msg.TFMessage", "latched", ("robot_state_publisher",), ("amcl",), False),
}

NODES: Final = frozenset(
    {
        *(node for topic in TOPICS.values() for node in (*topic.publishers, *topic.subscribers)),
        *("behavior_server", "lifecycle_manager_localization", "lifecycle_manager_navigation"),
        *("global_costmap/global_costmap", "local_costmap/local_costmap", "smoother_server", "waypoint_follower"),
    }
)
"""Names of simulated nodes, without a slash."""

PUBLISHABLE: Final = ("/cmd_vel", "/cmd_vel_nav", "/goal_pose", "/initialpose")
"""Topics on which a scenario can publish something that has an effect."""

PARENT_FRAMES: Final = ("map", "odom")
ROBOT_FRAMES: Final = ("base_link", "base_footprint")
TRUE_FRAME: Final = "_gt"
"""Suffix of the robot's frame at its true pose, as opposed to its estimated one."""


def absolute(name: str) -> str:
    """Return the name of a topic with its slash."""
    return name if name.startswith("/") else f"/{name}"


def topic_fault(name: str, type_: str = "") -> str:
    """Explain why a topic can't be listened to; empty if it can.

    Args:
        type_: Type of its messages, as a scenario names it; not checked where it is empty.
    """
    topic = TOPICS.get(absolute(name))
    if topic is None:
        return f"nothing publishes {name} here. The topics are {', '.join(TOPICS)}"
    if type_ and type_.replace("/", ".") != topic.type:
        return f"the messages of {name} are {topic.type}, not {type_}"
    return ""


def content_fault(name: str, type_: str) -> str:
    """Explain why the messages of a topic can't be inspected; empty if they can."""
    fault = topic_fault(name, type_)
    if fault or TOPICS[absolute(name)].has_content:
        return fault
    return f"what is in the messages of {name} is not simulated, only that they come (wait_for_data)"


def publication_fault(name: str, type_: str) -> str:
    """Explain why a scenario can't publish on a topic; empty if it can."""
    if absolute(name) not in PUBLISHABLE:
        return f"nothing here reads {name}. Scenarios can publish on {', '.join(PUBLISHABLE)}"
    return topic_fault(name, type_)


def nodes_fault(names: Sequence[str]) -> str:
    """Explain which nodes don't exist; empty if all do."""
    absent = [name for name in names if name.removeprefix("/") not in NODES]
    return f"there is no node {', '.join(absent)} here. The nodes are {', '.join(sorted(NODES))}" if absent else ""


def end_fault(topic: str, node: str, publishes: bool) -> str:
    """Explain why a node is not at one end of a topic; empty if it is."""
    if fault := topic_fault(topic) or nodes_fault([node]):
        return fault
    known = TOPICS[absolute(topic)]
    if node.removeprefix("/") in (known.publishers if publishes else known.subscribers):
        return ""
    return f"node {node} does not {'publish on' if publishes else 'subscribe to'} {topic} here"


def frames_fault(parent: str, robot: str) -> str:
    """Explain why a transform has no such frames; empty if it has."""
    if parent not in PARENT_FRAMES:
        return f"there is no frame {parent!r} to look from here, only {' and '.join(PARENT_FRAMES)}"
    if robot not in ROBOT_FRAMES and not robot.endswith(TRUE_FRAME):
        return f"there is no frame {robot!r} of the robot here, only {', '.join(ROBOT_FRAMES)} and those of the truth, …{TRUE_FRAME}"
    return ""


REQUIREMENTS: Final[Mapping[str, tuple[Callable[..., str], tuple[str, ...]]]] = {
    "wait_for_data": (topic_fault, ("topic_name", "topic_type")),
    "check_data": (content_fault, ("topic_name", "topic_type")),
    "topic_monitor": (content_fault, ("topic_name", "topic_type")),
    "topic_publish": (publication_fault, ("topic_name", "topic_type")),
    "wait_for_topics": (lambda topics: next(filter(None, map(topic_fault, topics)), ""), ("topics",)),
    "wait_for_nodes": (nodes_fault, ("nodes",)),
    "wait_for_topic_publisher": (functools.partial(end_fault, publishes=True), ("topic", "node_name")),
    "wait_for_topic_subscription": (functools.partial(end_fault, publishes=False), ("topic", "node_name")),
    "assert_tf_moving": (frames_fault, ("parent_frame_id", "frame_id")),
    "differential_drive_robot.tf_close_to": (frames_fault, ("parent_frame_id", "robot_frame_id")),
}
"""Action to what tells what its arguments lack, and those arguments."""


def lacking(action: str, arguments: Mapping[str, Any]) -> str:
    """Explain why a call can't be run; empty if it can."""
    if action not in REQUIREMENTS:
        return ""
    fault, names = REQUIREMENTS[action]
    return fault(*(arguments[name] for name in names))


_NO_SERVICES = "it asks a node for a service, and nothing offers one: the navigation stack runs inside the simulator"
_NO_CLOCK = "it measures how fast a machine is, and simulated time does not depend on that"
_NO_LOG = (
    "it reads the log of ROS nodes, and in a scenario without a differential_drive_robot there are none. Use "
    "process_log_check for a program of your own"
)
_NO_GAZEBO = "it steers a simulator of its own, but a run's simulator is started, stepped and ended by vastflow"
_NO_CLUSTER = "it starts or looks after containers. Use `execution` in the campaign file"
_NO_ARM = "it moves an arm, and the simulated robot has none"
_NO_NETWORK = "a run may depend on nothing but its configuration and seed, and so reaches no network"

REASONS: Final[Mapping[str, str]] = {
    "ros_run": "it starts a ROS node, and there is no ROS. Use run_process for a program of your own",
    "bag_play": "it plays messages to ROS nodes, and there are none",
    "wait_for_services": _NO_SERVICES,
    "wait_for_service_server": _NO_SERVICES,
    "service_call": _NO_SERVICES,
    "action_call": f"{_NO_SERVICES}. Use nav_to_pose and its like to send the robot",
    "set_node_parameter": f"{_NO_SERVICES}. Set parameters in the campaign's Nav2 parameter file",
    "assert_lifecycle_state": f"{_NO_SERVICES}. Nav2 is active from the start",
    "check_data_external": "it runs Python of your own on messages. Use check_data to compare a member of one with a value",
    "assert_topic_latency": _NO_CLOCK,
    "assert_realtime_factor": _NO_CLOCK,
    "load_world": f"{_NO_GAZEBO}. The world is the configuration's map or floor plan",
    "unload_world": _NO_GAZEBO,
    "reset_simulation": _NO_GAZEBO,
    "set_entity_state": f"{_NO_GAZEBO}. Use delete_entity and spawn_entity to move a thing",
    "step_simulation": _NO_GAZEBO,
    "set_simulation_state": _NO_GAZEBO,
    "generate_floorplan": "floor plans are made before a run, by the campaign's FloorplanGeneration",
    "http_get": _NO_NETWORK,
}
"""Why an action can't be had here, by its name without an actor's."""

FAMILIES: Final[Mapping[str, str]] = {
    "docker": _NO_CLUSTER,
    "kubernetes": _NO_CLUSTER,
    "moveit": _NO_ARM,
    "pybullet": _NO_GAZEBO,
    "http": _NO_NETWORK,
}
"""The same by how the name of an action or its actor begins."""

ROBOT: Final = "differential_drive_robot"

GENERIC: Final = "vastflow's simulator has no such action. One of your own can inherit from an action of a library"


def unsupported(definition: ScenarioDefinition, known: Container[str]) -> list[Fault]:
    """Return a fault for every call of an action that nothing implements, in the order of the file.

    Args:
        known: Qualified names of the actions that a run has.
    """
    has_robot = any(ROBOT in actor.types for actor in definition.actors)
    calls = (behavior for behavior in behaviors_of(definition.root) if isinstance(behavior, Call))
    return [
        Fault(call.place, f"{call.action} can't be run here", reason)
        for call in calls
        if (reason := _reason(call, known, has_robot))
    ]


def _reason(call: Call, known: Container[str], has_robot: bool) -> str:
    """Return why a call can't be run here; empty where it can."""
    if call.action == "log_check" and call.action in known and not has_robot:
        return _NO_LOG
    if call.action in known:
        names = REQUIREMENTS[call.action][1] if call.action in REQUIREMENTS else ()
        try:
            return lacking(call.action, {name: evaluate(call.arguments[name], {}, {}) for name in names})
        except ScenarioError:  # only a run knows them
            return ""
    actor, _, name = call.action.rpartition(".")
    families = (reason for start, reason in FAMILIES.items() if name.startswith(start) or actor.startswith(start))
    return REASONS.get(name) or next(families, GENERIC)
