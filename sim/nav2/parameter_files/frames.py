"""Frames of a parameter file: whether the robot drives without a map, and what Nav2 refuses then."""

import operator
from collections.abc import Mapping
from typing import Final

from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.nav2.parameter_files.declared import declared_defaults
from vastflow.sim.nav2.parameter_files.document import PARAMETERS
from vastflow.sim.nav2.parameter_files.reader import Parts, Reader, shown
from vastflow.sim.nav2.parameters.costmap import Costmap

FRAME: Final = "global_frame"
_ODOM: Final = "odom, as nothing localizes without a map"
_NO_LOCALIZATION: Final = "the global costmap is in odom, where no AMCL moves the robot"


def frame_of(reader: Reader, node: ParameterLocation) -> str:
    """Return the frame of a costmap or of `bt_navigator`."""
    return reader.plain((*node, FRAME), str(declared_defaults()[node[-2]][FRAME].default))


def without_map(reader: Reader, parts: Parts) -> bool:
    """Return whether the robot drives without a map, and report what Nav2 refuses then, in its words.

    That is so where the global costmap has no static layer, and its frame is odometry's. On a map, what is not modeled is refused.
    """
    costmap, document = parts.get("global_costmap"), reader.document
    if reader.faults or not isinstance(costmap, Costmap):
        return False
    nodes = {
        name: document.node(name, name) or (name, name, PARAMETERS) for name in ("global_costmap", "local_costmap")
    }
    if not costmap.in_odom:
        _check_on_map(reader, nodes, parts)
        return False
    amcl = document.node("amcl")
    localizer = amcl or ("amcl", PARAMETERS)
    for path in [path for path in reader.fields if path[: len(localizer)] == localizer]:
        reader.leave(path, _NO_LOCALIZATION)
    if amcl:
        reader.warnings[amcl] = "the global costmap is in odom", "goals stay where they are in odom, as without AMCL"
    if not amcl and not frame_of(reader, nodes["local_costmap"]).endswith("odom"):
        _not_activated(reader, nodes["local_costmap"], _ODOM)
    navigator = document.node("bt_navigator") or ("bt_navigator", PARAMETERS)
    if not amcl and not (frame := frame_of(reader, navigator)).endswith("odom"):
        what = f"the frame is {shown(frame)}: 'Initial robot pose is not available.'"
        reader.fault((*navigator, FRAME), what, f"expected {_ODOM}")
    for place, kind in reader.kinds.items():
        if kind == "StaticLayer" and place not in reader.unmodeled:
            what = "no map comes: 'Costmap timed out waiting for update'"
            reader.fault(place, what, "remove the layer from the list 'plugins'")
        elif kind in ("KeepoutFilter", "SpeedFilter") and place not in reader.unused:
            reader.fault(place, "a mask without a map's frame is not modeled", "remove the filter")
    return True


def _check_on_map(reader: Reader, nodes: Mapping[str, ParameterLocation], parts: Parts) -> None:
    """Report frames and windows that Nav2 refuses on a map, or drives with otherwise."""
    values = reader.document.values
    for name, right, field, rolls in (
        ("global_costmap", "map", "sized_by_map", False),
        ("local_costmap", "odom", "static_layer.enabled", True),
    ):
        frame, rolling = (*nodes[name], FRAME), (*nodes[name], "rolling_window")
        if values.get(rolling, rolls) is not rolls and operator.attrgetter(field)(parts[name]):
            what = f"a {name} that {'stays' if rolls else 'rolls'} and has a static layer is not modeled"
            reader.fault(rolling, what, f"expected {str(rolls).lower()}")
        if (asked := str(values.get(frame, right))).endswith(right):
            continue
        if asked.endswith(("map", "odom")):
            reader.fault(frame, f"a {name} in {shown(asked)} is not modeled on a map", f"expected {right}")
        else:
            _not_activated(reader, nodes[name], right)


def _not_activated(reader: Reader, node: ParameterLocation, right: str) -> None:
    base = reader.document.values.get((*node, "robot_base_frame"), "base_link")
    words = f"transform from {base} to {frame_of(reader, node)} did not become available before timeout"
    reader.fault((*node, FRAME), f"'Failed to activate {node[-2]} because {words}'", f"expected {right}")
