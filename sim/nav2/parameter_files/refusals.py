"""Refusals: what a file has and no node of Nav2 starts with, though it can be read."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, Got, Place, Problem
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.nav2.parameter_files.costmaps import LAUNCH_WORDS
from vastflow.sim.nav2.parameter_files.declared import declared_defaults
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, SUBSTITUTION, dotted, nearest_of, node_of
from vastflow.sim.nav2.parameter_files.interpretation import Interpretation
from vastflow.sim.nav2.parameter_files.nodes import CONTROLLERS, ROTATION_SHIM, class_name
from vastflow.sim.nav2.parameter_files.plug_ins import CONTROLLER_PLUG_INS
from vastflow.sim.nav2.parameter_files.reader import shown

_SEEN: Final = ("LaserScan", "PointCloud2")
_OF_SOURCES: Final[Mapping[tuple[str, str], Sequence[Value]]] = {
    ("ObstacleLayer", "data_type"): _SEEN,
    ("VoxelLayer", "data_type"): _SEEN,
    ("collision_monitor", "type"): ("scan", "pointcloud", "range", "polygon", "costmap"),
}
"""Kinds with sources, and the parameter of a source that has one of these values."""


def refusals(found: Interpretation) -> Iterator[Fault]:
    """Yield what a file has and no node of Nav2 starts with, though it can be read."""
    reader, document = found.reader, found.document

    def fault(path: ParameterLocation, problem: Problem, expected: str) -> Fault:
        return Fault(Place(document.file, *document.place(path), dotted(path)), problem, expected)

    for path, value in document.values.items():
        group = nearest_of(path[:-1], reader.kinds)
        kind = reader.kinds.get(group or (), "")
        declared = declared_defaults().get(group[-1] if group and kind.endswith(" critic") else kind, {})
        name = ".".join(path[len(group or ()) :])
        is_known = name in declared and value not in (*LAUNCH_WORDS,)
        if right := _unread(value, "".join(node_of(path)[-2:-1]) if PARAMETERS in path else ""):
            yield fault(path, Got(shown(value)), right)
        elif is_known and (right := _right_type(value, declared[name].default)):
            yield fault(path, Got(shown(value)), f"{right}, as the node ends otherwise")
        kinds = _OF_SOURCES.get((reader.kinds.get(path[:-2], ""), path[-1]), (value,))
        if value not in kinds and path[-2] in reader.names((*path[:-2], "observation_sources")):
            yield fault(path, Got(shown(value)), f"one of {', '.join(map(str, kinds))}, as the node ends otherwise")
    node = document.node("controller_server")
    if node and "controller" in found.replaced:
        for path in document.below(node):
            plugin = path[:-1]
            is_one = class_name(str(document.values[path])) in (
                *CONTROLLER_PLUG_INS.known,
                *CONTROLLERS.foreign,
                ROTATION_SHIM,
            )
            if path[-1] == "plugin" and is_one:
                right = f"add 'controller_plugins: [{plugin[-1]}]', as Nav2 does not start without critics for its default, DWB"
                yield fault(plugin, "no controller_plugins names it", right)


def _unread(value: Value, node: str) -> str:
    """Return what a list must be that ROS 2 refuses or gives no type; empty for any other value."""
    if not isinstance(value, Sequence) or isinstance(value, str) or SUBSTITUTION in str(value):
        return ""
    if len({str if item is None else type(item) for item in value}) > 1:
        return "a list of one type, as no node reads the file otherwise"
    return "" if value or node not in declared_defaults() else "items, or no such line, as the node ends otherwise"


def _right_type(value: Value, default: Value) -> str:
    """Return what a value of another type than a parameter's must be; empty for one of its type."""
    if isinstance(default, list):
        items = value if isinstance(value, Sequence) and not isinstance(value, str) else [None]
        right = _right_type(items[0], default[0]) if items and default else ""
        mixed = next((wrong for item in items if default and (wrong := _right_type(item, default[0]))), right)
        return f"a list, each item {mixed}" if mixed else ""
    if type(default) is type(value) or default is None or (value is None and isinstance(default, str)):
        return ""  # nothing is the text `null`
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        return f"a double, such as {float(value)}" if abs(value) < 2**63 else "a double"
    names = {bool: "true or false", int: "an integer", float: "a double", str: "text"}
    return names.get(type(default), "")
