"""Messages on the simulated robot's topics: whether there is a new one, and what is in the last one."""

import math
from typing import Any, Final

import numpy as np

from vastflow.sim.loop.simulation import Simulation
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.scenario.tree.ros_graph import TOPICS

_PLANE: Final = ("xx", "xy", "yy")
_COMMANDS: Final = {"/cmd_vel": "sent", "/cmd_vel_smoothed": "smooth", "/cmd_vel_nav": "command"}


def count(simulation: Simulation, topic: str) -> int:
    """A number that is another after each message; 0 before the first."""
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


def message(simulation: Simulation, topic: str) -> Any:
    """The last message, with its members as dicts, lists and numbers; None before the first."""
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
            points = simulation.frame.points_to_map(simulation.stack.route.path[: int(m["path_n"]), :2]).tolist()
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
    turn = {"x": 0.0, "y": 0.0, "z": math.sin(pose.yaw_rad / 2), "w": math.cos(pose.yaw_rad / 2)}
    return {"position": {"x": pose.x_m, "y": pose.y_m, "z": 0.0}, "orientation": turn}


def _twist(m: Any, which: str) -> dict[str, Any]:
    speed_mps, yaw_rate_radps, lateral_mps = (float(m[f"{which}_{axis}"]) for axis in ("v", "w", "vy"))
    return {
        "linear": {"x": speed_mps, "y": lateral_mps, "z": 0.0},
        "angular": {"x": 0.0, "y": 0.0, "z": yaw_rate_radps},
    }
