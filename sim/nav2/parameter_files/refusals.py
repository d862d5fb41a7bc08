"""Refusals: what a file has and no node of Nav2 starts with, though it can be read."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, Got, Place, Problem
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.nav2.parameter_files.costmaps import LAUNCH_WORDS, is_info_server
from vastflow.sim.nav2.parameter_files.declared import Declared, declared_defaults
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, SUBSTITUTION, dotted, nearest_of, node_of
from vastflow.sim.nav2.parameter_files.interpretation import Interpretation
from vastflow.sim.nav2.parameter_files.nodes import CONTROLLERS, ROTATION_SHIM, class_name
from vastflow.sim.nav2.parameter_files.plug_ins import CONTROLLER_PLUG_INS
from vastflow.sim.nav2.parameter_files.reader import shown
from vastflow.sim.nav2.parameter_files.trees import NAVIGATOR

_SEEN: Final = ("LaserScan", "PointCloud2")
_CLOCK: Final = "use_sim_time"
"""A flag of every node, which none starts with as a number."""
_KINDS: Final[Mapping[str, str]] = {"approach polygon": "polygon", "zone": "polygon"}
"""Kinds of the reader to those of the declared defaults, where they differ."""
_NESTED: Final = (("smoother",), ("AckermannConstraints",))
"""Groups in plug-ins, of which nothing else has the name."""
_SOURCES: Final[Mapping[str, str]] = {
    **dict.fromkeys(("ObstacleLayer", "VoxelLayer"), "scan"),
    "collision_monitor": "monitored {}",
}
"""Kinds with sources, also those that are not modeled, to what is declared of these, by their type."""
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
        group, declared = _declared(found, path)
        name = ".".join(path[len(group) :])
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


def _declared(found: Interpretation, path: ParameterLocation) -> tuple[ParameterLocation, Mapping[str, Declared]]:
    """Return the group that a parameter is of, and what Nav2's code declares in it."""
    reader, document, table = found.reader, found.document, declared_defaults()
    if PARAMETERS not in path:
        return (), {}
    if path[-2:] == (PARAMETERS, _CLOCK) and SUBSTITUTION not in str(document.values[path]):
        return path[:-1], {_CLOCK: Declared(False, "")}
    for group, kind in (
        (path[:-1], "RotationShim" if _is_shim(found, path[:-1]) else ""),
        (path[:-1], path[-2] if path[-2:-1] in _NESTED else ""),
        (path[:-1], _source_kind(found, path[:-1])),
    ):
        if path[-1] in table.get(kind, {}):
            return group, table[kind]
    group = nearest_of(path[:-1], reader.kinds) or ()
    kind = reader.kinds.get(group, "")
    if not group:
        group = node_of(path)
        is_info = is_info_server(document, group) and group not in document.others
        kind = "filter info" if is_info else NAVIGATOR if group == document.node(NAVIGATOR) else ""
    kind = group[-1] if kind.endswith(" critic") else _KINDS.get(kind, kind)
    of_type = {"radius": Declared(0.0, "")} if kind == "polygon" else {}
    return group, {**table.get(kind, {}), **of_type}


def _is_shim(found: Interpretation, group: ParameterLocation) -> bool:
    plugin = (*group, "plugin")
    return plugin in found.reader.asked and class_name(str(found.reader.asked[plugin])) == ROTATION_SHIM


def _source_kind(found: Interpretation, group: ParameterLocation) -> str:
    names = found.reader.asked.get((*group[:-1], "observation_sources"))
    sources = names.split() if isinstance(names, str) else names if isinstance(names, Sequence) else ()
    kind = _SOURCES.get(found.reader.kinds.get(group[:-1], ""), "") if group[-1] in sources else ""
    return kind.format(found.document.values.get((*group, "type"), "scan"))


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
