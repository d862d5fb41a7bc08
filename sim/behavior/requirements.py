"""What calls of ROS actions need of the simulated robot's ROS graph, as far as a file says it."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeAlias

from vastflow.sim.behavior.ros_graph import (
    content_fault,
    end_fault,
    frames_fault,
    nodes_fault,
    publication_fault,
    topic_fault,
)
from vastflow.sim.osc.definition import Call, Constant, Expression, ListOf

Requirement: TypeAlias = Callable[..., str]


def topics_fault(topics: Sequence[str]) -> str:
    """What is wrong with the first topic that nothing publishes."""
    return next(filter(None, map(topic_fault, topics)), "")


def publisher_fault(topic: str, node_name: str) -> str:
    """What is wrong with a topic and the node that is to publish on it."""
    return end_fault(topic, node_name, True)


def subscriber_fault(topic: str, node_name: str) -> str:
    """What is wrong with a topic and the node that is to subscribe to it."""
    return end_fault(topic, node_name, False)


REQUIREMENTS: Final[Mapping[str, tuple[Requirement, tuple[str, ...]]]] = {
    "wait_for_data": (topic_fault, ("topic_name", "topic_type")),
    "check_data": (content_fault, ("topic_name", "topic_type")),
    "topic_monitor": (content_fault, ("topic_name", "topic_type")),
    "topic_publish": (publication_fault, ("topic_name", "topic_type")),
    "wait_for_topics": (topics_fault, ("topics",)),
    "wait_for_nodes": (nodes_fault, ("nodes",)),
    "wait_for_topic_publisher": (publisher_fault, ("topic", "node_name")),
    "wait_for_topic_subscription": (subscriber_fault, ("topic", "node_name")),
    "assert_tf_moving": (frames_fault, ("parent_frame_id", "frame_id")),
    "differential_drive_robot.tf_close_to": (frames_fault, ("parent_frame_id", "robot_frame_id")),
}
"""Action to what tells what its arguments lack, and those arguments."""


def lacking(action: str, arguments: Mapping[str, Any]) -> str:
    """What a call lacks here; empty where it lacks nothing."""
    if action not in REQUIREMENTS:
        return ""
    fault, names = REQUIREMENTS[action]
    return fault(*(arguments[name] for name in names))


def lacking_before_a_run(call: Call) -> str:
    """The same as far as it can be told from the file: empty where only a run knows the arguments."""
    names = REQUIREMENTS[call.action][1] if call.action in REQUIREMENTS else ()
    known = {name: _known(call.arguments[name]) for name in names}
    return "" if None in known.values() else lacking(call.action, known)


def _known(expression: Expression) -> Any:
    match expression:
        case Constant(value=value):
            return value
        case ListOf(items=items):
            values = [_known(item) for item in items]
            return None if None in values else values
        case _:
            return None
