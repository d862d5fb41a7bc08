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
    view: dict[str, Any] = {
        "followMode": "follow-none",
        "followTf": MAP,
        "cameraState": {
            "distance": 20,
            "perspective": False,
            "phi": 0,
            "thetaOffset": 0,
            "fovy": 45,
            "near": 0.5,
            "far": 5000,
            "target": [0, 0, 0],
            "targetOffset": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
        },
        "scene": {},
        "transforms": {},
        "topics": _DRAWN,
        "layers": {},
    }
    plots = {
        name: {
            "paths": [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths],
            "xAxisVal": "timestamp",
            "showLegend": True,
            "isSynced": True,
        }
        for name, paths in _PLOTS.items()
    }
    states = {
        "paths": [{"value": "/behavior_tree_log.event_log[:].current_status", "timestampMethod": "receiveTime"}],
        "isSynced": True,
    }
    panels = {"3D!nav": view, **plots, "StateTransitions!bt": states, "Log!log": {"searchTerms": [], "minLogLevel": 1}}
    right = _stacked("Plot!speed", _stacked("Plot!place", _stacked("StateTransitions!bt", "Log!log")))
    whole = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "row", "first": "3D!nav", "second": right, "splitPercentage": 62},
    }
    return f"{json.dumps(whole, indent=1)}\n".encode()


def _stacked(first: str, second: Any) -> dict[str, Any]:
    return {"direction": "column", "first": first, "second": second, "splitPercentage": 40}
