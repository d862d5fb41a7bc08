"""Interpretation: the stack's parameters from a Nav2 parameter document, and the reverse."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, FileError, Got, Place
from vastflow.sim.model.parameter import ParameterGroup, ParameterLocation
from vastflow.sim.model.polygon import vertices_of
from vastflow.sim.nav2.parameter_files.collision_monitor import read_monitor, written_monitor
from vastflow.sim.nav2.parameter_files.command_chain import NO_SMOOTHER, smoother_between, unheard_listeners
from vastflow.sim.nav2.parameter_files.content import content_of
from vastflow.sim.nav2.parameter_files.controller_server import read_controller_server, written_controller_server
from vastflow.sim.nav2.parameter_files.costmaps import (
    check_speed_filter,
    read_costmap,
    unheard_speed_filters,
    written_costmap,
)
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, ParameterDocument
from vastflow.sim.nav2.parameter_files.frames import without_map
from vastflow.sim.nav2.parameter_files.nodes import NODES, PLANNERS, WAIT_AT_WAYPOINT, class_name, short_class
from vastflow.sim.nav2.parameter_files.plug_ins import PLANNER_PLUG_INS
from vastflow.sim.nav2.parameter_files.reader import Instance, Parts, Reader, shown, written
from vastflow.sim.nav2.parameter_files.releases import RELEASE
from vastflow.sim.nav2.parameter_files.robots import NAMESPACE, namespace_text, of_robot
from vastflow.sim.nav2.parameters.costmap import local_costmap
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.mppi import MppiParameters
from vastflow.sim.nav2.parameters.servers import (
    CollisionMonitor,
    Perturbation,
    PlannerServer,
    SmacPlannerHybrid,
    VelocitySmoother,
    WaypointFollower,
)
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import FILE
from vastflow.sim.system.keys import RELEASES
from vastflow.sim.system.robot import (
    IDEAL,
    LATENCY_KEY,
    NOISE_PLACE,
    ODOMETRY_KEY,
    PRESET_KEY,
    PRESETS,
    ROBOT_KEY,
    Latency,
    OdometryDrift,
    RobotParameters,
)
from vastflow.sim.world.noise_registry import GAUSSIAN_DROPOUT, NOISE_PLUG_INS, GaussianDropoutParameters

_NODES_BEFORE_FOXY: Final[Mapping[str, str]] = {
    "dwb_controller": "controller_server",
    "navfn_planner": "planner_server",
}
"""Nodes of Dashing to those that have their plug-ins since."""

_LISTS_BEFORE_FOXY: Final[Mapping[str, str]] = {
    "plugin_names": "plugins",
    "controller_plugin_ids": "controller_plugins",
    "planner_plugin_ids": "planner_plugins",
}
"""Lists of names, with the classes in a list beside them, to the lists that name groups with a `plugin` each."""


def _refuse_releases_before_foxy(reader: Reader) -> None:
    """Without today's nodes and lists, the stack would be Nav2's default one in place of what such a file says."""
    document = reader.document
    for old, new in _NODES_BEFORE_FOXY.items():
        if (node := document.node(old)) and document.node(new) is None:
            right = f"write {new} with a list of plug-ins, as since Foxy"
            reader.fault(node[:-1], "this node is of Nav2 Dashing", right)
    for path in document.values:
        new = _LISTS_BEFORE_FOXY.get(path[-1], "")
        if new and (*path[:-1], new) not in document.values:
            right = f"write '{new}', and 'plugin: package::Class' below each name, as since Foxy"
            reader.fault(path, "this list is of Nav2 Eloquent, which has the classes in another list", right)


@dataclass(frozen=True)
class Interpretation:
    """A document as the stack reads it.

    Attributes:
        reader: Has what was asked for and why other things were not.
        replaced: `controller` where the document names none: it is as in Nav2 Jazzy's default file.
        absent: Nodes that the document lacks and that are as in Nav2's code.
        left_away: Nodes that the document lacks and without which the stack does.
    """

    document: ParameterDocument
    parameters: NavParameters
    reader: Reader
    replaced: tuple[str, ...]
    absent: tuple[str, ...]
    left_away: tuple[str, ...]


def interpretation(
    document: ParameterDocument, *, drawn: bool = False, varied: Collection[ParameterLocation] = ()
) -> Interpretation:
    """Read a document into the stack's parameters.

    A parameter or a node that is left out is as in Nav2's code. Without the node `collision_monitor` there is none, as in
    Humble; nor is there a `velocity_smoother` without one in files of Galactic and before, where only the actuators limit
    the commands. A document that names no controller has that of Nav2 Jazzy's default file, as Nav2 would not start.

    Args:
        drawn, varied: See `Reader`.

    Raises:
        FileError: every fault of the document.
    """
    document = of_robot(document, document.values.get(NAMESPACE))
    reader = Reader(content_of(document), drawn=drawn, varied=varied)
    if NAMESPACE in document.values:
        reader.plain(NAMESPACE, "")
    if reader.plain(RELEASE, RELEASES[0]) not in RELEASES:
        reader.fault(RELEASE, Got(shown(document.values[RELEASE])), f"one of {', '.join(RELEASES)}")
    reader.unused |= dict.fromkeys(document.others, "it is another robot's")
    if document.others:
        names = ", ".join(dict.fromkeys(map(namespace_text, document.others.values())))
        reader.warnings[next(iter(document.others))[:-1]] = (
            f"the file has parameters of other robots, {names}",
            f"the robot is {namespace_text(document.robot)}, unless a family says 'robot: {{namespace: ...}}'",
        )
    parts: dict[str, Any] = {
        "perturbation": reader.group(Perturbation, ()),
        "robot": reader.group(RobotParameters, (ROBOT_KEY,)),
        "latency": _latency(reader),
        "odometry": reader.group(OdometryDrift, (ROBOT_KEY, ODOMETRY_KEY)),
        "lidar_noise": _lidar_noise(reader),
    }
    absent: list[str] = []
    left_away: list[str] = []
    _refuse_releases_before_foxy(reader)
    for (*above, name), modeled in NODES.items():
        node = document.node(*above, name) or document.node(*above, modeled.older or name)
        if node is None and (name == "collision_monitor" or (name in _WITHOUT and document.node("recoveries_server"))):
            left_away.append(name)
            parts[name] = _WITHOUT[name]
            continue
        if node is None:
            absent.append(name)
            node = (*above, name, PARAMETERS)
        reader.kinds[node] = name
        parts |= _READ[name](reader, node) if name in _READ else {name: reader.group(modeled.model, node, kinds=[name])}
    if len(absent) + len(left_away) == len(NODES) and not reader.faults:
        place = Place(document.file, *min(document.places.values(), default=(1, 1)))
        right = f"these are, beside others: {', '.join(map('/'.join, NODES))}"
        reader.faults.append(Fault(place, "none of the file's nodes is modeled", right))
    parts |= _distances_of_the_inflation(reader, parts)
    _check_mppi(reader, parts)
    _check_turning_radius(reader, parts)
    parts |= {**unheard_speed_filters(reader, parts), **smoother_between(reader)}
    parts |= unheard_listeners(reader, parts)
    if without_map(reader, parts) and "amcl" in absent:
        absent.remove("amcl")
        left_away.append("amcl")
    check_speed_filter(reader, parts)
    if reader.faults:
        raise FileError(reader.faults)
    replaced = () if "controller" in parts else ("controller",)
    return Interpretation(document, NavParameters(**parts), reader, replaced, tuple(absent), tuple(left_away))


def is_omni(controller: object) -> bool:
    """Whether a controller samples motion to the side."""
    if isinstance(controller, DwbParameters):
        return controller.min_vel_y != 0.0 or controller.max_vel_y != 0.0
    return isinstance(controller, MppiParameters) and controller.motion_model == "Omni"


def _distances_of_the_inflation(reader: Reader, parts: Parts) -> Parts:
    """ObstaclesCritic takes distances by the local costmap's inflation; its own parameters for that are Humble's."""
    controller = parts.get("controller")
    if not isinstance(controller, MppiParameters) or not controller.ObstaclesCritic.enabled:
        return {}
    layer = parts.get("local_costmap", local_costmap()).inflation_layer
    written = {path[-1] for path in reader.document.values if path[-2:-1] == ("ObstaclesCritic",)}
    of_the_layer = {name: getattr(layer, name) for name in ("inflation_radius", "cost_scaling_factor")}
    found = {name: value for name, value in of_the_layer.items() if name not in written}
    critic = controller.ObstaclesCritic.model_copy(update=found if layer.enabled else dict.fromkeys(found, 0.0))
    return {"controller": controller.model_copy(update={"ObstaclesCritic": critic})}


def _check_mppi(reader: Reader, parts: Parts) -> None:
    """Check the conditions without which Nav2's MPPI does not start.

    The outline of a disc can't be considered, and a period may not exceed a step of the model.
    """
    controller, costmap = parts.get("controller"), parts.get("local_costmap", local_costmap())
    if reader.faults or not isinstance(controller, MppiParameters):
        return
    critic, rate_hz = controller.CostCritic, parts["controller_server"].controller_frequency
    if critic.enabled and critic.consider_footprint and not vertices_of(costmap.footprint):
        path = next(path for path in reader.asked if path[-1] == "consider_footprint")
        what = Got("true, and the local costmap has no polygon `footprint`")
        reader.fault(path, what, "false, as Nav2 does not start")
    place = next(path for path in reader.asked if path[-1] == "model_dt")
    step_s: Any = reader.document.values.get(place, controller.model_dt)
    if 1.0 / rate_hz > step_s + 1e-6:
        path = next(path for path in reader.asked if path[-1] == "controller_frequency")
        least_hz = f"{1.0 / step_s:g} or more for a model_dt of {step_s:g} s"
        reader.fault(path, Got(f"{rate_hz:g}"), f"{least_hz}, as Nav2 does not start")


def _check_turning_radius(reader: Reader, parts: Parts) -> None:
    """Fill in an Ackermann drive's missing turning radius from MPPI's motion model or the planner."""
    robot, controller = parts["robot"], parts.get("controller")
    if reader.faults or robot.drive != "ackermann" or robot.min_turning_radius is not None:
        return
    modeled = isinstance(controller, MppiParameters) and controller.motion_model == "Ackermann"
    if not modeled and not isinstance(parts.get("planner"), SmacPlannerHybrid):
        what = "neither a motion model Ackermann nor a SmacPlannerHybrid says how tight an ackermann drive turns"
        reader.fault((ROBOT_KEY, "drive"), what, "add min_turning_radius")


def noise_of(chosen: Value) -> type[ParameterGroup]:
    """Return the parameters of the model that a value names; raises as `Registry.of`."""
    if isinstance(chosen, str) and FILE not in chosen:
        return NOISE_PLUG_INS.parameters(chosen)
    return NOISE_PLUG_INS.of(chosen)


def _lidar_noise(reader: Reader) -> ParameterGroup:
    place = (*NOISE_PLACE, "model")
    chosen = reader.document.values.get(place, GAUSSIAN_DROPOUT)
    try:
        own = reader.drawn and isinstance(chosen, Sequence) and not isinstance(chosen, str)
        kind = ParameterGroup if own else noise_of(chosen)
    except PlugInError as error:
        reader.fault(place, error.problem, error.expected)
        return GaussianDropoutParameters()
    reader.asked[place] = chosen
    return reader.own_group(kind, NOISE_PLACE, {place})


def _latency(reader: Reader) -> Latency:
    place = ROBOT_KEY, LATENCY_KEY
    preset = reader.plain((*place, PRESET_KEY), next(iter(PRESETS)))
    if preset not in PRESETS:
        reader.fault((*place, PRESET_KEY), Got(shown(preset)), f"one of {', '.join(PRESETS)}")
    return reader.group(Latency, place, left_out=PRESETS.get(preset, IDEAL))


def _planner_server(reader: Reader, node: ParameterLocation) -> Parts:
    server, used = reader.group(PlannerServer, node, kinds=["planner_server"]), reader.used(node, PLANNERS)
    if used is None:
        return {"planner_server": server}
    refusal = 0 if used.is_found else _INVALID_PLANNER
    parts: Parts = {"planner_server": server.model_copy(update={"refusal": refusal})}
    path = (*used.place, "plugin")
    kind = reader.plug_in(PLANNER_PLUG_INS, PLANNERS.foreign, path, used.default_class, used.listed)
    if kind is None:
        return parts
    text = str(reader.asked[path])
    modeled = PLANNERS.modeled.get(class_name(text))
    if modeled is None:
        return {**parts, "planner": reader.own_group(kind, used.place, {path})}
    reader.kinds[used.place] = short_class(text)
    return {**parts, "planner": reader.instance_group(Instance(used.place, short_class(text), modeled))}


_INVALID_PLANNER: Final = 201
"""ComputePathToPose's error code where the node has no planner of a name (nav2_planner 1.3.12, planner_server.cpp:638)."""


def _velocity_smoother(reader: Reader, node: ParameterLocation) -> Parts:
    """Read the smoother; since Lyrical its lists may have six numbers, of which x, y, and yaw count."""
    given: dict[str, Any] = {}
    for name in ("max_velocity", "min_velocity", "max_accel", "max_decel"):
        found = reader.document.values.get(path := (*node, name))
        if isinstance(found, Sequence) and len(found) == 6:
            reader.asked[path] = given[name] = tuple(found[k] for k in (0, 1, 5))
    return {"velocity_smoother": reader.group(VelocitySmoother, node, given=given, kinds=["velocity_smoother"])}


def _waypoint_follower(reader: Reader, node: ParameterLocation) -> Parts:
    kinds = ["waypoint_follower", "WaitAtWaypoint"]
    executor = (*node, reader.plain((*node, "waypoint_task_executor_plugin"), "wait_at_waypoint"))
    pause, plugin = (*executor, "waypoint_pause_duration"), (*executor, "plugin")
    if class_name(str(reader.document.values.get(plugin, WAIT_AT_WAYPOINT))) != WAIT_AT_WAYPOINT:
        reader.unmodeled[executor] = f"of the tasks at waypoints only {WAIT_AT_WAYPOINT} is modeled"
        return {"waypoint_follower": reader.group(WaypointFollower, node, given={pause[-1]: 0}, kinds=kinds)}
    reader.plain(plugin, WAIT_AT_WAYPOINT)
    waits = reader.plain((*executor, "enabled"), True)
    found = reader.group(WaypointFollower, node, {pause[-1]: pause}, kinds=kinds)
    return {"waypoint_follower": found if waits else found.with_values(waypoint_pause_duration=0)}


_READ: Final[Mapping[str, Callable[[Reader, ParameterLocation], Parts]]] = {
    "controller_server": read_controller_server,
    "local_costmap": read_costmap,
    "global_costmap": read_costmap,
    "planner_server": _planner_server,
    "waypoint_follower": _waypoint_follower,
    "velocity_smoother": _velocity_smoother,
    "collision_monitor": read_monitor,
}
"""Nodes with more than a group of parameters."""

_WITHOUT: Final[Mapping[str, Any]] = {
    "velocity_smoother": NO_SMOOTHER,
    "collision_monitor": CollisionMonitor(enabled=False),
}
"""Nodes without which the stack does, to the parameters that it then has."""


def document_of(parameters: NavParameters) -> ParameterDocument:
    """A document that `interpretation` reads as `parameters`, under the names of Nav2 Jazzy's default file."""
    nodes = {name[-1]: (*name, PARAMETERS) for name in NODES}
    follower, wait = nodes["waypoint_follower"], (*nodes["waypoint_follower"], "wait_at_waypoint")
    values = written_controller_server(nodes["controller_server"], parameters)
    for name in ("local_costmap", "global_costmap"):
        values |= written_costmap(name, getattr(parameters, name))
    for name in ("amcl", "planner_server", "behavior_server", "velocity_smoother"):
        values |= written(getattr(parameters, name), nodes[name])
    server, planner = nodes["planner_server"], (*nodes["planner_server"], PLANNERS.used)
    values |= {(*server, PLANNERS.lists[0]): [planner[-1]], **written(parameters.planner, planner)}
    values[(*planner, "plugin")] = PLANNER_PLUG_INS.name_of(type(parameters.planner))
    values |= {(*follower, "waypoint_task_executor_plugin"): wait[-1], (*wait, "plugin"): WAIT_AT_WAYPOINT}
    pause = {"waypoint_pause_duration": (*wait, "waypoint_pause_duration")}
    values |= {(*wait, "enabled"): True, **written(parameters.waypoint_follower, follower, pause)}
    return ParameterDocument(values | written_monitor(parameters.collision_monitor))
