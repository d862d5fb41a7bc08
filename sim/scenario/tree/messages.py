"""Messages on the simulated robot's topics: dicts, lists, and numbers, which are read and written by their members."""

import ast
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vastflow.sim.model.elementary import atan2, cos_sin
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.pose import Pose, placed_points
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.scenario.tree.support import TOPICS

if TYPE_CHECKING:  # helpers read members without a simulator
    from vastflow.sim.loop.simulation import Simulation

_PLANE: Final = ("xx", "xy", "yy")
_COMMANDS: Final = {"/cmd_vel": "sent", "/cmd_vel_smoothed": "smooth", "/cmd_vel_nav": "command"}


def count(simulation: "Simulation", topic: str) -> int:
    """Return a number that changes with each message; 0 before the first."""
    m = simulation.stack.m[0]
    match TOPICS[topic].rhythm:
        case "steady":
            return int(m["tick"]) + 1
        case "latched":
            return 1
        case "amcl":
            return int(m["filter_updates"]) + int(simulation.localized)
        case "command":
            return int(m["command_tick"])
        case "plan":
            return int(m["tick"]) + 1 if m["path_n"] else 0
        case "scenario":
            return len(simulation.published.get(topic, ()))


def message(simulation: "Simulation", topic: str) -> Any:
    """Return the last message, or None before the first."""
    if count(simulation, topic) == 0:
        return None
    if TOPICS[topic].rhythm == "scenario":
        return simulation.published[topic][-1]
    m = simulation.stack.m[0]
    now_s = float(m["tick"]) * TICK_S
    match topic:
        case "/amcl_pose":
            covariance = [0.0] * 36
            xx_m2, xy_m2, yy_m2 = simulation.frame.covariance_to_map(*(float(m[f"pose_{two}"]) for two in _PLANE))
            covariance[0], covariance[1], covariance[6], covariance[7] = xx_m2, xy_m2, xy_m2, yy_m2
            covariance[35] = float(m["pose_aa"])
            return {**_header(now_s, "map"), "pose": {"pose": _pose(simulation.estimate), "covariance": covariance}}
        case "/clock":
            return {"clock": _time(now_s)}
        case "/cmd_vel" | "/cmd_vel_nav" | "/cmd_vel_smoothed":
            return _twist(m, _COMMANDS[topic])
        case "/odom":
            return {
                **_header(now_s, "odom"),
                "child_frame_id": "base_link",
                "pose": {"pose": _pose(simulation.odometry), "covariance": [0.0] * 36},
                "twist": {"twist": _twist(m, "odom"), "covariance": [0.0] * 36},
            }
        case "/plan":
            stack = simulation.stack
            known = placed_points(stack.route.path[: int(m["path_n"]), :2], simulation.planning_frame)
            points = simulation.frame.points_to_map(known).tolist()
            poses = [{**_header(now_s, "map"), "pose": _pose(Pose(x_m, y_m))} for x_m, y_m in points]
            return {**_header(now_s, "map"), "poses": poses}
        case "/scan":
            p = simulation.stack.p[0]
            ranges = np.asarray(m["ranges"][: m["beams"]]).tolist()
            limits = {"range_min": float(p["range_min"]), "range_max": float(p["range_max"])}
            return {**_header(now_s, "base_scan"), **limits, "ranges": ranges}
    return {}


def _header(now_s: float, frame: str) -> dict[str, Any]:
    return {"header": {"stamp": _time(now_s), "frame_id": frame}}


def _time(now_s: float) -> dict[str, int]:
    nanoseconds = round(now_s * 1e9)
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


def _pose(pose: Pose) -> dict[str, Any]:
    c, s = cos_sin(pose.yaw_rad / 2)
    turn = {"x": 0.0, "y": 0.0, "z": s, "w": c}
    return {"position": {"x": pose.x_m, "y": pose.y_m, "z": 0.0}, "orientation": turn}


def _twist(m: Any, which: str) -> dict[str, Any]:
    speed_mps, yaw_rate_radps, lateral_mps = (float(m[f"{which}_{axis}"]) for axis in ("v", "w", "vy"))
    return {
        "linear": {"x": speed_mps, "y": lateral_mps, "z": 0.0},
        "angular": {"x": 0.0, "y": 0.0, "z": yaw_rate_radps},
    }


def member_of(found: Any, path: str) -> Any:
    """Return the member of a message at a dotted path, the message itself for an empty one; ScenarioError without it."""
    for name in filter(None, path.split(".")):
        if not isinstance(found, Mapping) or name not in found:
            known = f"; {', '.join(found)}" if isinstance(found, Mapping) else ""
            raise ScenarioError(f"the message has no member {name!r} of {path!r}{known}")
        found = found[name]
    return found


def literal(text: str) -> Any:
    """Return the value of a Python literal, such as a message's members in braces; ScenarioError if it is none."""
    try:
        return ast.literal_eval(text.replace("\\", ""))
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        raise ScenarioError(f"expected a literal such as 0.5 or {{'x': 0.5}}, got {text!r}") from None


def with_members(whole: Any, given: Any) -> Any:
    """Return a message like `whole` with the given members, and empty otherwise."""
    if not isinstance(whole, Mapping) or not isinstance(given, Mapping):
        return given
    for name in given:
        member_of(whole, str(name))
    # In ROS the turn that is none has w 1, and everything else begins with nothing.
    found = {}
    for name, member in whole.items():
        empty: Any = {} if isinstance(member, Mapping) else 1.0 if name == "w" else type(member)()
        found[name] = with_members(member, given.get(name, empty))
    return found


def pose_in(found: Any) -> Pose:
    """Return the pose in a message, at any depth; ScenarioError without one."""
    while isinstance(found, Mapping) and "pose" in found:
        found = found["pose"]
    if not isinstance(found, Mapping) or not isinstance(found.get("position"), Mapping):
        raise ScenarioError("expected {'pose': {'position': {'x': 1.0, 'y': 2.0}}}, got no pose in the message")
    position, turn = found["position"], found.get("orientation", {})
    if "yaw" in turn:
        yaw_rad = float(turn["yaw"])
    else:
        x, y, z, w = (float(turn.get(axis, 1.0 if axis == "w" else 0.0)) for axis in "xyzw")
        yaw_rad = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return Pose(float(position.get("x", 0.0)), float(position.get("y", 0.0)), yaw_rad)


def velocity_in(found: Any) -> tuple[float, float, float]:
    """Return speed (m/s), yaw rate (rad/s), and speed to the left (m/s) of a twist; ScenarioError if it is none."""
    try:
        linear, angular = found.get("linear", {}), found.get("angular", {})
        return float(linear.get("x", 0.0)), float(angular.get("z", 0.0)), float(linear.get("y", 0.0))
    except (AttributeError, TypeError, ValueError):
        right = "{'linear': {'x': 0.2}, 'angular': {'z': 0.0}}"
        raise ScenarioError(f"expected {right}, got no twist in the message") from None


def pose_3d_in(found: Any) -> dict[str, Any]:
    """Return the pose in a message as the struct `pose_3d`; ScenarioError without one."""
    pose = pose_in(found)
    turn = {"roll": 0.0, "pitch": 0.0, "yaw": pose.yaw_rad}
    return {"position": {"x": pose.x_m, "y": pose.y_m, "z": 0.0}, "orientation": turn}
