"""Reading the node `controller_server`: its checkers, and the controller with its critics, in a Rotation Shim or not."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from vastflow.sim.model.digest import Value
from vastflow.sim.model.elementary import exp, log
from vastflow.sim.model.parameter import ParameterGroup, ParameterLocation, complaint
from vastflow.sim.nav2.parameter_files.nodes import (
    CONTROLLERS,
    FOREIGN_CRITICS,
    GOAL_CHECKERS,
    PATH_HANDLERS,
    PROGRESS_CHECKERS,
    ROTATION_SHIM,
    class_name,
    short_class,
)
from vastflow.sim.nav2.parameter_files.plug_ins import CONTROLLER_PLUG_INS, short_name
from vastflow.sim.nav2.parameter_files.reader import Parts, Reader, Used, Values, plug_in_name, written, written_plugins
from vastflow.sim.nav2.parameter_files.releases import release_of
from vastflow.sim.nav2.parameter_files.trees import users_tree
from vastflow.sim.nav2.parameters.mppi import AckermannParameters, MppiParameters
from vastflow.sim.nav2.parameters.servers import (
    NO_LIMIT,
    ControllerServer,
    ProgressChecker,
    RotationShim,
)
from vastflow.sim.nav2.parameters.stack import NavParameters

_CHECKERS: Final = {"progress_checker": PROGRESS_CHECKERS, "goal_checker": GOAL_CHECKERS}

_OF_THE_PATH: Final = (
    *("prune_distance", "enforce_path_inversion", "inversion_xy_tolerance", "inversion_yaw_tolerance"),
)
"""Parameters of MPPI that since Lyrical the path handler has."""

_HANDLED_M: Final = 2.0
"""A path handler's `prune_distance` in Nav2's code."""

_MOTION_MODELS: Final = {f"mppi::{name}MotionModel": name for name in ("DiffDrive", "Ackermann", "Omni")}
"""Plug-ins of MPPI's to what its parameter calls them before Lyrical."""


def read_controller_server(reader: Reader, node: ParameterLocation) -> Parts:
    server, refusal = reader.group(ControllerServer, node, kinds=["controller_server"]), 0
    parts: dict[str, Any] = {}
    for name, plugins in _CHECKERS.items():
        path, names = reader.listed(node, plugins)
        is_named = plugins.used in names and release_of(reader.document) == "lyrical"  # by its trees
        if len(set(names)) > 1 and not is_named and not users_tree(reader.document):
            refusal = _UNKNOWN
            why = f"Nav2 refuses each path: of several {plugins.what}s the behavior tree must name one, and the default names none"
            reader.warnings[path] = f"there are {len(set(names))} {plugins.what}s", f"{why}, so that missions abort"
            reader.unused |= {(*node, each): why for each in names}
        elif name == "progress_checker" and not names:
            parts[name] = ProgressChecker(movement_time_allowance=NO_LIMIT)
        elif found := reader.plugin(node, plugins):
            parts[name] = reader.instance_group(found)
    # Nav2's code would load DWB here and find no critics for it: such a file is one for other parameters.
    named = [(*node, *CONTROLLERS.lists), (*node, CONTROLLERS.used, "plugin")]
    if any(path in reader.document.values for path in named) and (used := reader.used(node, CONTROLLERS)):
        parts |= _controller(reader, used)
        refusal = refusal if used.is_found else _INVALID_CONTROLLER
    return {**parts, "controller_server": server.model_copy(update={"refusal": refusal})}


_UNKNOWN, _INVALID_CONTROLLER = 100, 101
"""FollowPath's error codes where the node has no checker and no controller of a name (nav2_controller 1.3.12, controller_server.cpp:478, :486)."""


def _controller(reader: Reader, used: Used) -> Parts:
    place, path, default = used.place, (*used.place, "plugin"), used.default_class
    parts: Parts = {}
    shimmed: tuple[ParameterLocation, ...] = ()
    if plug_in_name(reader.plain(path, default)) == ROTATION_SHIM:
        parts = {"rotation_shim": reader.group(RotationShim, place, given={"enabled": True}, kinds=["RotationShim"])}
        shimmed = tuple((*place, name) for name in RotationShim.model_fields)
        path, default = primary_controller(reader.document.values, place), ""
        place = path[:-1] if path[-1] == "plugin" else place
    foreign = (*CONTROLLERS.foreign, ROTATION_SHIM)
    kind = reader.plug_in(CONTROLLER_PLUG_INS, foreign, path, default, used.listed)
    if kind is None:
        return {}
    if kind is ParameterGroup or not kind.__module__.startswith("vastflow."):
        return {**parts, "controller": reader.own_group(kind, place, {(*place, "plugin"), path, *shimmed})}
    algorithm = short_name(plug_in_name(str(reader.asked[path]))).upper()
    reader.kinds[place] = algorithm
    given = _critics(reader, place, algorithm, kind())
    if algorithm == "MPPI":
        if given["ObstaclesCritic"].enabled:  # it stands for CostCritic, and looks at the robot's center alone
            reader.only((*place, "ObstaclesCritic", "consider_footprint"), False)
            if given["CostCritic"].enabled:
                problem = "CostCritic and ObstaclesCritic together are not modeled"
                reader.fault((*place, "critics"), problem, "keep one of them")
        given |= _motion_model(reader, place)
    elsewhere = {**_handled(reader, used.place[:-1], algorithm, given)}
    old, new = (*place, "desired_linear_vel"), (*place, "max_linear_vel")  # since Lyrical
    if algorithm == "RPP" and new in reader.document.values and old not in reader.document.values:
        elsewhere[old[-1]] = new
    return {**parts, "controller": reader.group(kind, place, elsewhere, given, kinds=[algorithm])}


def _handled(
    reader: Reader, node: ParameterLocation, algorithm: str, given: dict[str, Any]
) -> Mapping[str, ParameterLocation]:
    """Return the places of controller parameters in the node's path handler.

    DWB and RPP cut the path as those of Jazzy do.
    """
    named = [(*node, *PATH_HANDLERS.lists), *((*node, name, "plugin") for name in PATH_HANDLERS.defaults)]
    found = reader.plugin(node, PATH_HANDLERS) if any(path in reader.document.values for path in named) else None
    if found is None:
        return {}
    reader.instance_group(found)
    if algorithm != "MPPI":
        reader.only((*found.place, "enforce_path_inversion"), False)
        return {}
    elsewhere = {name: (*found.place, name) for name in _OF_THE_PATH}
    if elsewhere["prune_distance"] not in reader.document.values:
        del elsewhere["prune_distance"]
        given["prune_distance"] = _HANDLED_M
    return elsewhere


def _motion_model(reader: Reader, place: ParameterLocation) -> Parts:
    """Read the parameters of MPPI's motion model that need more than their own names.

    Since Lyrical the model is the name of a group with a `plugin` and the model's parameters.
    """
    values, given = reader.document.values, dict[str, Any]()
    model = values.get((*place, "motion_model"))
    constraints, plugin = (*place, "AckermannConstraints"), (*place, str(model), "plugin")
    if plugin in values:
        constraints, found = plugin[:-1], class_name(reader.plain(plugin, ""))
        given["motion_model"] = model = _MOTION_MODELS.get(found, "DiffDrive")
        if found not in _MOTION_MODELS:
            reader.fault(plugin, f"unknown motion model {found!r}", f"expected one of {', '.join(_MOTION_MODELS)}")
        reader.asked[(*place, "motion_model")] = found
    given["AckermannConstraints"] = reader.group(AckermannParameters, constraints, kinds=["AckermannConstraints"])
    if model != "Ackermann":
        reader.leave((*constraints, "min_turning_r"), "the motion model is not Ackermann")
    if model != "Omni":
        # Nav2 does not read these, so that they may be out of range, as a standard deviation of 0.
        for name in ("ay_max", "ay_min", "vy_std"):
            path = (*place, name)
            if path in values and complaint(MppiParameters, name, values[path]):
                given[name] = MppiParameters.model_fields[name].default
                reader.leave(path, "the motion model is not Omni")
    return given


def primary_controller(values: Mapping[ParameterLocation, Value], shim: ParameterLocation) -> ParameterLocation:
    """Path of the class of a Rotation Shim's controller.

    Since Kilted it is below a group that has the controller's parameters, too.
    """
    path = (*shim, "primary_controller")
    return path if (*path, "plugin") not in values else (*path, "plugin")


def critics_of(controller: ParameterGroup) -> Mapping[str, Any]:
    """The groups of a controller's critics by name, disabled ones included; empty for RPP."""
    return {name: value for name, value in controller if "enabled" in getattr(type(value), "model_fields", ())}


def _critics(reader: Reader, place: ParameterLocation, algorithm: str, default: ParameterGroup) -> dict[str, Any]:
    """The critics that the list `critics` names; all others are not enabled.

    DWB's have their places in the list: those that are not in it keep the ones they have, and the others share theirs.
    """
    critics = critics_of(default)
    if not critics:
        return {}
    loaded: dict[str, list[ParameterLocation]] = {}
    listed, known = (*place, "critics"), f"expected one of {', '.join(critics)}"
    if algorithm == "DWB" and listed not in reader.document.values:
        reader.fault(place, "'critics' is missing", f"DWB does not start without a list of them: {', '.join(critics)}")
    for k, name in enumerate(reader.names(listed)):
        class_path = (*place, name, "class")
        text = reader.plain(class_path, "") if class_path in reader.document.values else name
        kind = short_class(text).removesuffix("Critic" if algorithm == "DWB" else "")
        if kind in critics:
            loaded.setdefault(kind, []).append((*place, name))
        elif (algorithm, kind) in FOREIGN_CRITICS:
            reader.fault((*listed, str(k)), f"the critic {text} of {algorithm} is not modeled", known)
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
        several = []
        for own in loaded[kind]:
            reader.kinds[own] = f"{algorithm} critic"
            given: dict[str, Any] = {"place": places[kind]} if kind in places else {}
            given["enabled"] = algorithm != "MPPI" or reader.plain((*own, "enabled"), True)
            several.append(reader.group(type(critic), own, given=given, left_out=critic, kinds=[kind]))
        parts[kind] = several[0] if len(several) == 1 else _summed(reader, listed, loaded[kind], several)
    return parts


_WEIGHTS: Final = ("cost_weight", "repulsion_weight", "critical_weight", "scale")


def _summed(
    reader: Reader, listed: ParameterLocation, places: Sequence[ParameterLocation], critics: Sequence[Any]
) -> Any:
    """Return one critic for several of a class, which Nav2 adds up; they must differ in their weights alone."""
    power = getattr(critics[0], "cost_power", 1)
    weights = {name: [getattr(each, name) for each in critics] for name in _WEIGHTS if hasattr(critics[0], name)}
    if any(
        each.model_copy(update={name: getattr(critics[0], name) for name in weights}) != critics[0] for each in critics
    ):
        names = " and ".join(dict.fromkeys(place[-1] for place in places))
        reader.fault(listed, f"{names} are critics of one class", "keep one of them, or let only their weights differ")
    what = f"there are {len(critics)} critics of the class of {places[0][-1]}"
    reader.warnings[listed] = what, "Nav2 counts each of them"
    sums = {name: math.fsum(math.prod([w] * power) for w in own) for name, own in weights.items()}
    roots = sums if power == 1 else {name: exp(log(total) / power) for name, total in sums.items()}
    return critics[0].model_copy(update=roots)


def written_controller_server(node: ParameterLocation, parameters: NavParameters) -> Values:
    """Write the node's parameters, its checkers, and its controller."""
    values = written(parameters.controller_server, node)
    for name, plugins in _CHECKERS.items():
        values |= written_plugins(node, plugins, {plugins.used: getattr(parameters, name)})
    values |= written_controller(node, parameters.controller)
    if parameters.rotation_shim.enabled:
        place = (*node, CONTROLLERS.used)
        values |= written(parameters.rotation_shim, place)
        values[(*place, "primary_controller")] = values[(*place, "plugin")]
        values[(*place, "plugin")] = ROTATION_SHIM
    return values


def written_controller(node: ParameterLocation, controller: ParameterGroup) -> Values:
    """The list `controller_plugins` with one controller, and its parameters."""
    place, critics = (*node, CONTROLLERS.used), critics_of(controller)
    enabled = (name for name, critic in critics.items() if critic.enabled)
    listed = sorted(enabled, key=lambda name: getattr(critics[name], "place", 0))
    values: Values = {
        (*node, CONTROLLERS.lists[0]): [place[-1]],
        (*place, "plugin"): CONTROLLER_PLUG_INS.name_of(type(controller)),
    }
    if critics:
        values[(*place, "critics")] = listed
    return values | written(controller, place, given=critics.keys() - set(listed))
