"""The stack's parameters as a Nav2 document: what `interpretation` reads, the other way round."""

from collections.abc import Mapping
from typing import Any, Final

from vastflow.sim.model.digest import Value
from vastflow.sim.nav2.controllers.registry import name_of
from vastflow.sim.nav2.parameter_files.controller_server import critics_of
from vastflow.sim.nav2.parameter_files.costmaps import OF_THE_MAP, TOPIC
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, ParameterDocument
from vastflow.sim.nav2.parameter_files.plugins import (
    CONTROLLERS,
    FILTERS,
    GOAL_CHECKERS,
    LAYERS,
    PLANNERS,
    PROGRESS_CHECKERS,
    ROTATION_SHIM,
    WAIT_AT_WAYPOINT,
    Plugins,
)
from vastflow.sim.nav2.parameters.costmap import Costmap
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.mppi import MppiParameters
from vastflow.sim.nav2.parameters.parameter import ParameterGroup, ParameterLocation
from vastflow.sim.nav2.parameters.servers import NO_ANGLE_RAD, NO_LIMIT, NavFn
from vastflow.sim.nav2.parameters.stack import NavParameters

_NOT_SIMPLE: Final = ("required_movement_angle", "trans_stopped_velocity", "rot_stopped_velocity")
"""Parameters that a simple checker does not have."""

Values = dict[ParameterLocation, Value]


def document_of(parameters: NavParameters) -> ParameterDocument:
    """A document that `interpretation` reads as `parameters`, under the names of Nav2 Jazzy's default file."""
    values: Values = _below(("amcl", PARAMETERS), parameters.amcl)
    del values[("amcl", PARAMETERS, "omni")]
    model = "Omni" if parameters.amcl.omni else "Differential"
    values[("amcl", PARAMETERS, "robot_model_type")] = f"nav2_amcl::{model}MotionModel"
    node: ParameterLocation = ("controller_server", PARAMETERS)
    values |= _below(node, parameters.controller_server)
    turns_count = parameters.progress_checker.required_movement_angle < NO_ANGLE_RAD
    progress_checker = "PoseProgressChecker" if turns_count else "SimpleProgressChecker"
    values |= _instance(node, PROGRESS_CHECKERS, progress_checker, parameters.progress_checker)
    goal = parameters.goal_checker
    stops = min(goal.trans_stopped_velocity, goal.rot_stopped_velocity) < NO_LIMIT
    values |= _instance(node, GOAL_CHECKERS, "StoppedGoalChecker" if stops else "SimpleGoalChecker", goal)
    values |= controller_block(node, parameters.controller) | _rotation_shim(node, parameters)
    values |= _costmap("local_costmap", parameters.local_costmap)
    values |= _filters("local_costmap", parameters.local_costmap)
    values |= _filters("global_costmap", parameters.global_costmap)
    values |= {
        path: value
        for path, value in _costmap("global_costmap", parameters.global_costmap).items()
        if path[-1] not in OF_THE_MAP
    }
    values |= _instance(("planner_server", PARAMETERS), PLANNERS, type(parameters.planner).__name__, parameters.planner)
    if not isinstance(parameters.planner, NavFn):
        values |= _below(("planner_server", PARAMETERS, PLANNERS.used, "smoother"), parameters.planner.smoother)
    values |= _below(("behavior_server", PARAMETERS), parameters.behavior_server)
    return ParameterDocument(
        values | _waypoint_follower(parameters) | _velocity_smoother(parameters) | _monitor(parameters)
    )


def controller_block(node: ParameterLocation, controller: ParameterGroup) -> Values:
    """The list `controller_plugins` with one controller, and its parameters."""
    name = CONTROLLERS.used
    values: Values = {
        (*node, CONTROLLERS.lists[0]): [name],
        (*node, name, "plugin"): name_of(type(controller)),
        **_below((*node, name), controller),
    }
    place = (*node, name)
    if isinstance(controller, MppiParameters):
        values |= _below((*place, "AckermannConstraints"), controller.AckermannConstraints)
    if critics := critics_of(controller):
        listed = [group for group, critic in critics.items() if critic.enabled]
        if isinstance(controller, DwbParameters):
            listed.sort(key=lambda group: critics[group].place)
        values[(*place, "critics")] = listed
        for group, critic in critics.items():
            if critic.enabled:
                values |= _below((*place, group), critic)
                if isinstance(controller, DwbParameters):  # the list alone says which there are, and in which order
                    del values[(*place, group, "enabled")], values[(*place, group, "place")]
    return values


def _rotation_shim(node: ParameterLocation, parameters: NavParameters) -> Values:
    if not parameters.rotation_shim.enabled:
        return {}
    place = (*node, CONTROLLERS.used)
    values = _below(place, parameters.rotation_shim)
    del values[(*place, "enabled")]
    primary = name_of(type(parameters.controller))
    return {**values, (*place, "plugin"): ROTATION_SHIM, (*place, "primary_controller"): primary}


def _instance(node: ParameterLocation, plugins: Plugins, kind: str, parameters: Any) -> Values:
    name = plugins.used
    class_name = next(class_name for class_name, called in plugins.modeled.items() if called == kind)
    values = _below((*node, name), parameters)
    if kind.startswith("Simple"):
        values = {path: value for path, value in values.items() if path[-1] not in _NOT_SIMPLE}
    return {(*node, plugins.lists[0]): [name], (*node, name, "plugin"): class_name, **values}


def _costmap(name: str, costmap: Costmap) -> Values:
    node = (name, name, PARAMETERS)
    values = _below(node, costmap)
    obstacle_layer = "voxel_layer" if costmap.obstacle_layer.short_clearing_cells else "obstacle_layer"
    layers: dict[str, tuple[str, Any]] = {
        "static_layer": ("StaticLayer", costmap.static_layer),
        obstacle_layer: ("VoxelLayer" if obstacle_layer == "voxel_layer" else "ObstacleLayer", costmap.obstacle_layer),
        "denoise_layer": ("DenoiseLayer", costmap.denoise_layer),
        "inflation_layer": ("InflationLayer", costmap.inflation_layer),
    }
    listed = {layer: each for layer, each in layers.items() if each[1].enabled}
    values[(*node, LAYERS.lists[0])] = list(listed)
    for layer, (kind, parameters) in listed.items():
        class_name = next(class_name for class_name, called in LAYERS.modeled.items() if called == kind)
        values[(*node, layer, "plugin")] = class_name
        if layer != obstacle_layer:
            values |= _below((*node, layer), parameters)
            continue
        place = (*node, layer)
        values |= {(*place, "observation_sources"): "scan", (*place, "scan", "data_type"): "LaserScan"}
        for key, value in _plain(parameters).items():
            of_the_layer = key in ("enabled", "footprint_clearing_enabled")
            values[(*place, key) if of_the_layer else (*place, "scan", key)] = value
    return values


def _filters(name: str, costmap: Costmap) -> Values:
    """The filters of a costmap, and the nodes that say what they do."""
    node: ParameterLocation = (name, name, PARAMETERS)
    values: Values = {}
    listed: dict[str, Any] = {"keepout_filter": costmap.keepout_filter, "speed_filter": costmap.speed_filter}
    enabled = {each: parameters for each, parameters in listed.items() if parameters.enabled}
    if enabled:
        values[(*node, FILTERS.lists[0])] = list(enabled)
    for each, parameters in enabled.items():
        topic, kind = f"{name}_{each}_info", type(parameters).__name__
        class_name = next(class_name for class_name, called in FILTERS.modeled.items() if called == kind)
        info = (f"{topic}_server", PARAMETERS)
        values |= {(*node, each, "plugin"): class_name, (*node, each, TOPIC): topic, (*info, TOPIC): topic}
        values |= {
            (*info, key): value for key, value in _plain(parameters).items() if key in ("type", "base", "multiplier")
        }
    return values


def _waypoint_follower(parameters: NavParameters) -> Values:
    node = ("waypoint_follower", PARAMETERS)
    executor = (*node, "wait_at_waypoint")
    values = _below(node, parameters.waypoint_follower)
    pause = values.pop((*node, "waypoint_pause_duration"))
    return {
        **values,
        (*node, "waypoint_task_executor_plugin"): executor[-1],
        (*executor, "plugin"): WAIT_AT_WAYPOINT,
        (*executor, "enabled"): True,
        (*executor, "waypoint_pause_duration"): pause,
    }


def _velocity_smoother(parameters: NavParameters) -> Values:
    node = ("velocity_smoother", PARAMETERS)
    values = _below(node, parameters.velocity_smoother)
    closed_loop = values.pop((*node, "closed_loop"))
    return {**values, (*node, "feedback"): "CLOSED_LOOP" if closed_loop else "OPEN_LOOP"}


def _monitor(parameters: NavParameters) -> Values:
    if not parameters.collision_monitor.enabled:  # areas are the file's own
        return {}
    node = ("collision_monitor", PARAMETERS)
    polygon = (*node, "FootprintApproach")
    values = _below(polygon, parameters.collision_monitor)
    values[(*node, "source_timeout")] = values.pop((*polygon, "source_timeout"))
    return {
        (*node, "polygons"): [polygon[-1]],
        (*polygon, "type"): "polygon",
        (*polygon, "action_type"): "approach",
        (*node, "observation_sources"): ["scan"],
        (*node, "scan", "type"): "scan",
        (*node, "scan", "enabled"): True,
        **values,
    }


def _below(prefix: ParameterLocation, parameters: Any) -> Values:
    return {(*prefix, name): value for name, value in _plain(parameters).items()}


def _plain(parameters: Any) -> Mapping[str, Value]:
    """The parameters of a group without the groups in it, and without what is no parameter of Nav2's."""
    values: Mapping[str, Value] = dict(parameters)
    return {
        name: value
        for name, value in values.items()
        if not isinstance(value, ParameterGroup) and name not in ("short_clearing_cells", "zones")
    }
