"""Members of messages, which are dicts, lists, and numbers."""

import ast
import math
from collections.abc import Mapping
from typing import Any

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.pose import Pose


def member_of(found: Any, path: str) -> Any:
    """The member of a message at a path with points; the message itself for an empty one.

    Raises:
        ScenarioError: there is no such member.
    """
    for name in filter(None, path.split(".")):
        if not isinstance(found, Mapping) or name not in found:
            known = f"; {', '.join(found)}" if isinstance(found, Mapping) else ""
            raise ScenarioError(f"the message has no member {name!r} of {path!r}{known}")
        found = found[name]
    return found


def literal(text: str) -> Any:
    """Return the value of a Python literal, such as a message's members in braces.

    Raises:
        ScenarioError: it is no literal.
    """
    try:
        return ast.literal_eval(text.replace("\\", ""))
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        raise ScenarioError(f"expected a literal such as 0.5 or {{'x': 0.5}}, got {text!r}") from None


def with_members(whole: Any, given: Any) -> Any:
    """A message like `whole` that has the given members and is empty otherwise."""
    if not isinstance(whole, Mapping) or not isinstance(given, Mapping):
        return given
    for name in given:
        member_of(whole, str(name))
    # In ROS the turn that is none has w 1, and everything else begins with nothing.
    return {
        name: with_members(value, given[name]) if name in given else 1.0 if name == "w" else _empty(value)
        for name, value in whole.items()
    }


def pose_in(found: Any) -> Pose:
    """The pose in a message of a pose, however deep it lies.

    Raises:
        ScenarioError: there is none.
    """
    while isinstance(found, Mapping) and "pose" in found:
        found = found["pose"]
    if not isinstance(found, Mapping) or not isinstance(found.get("position"), Mapping):
        raise ScenarioError("expected {'pose': {'position': {'x': 1.0, 'y': 2.0}}}, got no pose in the message")
    position, turn = found["position"], found.get("orientation", {})
    if "yaw" in turn:
        yaw_rad = float(turn["yaw"])
    else:
        x, y, z, w = (float(turn.get(axis, 1.0 if axis == "w" else 0.0)) for axis in "xyzw")
        yaw_rad = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return Pose(float(position.get("x", 0.0)), float(position.get("y", 0.0)), yaw_rad)


def velocity_in(found: Any) -> tuple[float, float, float]:
    """Speed (m/s), yaw rate (rad/s) and speed to the left (m/s) in a message of a twist.

    Raises:
        ScenarioError: it is none.
    """
    try:
        linear, angular = found.get("linear", {}), found.get("angular", {})
        return float(linear.get("x", 0.0)), float(angular.get("z", 0.0)), float(linear.get("y", 0.0))
    except (AttributeError, TypeError, ValueError):
        raise ScenarioError(
            "expected {'linear': {'x': 0.2}, 'angular': {'z': 0.0}}, got no twist in the message"
        ) from None


def _empty(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: 1.0 if name == "w" else _empty(member) for name, member in value.items()}
    return type(value)()


def pose_3d_in(found: Any) -> dict[str, Any]:
    """The pose in a message as the struct `pose_3d`.

    Raises:
        ScenarioError: there is none.
    """
    pose = pose_in(found)
    return {
        "position": {"x": pose.x_m, "y": pose.y_m, "z": 0.0},
        "orientation": {"roll": 0.0, "pitch": 0.0, "yaw": pose.yaw_rad},
    }
