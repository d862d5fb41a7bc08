"""A layout for Foxglove: map, costmaps, paths, and scans in one panel, plots and states beside it."""

import json
from typing import Any, Final

from vastflow.flows.export.mcap.topics import MAP

NAME: Final = "foxglove.json"
_PLOTS: Final = {
    "Plot!speed": [
        "/cmd_vel_nav.linear.x",
        "/cmd_vel.linear.x",
        "/odom.twist.twist.linear.x",
        "/ground_truth/odom.twist.twist.linear.x",
    ],
    "Plot!place": [
        "/amcl_pose.pose.pose.position.x",
        "/ground_truth/odom.pose.pose.position.x",
        "/amcl_pose.pose.pose.position.y",
        "/ground_truth/odom.pose.pose.position.y",
    ],
}
_LINE: Final = {"visible": True, "type": "line", "lineWidth": 0.04}
_DRAWN: Final[dict[str, dict[str, Any]]] = {
    "/map": {"visible": True, "colorMode": "map"},
    "/global_costmap/costmap": {"visible": False, "colorMode": "costmap", "alpha": 0.4},
    "/local_costmap/costmap": {"visible": True, "colorMode": "costmap", "alpha": 0.5},
    "/local_costmap/published_footprint": {"visible": True},
    "/scan": {"visible": True, "colorMode": "flat", "flatColor": "#d62728", "pointSize": 4, "decayTime": 0},
    "/particle_cloud": {"visible": False},
    "/plan": {**_LINE, "gradient": ["#1f77b4", "#1f77b4"]},
    "/optimal_trajectory": {**_LINE, "gradient": ["#2ca02c", "#2ca02c"]},
    "/ground_truth/obstacles": {"visible": True},
    "/ground_truth/movers": {"visible": True},
    "/ground_truth/contacts": {"visible": True},
}


def layout() -> bytes:
    """Return the layout, for Foxglove's "Import from file"."""
    camera = {"distance": 20, "perspective": False, "phi": 0, "thetaOffset": 0}
    view = {"followMode": "follow-none", "followTf": MAP, "cameraState": camera, "topics": _DRAWN}
    plots = {name: {"paths": [_path(each) for each in paths]} for name, paths in _PLOTS.items()}
    states = {"paths": [_path("/behavior_tree_log.event_log[:].current_status")]}
    panels = {"3D!nav": view, **plots, "StateTransitions!bt": states, "Log!log": {}}
    right = _stacked("Plot!speed", _stacked("Plot!place", _stacked("StateTransitions!bt", "Log!log")))
    whole = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "row", "first": "3D!nav", "second": right, "splitPercentage": 62},
    }
    return f"{json.dumps(whole, indent=1)}\n".encode()


def _path(value: str) -> dict[str, Any]:
    return {"value": value, "enabled": True, "timestampMethod": "receiveTime"}


def _stacked(first: str, second: Any) -> dict[str, Any]:
    return {"direction": "column", "first": first, "second": second, "splitPercentage": 40}
