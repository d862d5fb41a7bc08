"""Topics of a bag under the names of Nav2's bringup, with their types and qualities of service."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Final

from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from rosbags.interfaces import Qos
    from rosbags.typesys.store import Typestore

MAP, ODOM, BASE, TRUE_BASE, LASER = "map", "odom", "base_link", "base_link_true", "base_scan"
"""Frames: the tree is map, odom, base_link, base_scan; where the robot truly is hangs from the map, as no frame has two parents."""

NAV2_TYPES: Final = {
    "nav2_msgs/msg/Particle": "geometry_msgs/Pose pose\nfloat64 weight\n",
    "nav2_msgs/msg/ParticleCloud": "std_msgs/Header header\nParticle[] particles\n",
    "nav2_msgs/msg/BehaviorTreeStatusChange": (
        "builtin_interfaces/Time timestamp\nstring node_name\nuint16 uid\nstring previous_status\nstring current_status\n"
    ),
    "nav2_msgs/msg/BehaviorTreeLog": "builtin_interfaces/Time timestamp\nBehaviorTreeStatusChange[] event_log\n",
}
"""Definitions of Nav2's messages in Jazzy, which no type store has."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic's type and the quality of service that it is offered with.

    Attributes:
        depth: Messages that are kept for a late or slow subscriber.
        latched: Offered as transient local: a subscriber gets the last messages when it comes.
        best_effort: Offered without a promise that all arrive, as sensors do.
    """

    kind: str
    depth: int = 1
    latched: bool = False
    best_effort: bool = False


TOPICS: Final[Mapping[str, Topic]] = {
    "/clock": Topic("rosgraph_msgs/msg/Clock", best_effort=True),
    "/tf": Topic("tf2_msgs/msg/TFMessage", depth=100),
    "/tf_static": Topic("tf2_msgs/msg/TFMessage", latched=True),
    "/map": Topic("nav_msgs/msg/OccupancyGrid", latched=True),
    "/initialpose": Topic("geometry_msgs/msg/PoseWithCovarianceStamped"),
    "/goal_pose": Topic("geometry_msgs/msg/PoseStamped"),
    "/odom": Topic("nav_msgs/msg/Odometry", depth=10),
    "/scan": Topic("sensor_msgs/msg/LaserScan", depth=5, best_effort=True),
    "/amcl_pose": Topic("geometry_msgs/msg/PoseWithCovarianceStamped", latched=True),
    "/particle_cloud": Topic("nav2_msgs/msg/ParticleCloud", depth=5, best_effort=True),
    "/plan": Topic("nav_msgs/msg/Path"),
    "/transformed_global_plan": Topic("nav_msgs/msg/Path"),
    "/optimal_trajectory": Topic("nav_msgs/msg/Path"),
    "/global_costmap/costmap": Topic("nav_msgs/msg/OccupancyGrid", latched=True),
    "/local_costmap/costmap": Topic("nav_msgs/msg/OccupancyGrid", latched=True),
    "/local_costmap/published_footprint": Topic("geometry_msgs/msg/PolygonStamped"),
    "/cmd_vel_nav": Topic("geometry_msgs/msg/Twist"),
    "/cmd_vel": Topic("geometry_msgs/msg/Twist"),
    "/behavior_tree_log": Topic("nav2_msgs/msg/BehaviorTreeLog", depth=10),
    "/rosout": Topic("rcl_interfaces/msg/Log", depth=1000),
    "/ground_truth/odom": Topic("nav_msgs/msg/Odometry", depth=10),
    "/ground_truth/obstacles": Topic("visualization_msgs/msg/MarkerArray", latched=True),
    "/ground_truth/movers": Topic("visualization_msgs/msg/MarkerArray"),
    "/ground_truth/contacts": Topic("visualization_msgs/msg/MarkerArray", latched=True),
}
"""In the order in which messages of one time are written: transforms before what is placed by them."""


@cache
def typestore() -> "Typestore":
    """Return the types of ROS 2 Jazzy and Nav2; raises `UserError` without the extra `ros`."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise UserError("bags need the package rosbags: pip install 'vastflow[ros]'") from None
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, definition in NAV2_TYPES.items():
        store.register(get_types_from_msg(definition, name))
    return store


def offered(topic: Topic) -> "Qos":
    """Return the quality of service that a topic is offered with."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    always = QosTime(9223372036, 854775807)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=topic.depth,
        reliability=QosReliability.BEST_EFFORT if topic.best_effort else QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if topic.latched else QosDurability.VOLATILE,
        deadline=always,
        lifespan=always,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=always,
        avoid_ros_namespace_conventions=False,
    )
