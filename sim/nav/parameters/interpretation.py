"""Interpretation: what a Nav2 parameter document sets the stack to."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias, TypeGuard

from vastflow.sim.nav.controllers.registry import (
    FILE,
    OWN,
    UnknownController,
    find_parameters,
    known_controllers,
    short_name,
)
from vastflow.sim.nav.parameters.amcl import MOTION_MODELS, AmclParameters
from vastflow.sim.nav.parameters.costmap import (
    Costmap,
    DenoiseLayer,
    InflationLayer,
    ObstacleLayer,
    StaticLayer,
    global_costmap,
    local_costmap,
)
from vastflow.sim.nav.parameters.document import DocumentError, ParameterDocument, ParameterLocation
from vastflow.sim.nav.parameters.latency import IDEAL, LATENCY_KEY, PRESET_KEY, PRESETS, Latency
from vastflow.sim.nav.parameters.monitor import collision_monitor
from vastflow.sim.nav.parameters.mppi import AckermannParameters, MppiParameters
from vastflow.sim.nav.parameters.parameter import ParameterGroup
from vastflow.sim.nav.parameters.plugins import (
    CONTROLLERS,
    FOREIGN_CRITICS,
    GOAL_CHECKERS,
    LAYERS,
    PLANNERS,
    PROGRESS_CHECKERS,
    ROTATION_SHIM,
    WAIT_AT_WAYPOINT,
    class_name,
    critic_class,
)
from vastflow.sim.nav.parameters.reader import Group, Reader, shown
from vastflow.sim.nav.parameters.robot import ROBOT_KEY, LidarParameters, RobotParameters
from vastflow.sim.nav.parameters.servers import (
    NO_ANGLE_RAD,
    NO_LIMIT,
    BehaviorServer,
    CollisionMonitor,
    ControllerServer,
    GoalChecker,
    NavFn,
    Perturbation,
    ProgressChecker,
    RotationShim,
    VelocitySmoother,
    WaypointFollower,
)
from vastflow.sim.nav.parameters.smac import SmacPlanner2D, SmacPlannerHybrid, SmootherParameters
from vastflow.sim.nav.parameters.stack import NavParameters
from vastflow.sim.nav.polygon import vertices_of
from vastflow.sim.reading.names import did_you_mean

Parts: TypeAlias = Mapping[str, Any]
"""Fields of `NavParameters`."""

NO_SMOOTHER: Final = VelocitySmoother(
    max_velocity=(100.0, 100.0, 100.0),
    min_velocity=(-100.0, -100.0, -100.0),
    max_accel=(1000.0, 1000.0, 1000.0),
    max_decel=(-1000.0, -1000.0, -1000.0),
    velocity_timeout=1e6,
)
"""A smoother that lets every command through: only the actuators' limits are left."""

OF_THE_MAP: Final = ("publish_frequency", "width", "height", "resolution")
"""Parameters of the global costmap that have no effect: it is as large and as fine as the map."""

_NOT_OF_THE_SHIM: Final = ("rotate_to_heading_once", "use_path_orientations")
"""Flags of the Rotation Shim that are not modelled."""

_FIELDS: Final = {"StaticLayer": "static_layer", "DenoiseLayer": "denoise_layer", "InflationLayer": "inflation_layer"}
"""Kinds of layers to fields of `Costmap`; others are obstacle layers."""

OF_THE_SCAN: Final = ("marking", "clearing", "obstacle_max_range", "obstacle_min_range", "raytrace_max_range")
"""Parameters of an obstacle layer that its source has."""


@dataclass(frozen=True)
class Interpretation:
    """A document as the stack reads it.

    Attributes:
        reader: Has what was asked for and why other things were not.
        replaced: Nodes that the document lacks and that are as in Nav2 Jazzy's default file; `controller` where a
            controller server has none.
        left_away: Nodes that the document lacks and without which the stack does.
    """

    document: ParameterDocument
    parameters: NavParameters
    reader: Reader
    replaced: tuple[str, ...]
    left_away: tuple[str, ...]


def interpretation(document: ParameterDocument) -> Interpretation:
    """Read a document into the stack's parameters.

    A parameter that a node leaves out is as in Nav2's code. Without the node `collision_monitor` there is none, as in
    Humble; without `velocity_smoother` only the actuators limit the commands. Other nodes that are left out, as the
    TurtleBot 4's file leaves out `amcl`, are as in Nav2 Jazzy's default file.

    Raises:
        DocumentError: every fault of the document.
    """
    reader = Reader(document)
    parts: dict[str, Any] = {"perturbation": reader.group(Perturbation, ())}
    parts |= {"robot": _robot(reader), "latency": _latency(reader)}
    absent = []
    for name, read in _NODES.items():
        node = document.node(*name)
        if node is not None:
            reader.kinds[node] = name[-1]
            parts |= read(reader, node)
        else:
            absent.append(name[-1])
            parts |= _DISPENSABLE.get(name[-1], {})
    _check_outline(reader, parts)
    _check_period(reader, parts)
    _check_turning_radius(reader, parts)
    _check_lateral_samples(reader, parts)
    if reader.faults:
        raise DocumentError(sorted(reader.faults, key=lambda fault: fault.place), document.file)
    if "controller" not in parts and "controller_server" not in absent:
        absent.append("controller")
    replaced = tuple(name for name in absent if name not in _DISPENSABLE)
    left_away = tuple(name for name in absent if name in _DISPENSABLE)
    return Interpretation(document, NavParameters(**parts), reader, replaced, left_away)


def _check_outline(reader: Reader, parts: Parts) -> None:
    """Nav2's MPPI does not start where it is to look at the outline of a robot that is a disc."""
    controller, costmap = parts.get("controller"), parts.get("local_costmap", local_costmap())
    if reader.faults or not isinstance(controller, MppiParameters) or vertices_of(costmap.footprint):
        return
    if controller.CostCritic.enabled and controller.CostCritic.consider_footprint:
        path = next(path for path in reader.asked if path[-1] == "consider_footprint")
        reader.fault(
            path, "found true, and the local costmap has no polygon `footprint`", "false, as Nav2 does not start"
        )


def _check_period(reader: Reader, parts: Parts) -> None:
    """Nav2's MPPI does not start where the controller's period is longer than a step of its model."""
    controller, server = parts.get("controller"), parts.get("controller_server")
    if reader.faults or not isinstance(controller, MppiParameters) or server is None:
        return
    if 1.0 / server.controller_frequency > controller.model_dt + 1e-6:
        path = next(path for path in reader.asked if path[-1] == "controller_frequency")
        right = (
            f"{1.0 / controller.model_dt:g} or more for a model_dt of {controller.model_dt:g} s, as Nav2 does not start"
        )
        reader.fault(path, f"found {server.controller_frequency:g}", right)


def _check_turning_radius(reader: Reader, parts: Parts) -> None:
    """Without a radius of its own an Ackermann drive has that of MPPI's motion model, or of the planner."""
    robot, controller = parts["robot"], parts.get("controller")
    if reader.faults or robot.drive != "ackermann" or robot.min_turning_radius is not None:
        return
    modelled = isinstance(controller, MppiParameters) and controller.motion_model == "Ackermann"
    if not modelled and not isinstance(parts.get("planner"), SmacPlannerHybrid):
        what = "found ackermann, and neither a motion model Ackermann nor a SmacPlannerHybrid says how tight it turns"
        reader.fault((ROBOT_KEY, "drive"), what, "min_turning_radius beside it")


def _check_lateral_samples(reader: Reader, parts: Parts) -> None:
    """DWB's samples have no speed to the side: an omni robot that is to have some would drive otherwise."""
    place = next((path for path, kind in reader.kinds.items() if kind == "DWB"), None)
    if parts["robot"].drive == "omni" and place is not None:
        for name in ("min_vel_y", "max_vel_y"):
            reader.only((*place, name), 0.0)


def _robot(reader: Reader) -> RobotParameters:
    lidar = reader.group(LidarParameters, (ROBOT_KEY, "lidar"))
    return reader.group(RobotParameters, (ROBOT_KEY,), given={"lidar": LidarParameters() if reader.faults else lidar})


def _latency(reader: Reader) -> Latency:
    place = ROBOT_KEY, LATENCY_KEY
    preset = reader.text((*place, PRESET_KEY), next(iter(PRESETS)))
    if preset not in PRESETS:
        reader.fault((*place, PRESET_KEY), f"found {shown(preset)}", f"one of {', '.join(PRESETS)}")
    return reader.group(Latency, place, left_out=PRESETS.get(preset, IDEAL))


def _amcl(reader: Reader, node: ParameterLocation) -> Parts:
    path = (*node, "robot_model_type")
    model = class_name(reader.text(path, "nav2_amcl::DifferentialMotionModel"))
    if model not in MOTION_MODELS:
        reader.fault(path, f"found {shown(model)}", f"one of {', '.join(MOTION_MODELS)}")
    found = reader.group(AmclParameters, node, given={"omni": MOTION_MODELS.get(model) == "omni"})
    if not found.omni:
        reader.leave((*node, "alpha5"), "the motion model is not Omni")
    return {"amcl": found}


def _local_costmap(reader: Reader, node: ParameterLocation) -> Parts:
    return {"local_costmap": _costmap(reader, node)}


def _global_costmap(reader: Reader, node: ParameterLocation) -> Parts:
    default = global_costmap()
    return {"global_costmap": _costmap(reader, node, **{name: getattr(default, name) for name in OF_THE_MAP})}


def _costmap(reader: Reader, node: ParameterLocation, **given: Any) -> Costmap:
    places: dict[str, ParameterLocation] = {}
    kinds: dict[str, str] = {}
    reader.only((*node, "filters"), [])
    for layer in reader.plugins(node, LAYERS):
        field = _FIELDS.get(layer.kind, "obstacle_layer")
        if field == "denoise_layer" and "inflation_layer" in places:
            path = (*node, layer.name, "plugin")
            reader.fault(
                path, f"{layer.name} comes after the inflation", "a Denoise layer before it in the list 'plugins'"
            )
        if field in places:
            reader.unmodelled[(*node, layer.name)] = f"a second layer beside {places[field][-1]} is not modelled"
        else:
            places[field], kinds[field] = (*node, layer.name), layer.kind
    layers: Mapping[str, type[Any]] = {
        "static_layer": StaticLayer,
        "obstacle_layer": ObstacleLayer,
        "denoise_layer": DenoiseLayer,
        "inflation_layer": InflationLayer,
    }
    for field, model in layers.items():
        if field not in places:
            given[field] = model(enabled=False)
        elif kinds[field] == "SpatioTemporalVoxelLayer":
            given[field] = _spatio_temporal_layer(reader, places[field])
        elif field == "obstacle_layer":
            given[field] = _obstacle_layer(reader, places[field], 2 if kinds[field] == "VoxelLayer" else 0)
        else:
            given[field] = reader.group(model, places[field])
    found = reader.group(Costmap, node, given=given)
    radius = (*node, "robot_radius")
    if radius in reader.document.values and not reader.faults and vertices_of(found.footprint):
        reader.leave(radius, "the polygon footprint counts")
    return found


def _obstacle_layer(reader: Reader, place: ParameterLocation, short_clearing_cells: int) -> ObstacleLayer:
    """The layer with its laser scan; without one it neither marks nor clears."""
    scan = None
    for name in reader.names((*place, "observation_sources"), ()):
        source = (*place, name)
        # PointCloud2 is what Nav2's code takes a source for that does not say what it is.
        if scan is None and reader.document.values.get((*source, "data_type"), "PointCloud2") == "LaserScan":
            scan = source
            reader.text((*source, "data_type"), "LaserScan")
            reader.kinds[source] = "scan"
        else:
            reader.unmodelled[source] = "only one source, a LaserScan, is modelled"
    given: dict[str, Any] = {"short_clearing_cells": short_clearing_cells}
    if scan is None:
        unused = ObstacleLayer(marking=False, clearing=False)
        given |= {name: getattr(unused, name) for name in OF_THE_SCAN}
        return reader.group(ObstacleLayer, place, given=given)
    return reader.group(ObstacleLayer, place, {name: (*scan, name) for name in OF_THE_SCAN}, given)


def _spatio_temporal_layer(reader: Reader, place: ParameterLocation) -> ObstacleLayer:
    """A VoxelLayer of the laser scan in its place, as far as its first source sees that marks."""
    values = reader.document.values
    sources = [(*place, name) for name in reader.names((*place, "observation_sources"), ())]
    source = next((each for each in sources if values.get((*each, "marking"), True) is True), (*place, "scan"))
    reader.unmodelled[place] = "it is read as a VoxelLayer of the laser scan: no voxel decays, and there is no camera"
    seen_m = (*source, "obstacle_range")
    elsewhere = {
        "obstacle_max_range": seen_m,
        "raytrace_max_range": seen_m,
        "footprint_clearing_enabled": (*place, "update_footprint_enabled"),
    }
    given = {"marking": True, "clearing": True, "obstacle_min_range": 0.0, "short_clearing_cells": 2}
    return reader.group(ObstacleLayer, place, elsewhere, given)


def _controller_server(reader: Reader, node: ParameterLocation) -> Parts:
    parts: dict[str, Any] = {"controller_server": reader.group(ControllerServer, node)}
    if progress := reader.plugin(node, PROGRESS_CHECKERS):
        given = {"required_movement_angle": NO_ANGLE_RAD} if progress.kind == "SimpleProgressChecker" else None
        parts["progress_checker"] = reader.group(ProgressChecker, (*node, progress.name), given=given)
    if goal := reader.plugin(node, GOAL_CHECKERS):
        simple = goal.kind == "SimpleGoalChecker"
        given = dict.fromkeys(("trans_stopped_velocity", "rot_stopped_velocity"), NO_LIMIT) if simple else None
        parts["goal_checker"] = reader.group(GoalChecker, (*node, goal.name), given=given)
    # Nav2's code would load DWB here and find no critics for it: such a file is one for other parameters.
    named = [(*node, *CONTROLLERS.lists), (*node, CONTROLLERS.used, "plugin")]
    if any(path in reader.document.values for path in named) and (used := reader.used(node, CONTROLLERS)):
        parts |= _controller(reader, (*node, used[0]), used[1])
    return parts


def _controller(reader: Reader, place: ParameterLocation, listed: ParameterLocation) -> Parts:
    """The controller with the parameters at `place`; one that can't be found is a fault."""
    document, path = reader.document, (*place, "plugin")
    text = reader.text(path, CONTROLLERS.defaults.get(place[-1], ""))
    name = text if FILE in text else class_name(text)
    parts: Parts = {}
    shimmed: tuple[ParameterLocation, ...] = ()
    if name == ROTATION_SHIM:
        parts, shimmed = _rotation_shim(reader, place)
        path = (*place, "primary_controller")
        text = reader.text(path, "")
        name = text if FILE in text else class_name(text)
    known = ", ".join(known_controllers())
    if not name:
        right = f"the class of a controller; known: {known}; {OWN}"
        reader.fault(listed, f"no {path[-1]!r} below {place[-1]!r}", right)
        return {}
    if name in (*CONTROLLERS.foreign, ROTATION_SHIM):
        reader.fault(path, f"{name} is not modelled", f"a controller that is: {known}; {OWN}")
        return {}
    try:
        kind = find_parameters(name, Path(document.file).parent, document.plug_ins.get(name))
    except UnknownController as error:
        reader.fault(path, error.what, error.right)
        return {}
    if not kind.__module__.startswith("vastflow."):
        return {**parts, "controller": _own_parameters(reader, kind, place, {(*place, "plugin"), path, *shimmed})}
    algorithm = short_name(name).upper()
    reader.kinds[place] = algorithm
    given = _critics(reader, place, algorithm, kind())
    if algorithm == "MPPI":
        given = {**given, "AckermannConstraints": _ackermann(reader, place)}
    found = reader.group(kind, place, given=given)
    if isinstance(found, MppiParameters) and found.motion_model != "Omni":
        for name in ("ay_max", "ay_min", "vy_std"):
            reader.leave((*place, name), "the motion model is not Omni")
    return {**parts, "controller": found}


def _ackermann(reader: Reader, place: ParameterLocation) -> AckermannParameters:
    """Nav2 reads these for the motion model Ackermann alone."""
    constraints = (*place, "AckermannConstraints")
    found = reader.group(AckermannParameters, constraints)
    if reader.document.values.get((*place, "motion_model")) != "Ackermann":
        reader.leave((*constraints, "min_turning_r"), "the motion model is not Ackermann")
    return found


def _rotation_shim(reader: Reader, place: ParameterLocation) -> tuple[Parts, tuple[ParameterLocation, ...]]:
    """The Rotation Shim, and where its parameters may be: the controller in it has its own beside them."""
    for name in _NOT_OF_THE_SHIM:
        reader.only((*place, name), False)
    shim = reader.group(RotationShim, place, given={"enabled": True})
    names = (*RotationShim.model_fields, *_NOT_OF_THE_SHIM)
    return {"rotation_shim": shim}, tuple((*place, name) for name in names)


def _own_parameters(
    reader: Reader, kind: type[Group], place: ParameterLocation, others: Collection[ParameterLocation] = ()
) -> Group:
    """The parameters of a plug-in, and of groups in them; one that it does not have is a fault, for nobody else would read it."""
    groups = {name: each for name, field in kind.model_fields.items() if _is_group(each := field.annotation)}
    for path in reader.document.below(place):
        name = path[len(place)]
        if name not in kind.model_fields and path not in others:
            what = f"{kind.__name__} has no parameter {name!r}"
            reader.fault(path, what, did_you_mean(name, kind.model_fields, "none, for it has no parameters"))
    return reader.group(
        kind, place, given={name: _own_parameters(reader, each, (*place, name)) for name, each in groups.items()}
    )


def _is_group(annotation: object) -> TypeGuard[type[ParameterGroup]]:
    return isinstance(annotation, type) and issubclass(annotation, ParameterGroup)


def critics_of(controller: ParameterGroup) -> Mapping[str, Any]:
    """The groups of a controller's critics by name, those that are not enabled too; none of RPP's."""
    groups = ((name, value) for name, value in controller if isinstance(value, ParameterGroup))
    return {name: group for name, group in groups if "enabled" in type(group).model_fields}


def _critics(reader: Reader, place: ParameterLocation, algorithm: str, default: ParameterGroup) -> Parts:
    """The critics that the list `critics` names; all others are not enabled.

    DWB's have their places in the list: those that are not in it keep the ones they have, and the others share theirs.
    """
    critics = critics_of(default)
    if not critics:
        return {}
    loaded: dict[str, ParameterLocation] = {}
    listed = (*place, "critics")
    if algorithm == "DWB" and listed not in reader.document.values:
        reader.fault(place, "no 'critics'", f"a list of them, without which DWB does not start: {', '.join(critics)}")
    for k, name in enumerate(reader.names(listed, ())):
        class_path = (*place, name, "class")
        text = reader.text(class_path, "") if class_path in reader.document.values else name
        kind = critic_class(algorithm, text)
        if kind in critics:
            loaded[kind] = (*place, name)
            continue
        known = f"known: {', '.join(critics)}"
        if kind in FOREIGN_CRITICS[algorithm]:
            reader.fault((*listed, str(k)), f"the critic {text} of {algorithm} is not modelled", known)
        else:
            reader.fault((*listed, str(k)), f"{algorithm} has no critic {text!r}", known)
    parts = {}
    shared = sorted(critics[kind].place for kind in loaded) if algorithm == "DWB" else ()
    places = dict(zip(loaded, shared, strict=False))
    for kind, critic in critics.items():
        if kind not in loaded:
            parts[kind] = critic.with_values(enabled=False)
            reader.unused[(*place, kind)] = "not in the list of critics"
            continue
        reader.kinds[loaded[kind]] = f"{algorithm} critic"
        enabled = algorithm != "MPPI" or reader.flag((*loaded[kind], "enabled"), True)
        given = {"enabled": enabled} | ({"place": places[kind]} if kind in places else {})
        parts[kind] = reader.group(type(critic), loaded[kind], given=given)
    return parts


def _planner_server(reader: Reader, node: ParameterLocation) -> Parts:
    planner = reader.plugin(node, PLANNERS)
    if not planner:
        return {}
    place = (*node, planner.name)
    if planner.kind == "NavFn":
        return {"planner": reader.group(NavFn, place)}
    reader.only((*place, "downsample_costmap"), False)
    model = SmacPlanner2D if planner.kind == "SmacPlanner2D" else SmacPlannerHybrid
    return {
        "planner": reader.group(
            model, place, given={"smoother": reader.group(SmootherParameters, (*place, "smoother"))}
        )
    }


def _behavior_server(reader: Reader, node: ParameterLocation) -> Parts:
    return {"behavior_server": reader.group(BehaviorServer, node)}


def _waypoint_follower(reader: Reader, node: ParameterLocation) -> Parts:
    executor = (*node, reader.text((*node, "waypoint_task_executor_plugin"), "wait_at_waypoint"))
    pause = (*executor, "waypoint_pause_duration")
    if class_name(str(reader.document.values.get((*executor, "plugin"), WAIT_AT_WAYPOINT))) != WAIT_AT_WAYPOINT:
        reader.unmodelled[executor] = f"of the tasks at waypoints only {WAIT_AT_WAYPOINT} is modelled"
        return {"waypoint_follower": reader.group(WaypointFollower, node, given={pause[-1]: 0})}
    reader.text((*executor, "plugin"), WAIT_AT_WAYPOINT)
    waits = reader.flag((*executor, "enabled"), True)
    found = reader.group(WaypointFollower, node, {pause[-1]: pause})
    return {"waypoint_follower": found if waits else found.with_values(waypoint_pause_duration=0)}


def _velocity_smoother(reader: Reader, node: ParameterLocation) -> Parts:
    path = (*node, "feedback")
    feedback = reader.text(path, "OPEN_LOOP")
    if feedback not in ("OPEN_LOOP", "CLOSED_LOOP"):
        reader.fault(path, f"found {shown(feedback)}", "OPEN_LOOP or CLOSED_LOOP")
    given = {"closed_loop": feedback == "CLOSED_LOOP"}
    return {"velocity_smoother": reader.group(VelocitySmoother, node, given=given)}


_NODES: Final[Mapping[tuple[str, ...], Callable[[Reader, ParameterLocation], Parts]]] = {
    ("amcl",): _amcl,
    ("controller_server",): _controller_server,
    ("local_costmap", "local_costmap"): _local_costmap,
    ("global_costmap", "global_costmap"): _global_costmap,
    ("planner_server",): _planner_server,
    ("behavior_server",): _behavior_server,
    ("waypoint_follower",): _waypoint_follower,
    ("velocity_smoother",): _velocity_smoother,
    ("collision_monitor",): collision_monitor,
}

MODELLED_NODES: Final = frozenset(name[-1] for name in _NODES)

_DISPENSABLE: Final[Mapping[str, Parts]] = {
    "velocity_smoother": {"velocity_smoother": NO_SMOOTHER},
    "collision_monitor": {"collision_monitor": CollisionMonitor(enabled=False)},
}
