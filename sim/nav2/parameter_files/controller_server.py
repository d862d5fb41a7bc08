"""Reading the node `controller_server`: its checkers, and the controller with its critics, in a Rotation Shim or not."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Final, TypeGuard

from vastflow.sim.model.digest import Value
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.nav2.controllers.registry import (
    FILE,
    OWN,
    UnknownController,
    find_parameters,
    known_controllers,
    short_name,
)
from vastflow.sim.nav2.parameter_files.plugins import (
    CONTROLLERS,
    FOREIGN_CRITICS,
    GOAL_CHECKERS,
    PATH_HANDLERS,
    PROGRESS_CHECKERS,
    ROTATION_SHIM,
    class_name,
    critic_class,
)
from vastflow.sim.nav2.parameter_files.reader import Group, Parts, Reader
from vastflow.sim.nav2.parameters.mppi import AckermannParameters, MppiParameters
from vastflow.sim.nav2.parameters.parameter import ParameterGroup, ParameterLocation, complaint
from vastflow.sim.nav2.parameters.servers import (
    NO_ANGLE_RAD,
    NO_LIMIT,
    ControllerServer,
    GoalChecker,
    ProgressChecker,
    RotationShim,
)

_OF_THE_STOPPED: Final = ("trans_stopped_velocity", "rot_stopped_velocity")
"""Parameters that of the goal checkers the StoppedGoalChecker alone has."""

_OF_OMNI: Final = ("ay_max", "ay_min", "vy_std")
"""Parameters of MPPI that of its motion models Omni alone has."""

_OF_INVERSIONS: Final = ("inversion_xy_tolerance", "inversion_yaw_tolerance")
"""Parameters of MPPI that its `enforce_path_inversion` alone reads."""

_OF_THE_PATH: Final = ("prune_distance", "enforce_path_inversion", *_OF_INVERSIONS)
"""Parameters of MPPI that since Lyrical the path handler has."""

_HANDLED_M: Final = 2.0
"""A path handler's `prune_distance` in Nav2's code."""

_MOTION_MODELS: Final[Mapping[str, str]] = {
    f"mppi::{name}MotionModel": name for name in ("DiffDrive", "Ackermann", "Omni")
}
"""Plug-ins of MPPI's to what its parameter calls them before Lyrical."""


def read_controller_server(reader: Reader, node: ParameterLocation) -> Parts:
    parts: dict[str, Any] = {"controller_server": reader.group(ControllerServer, node)}
    if progress := reader.plugin(node, PROGRESS_CHECKERS):
        given = {"required_movement_angle": NO_ANGLE_RAD} if progress.kind == "SimpleProgressChecker" else None
        parts["progress_checker"] = reader.group(ProgressChecker, (*node, progress.name), given=given)
    if goal := reader.plugin(node, GOAL_CHECKERS):
        given = {} if goal.kind == "StoppedGoalChecker" else dict.fromkeys(_OF_THE_STOPPED, NO_LIMIT)
        if goal.kind == "PositionGoalChecker":
            given["yaw_goal_tolerance"] = NO_ANGLE_RAD
        parts["goal_checker"] = reader.group(GoalChecker, (*node, goal.name), given=given)
    # Nav2's code would load DWB here and find no critics for it: such a file is one for other parameters.
    named = [(*node, *CONTROLLERS.lists), (*node, CONTROLLERS.used, "plugin")]
    if any(path in reader.document.values for path in named) and (used := reader.used(node, CONTROLLERS)):
        parts |= _controller(reader, (*node, used[0]), used[1])
    return parts


def _path_handler(reader: Reader, node: ParameterLocation) -> ParameterLocation | None:
    """Where the node has the parameters of its path handler, None where controllers have them; what it can't do is a fault."""
    named = [(*node, *PATH_HANDLERS.lists), *((*node, name, "plugin") for name in PATH_HANDLERS.defaults)]
    found = reader.plugin(node, PATH_HANDLERS) if any(path in reader.document.values for path in named) else None
    if found is None:
        return None
    reader.only((*node, found.name, "enforce_path_rotation"), False)
    return (*node, found.name)


def _controller(reader: Reader, place: ParameterLocation, listed: ParameterLocation) -> Parts:
    """The controller with the parameters at `place`; one that can't be found is a fault."""
    document, node, path = reader.document, place[:-1], (*place, "plugin")
    text = reader.text(path, reader.default_class(place[-1], listed, CONTROLLERS))
    name = text if FILE in text else class_name(text)
    parts: Parts = {}
    shimmed: tuple[ParameterLocation, ...] = ()
    if name == ROTATION_SHIM:
        parts, shimmed = _rotation_shim(reader, place)
        path = primary_controller(document.values, place)
        place = path[:-1] if path[-1] == "plugin" else place
        text = reader.text(path, "")
        name = text if FILE in text else class_name(text)
    known = ", ".join(known_controllers())
    if not name:
        right = f"the class of a controller; known: {known}; {OWN}"
        reader.fault(listed, f"no {path[-1]!r} below {place[-1]!r}", right)
        return {}
    if name in (*CONTROLLERS.foreign, ROTATION_SHIM):
        reader.fault(path, f"{name} is not modeled", f"a controller that is: {known}; {OWN}")
        return {}
    try:
        kind = find_parameters(name, Path(document.file).parent, document.plug_ins.get(name))
    except UnknownController as error:
        reader.fault(path, error.what, error.right)
        return {}
    if not kind.__module__.startswith("vastflow."):
        return {**parts, "controller": _own_parameters(reader, kind, place, {(*place, "plugin"), path, *shimmed})}
    return {**parts, "controller": _of_nav2(reader, kind, node, place, short_name(name).upper())}


def _of_nav2(
    reader: Reader, kind: type[ParameterGroup], node: ParameterLocation, place: ParameterLocation, algorithm: str
) -> ParameterGroup:
    """A controller of Nav2's with its critics."""
    reader.kinds[place] = algorithm
    given = dict(_critics(reader, place, algorithm, kind()))
    if algorithm == "MPPI":
        given |= _motion_model(reader, place)
        _check_obstacles(reader, place, given)
    elsewhere = _handled(reader, _path_handler(reader, node), algorithm, given)
    found = reader.group(kind, place, elsewhere, given)
    if isinstance(found, MppiParameters) and found.motion_model != "Omni":
        for name in _OF_OMNI:
            reader.leave((*place, name), "the motion model is not Omni")
    if isinstance(found, MppiParameters) and not found.enforce_path_inversion:
        for name in _OF_INVERSIONS:
            reader.leave(elsewhere.get(name, (*place, name)), "enforce_path_inversion is not set")
    return found


def _handled(
    reader: Reader, handler: ParameterLocation | None, algorithm: str, given: dict[str, Any]
) -> Mapping[str, ParameterLocation]:
    """Which of a controller's parameters the path handler has; DWB and RPP cut the path as those of Jazzy do."""
    if handler is None:
        return {}
    if algorithm != "MPPI":
        reader.only((*handler, "enforce_path_inversion"), False)
        return {}
    elsewhere = {name: (*handler, name) for name in _OF_THE_PATH}
    if elsewhere["prune_distance"] not in reader.document.values:
        del elsewhere["prune_distance"]
        given["prune_distance"] = _HANDLED_M
    return elsewhere


def _check_obstacles(reader: Reader, place: ParameterLocation, critics: Parts) -> None:
    """ObstaclesCritic stands for CostCritic, and looks at the robot's center alone."""
    if not critics["ObstaclesCritic"].enabled:
        return
    reader.only((*place, "ObstaclesCritic", "consider_footprint"), False)
    if critics["CostCritic"].enabled:
        reader.fault((*place, "critics"), "CostCritic and ObstaclesCritic together are not modeled", "one of them")


def _motion_model(reader: Reader, place: ParameterLocation) -> Parts:
    """What of MPPI's parameters goes with its motion model, where it is not read as the others are.

    Since Lyrical the model is the name of a group with a `plugin` and the model's parameters.
    """
    values, given = reader.document.values, dict[str, Any]()
    model = values.get((*place, "motion_model"))
    constraints, plugin = (*place, "AckermannConstraints"), (*place, str(model), "plugin")
    if plugin in values:
        constraints, found = plugin[:-1], class_name(reader.text(plugin, ""))
        given["motion_model"] = model = _MOTION_MODELS.get(found, "DiffDrive")
        if found not in _MOTION_MODELS:
            reader.fault(plugin, f"no motion model {found!r} is known", f"known: {', '.join(_MOTION_MODELS)}")
        reader.asked[(*place, "motion_model")] = found
    given["AckermannConstraints"] = reader.group(AckermannParameters, constraints)
    if model != "Ackermann":
        reader.leave((*constraints, "min_turning_r"), "the motion model is not Ackermann")
    if model != "Omni":
        # Nav2 does not read these, so that they may be out of range, as a standard deviation of 0.
        usual = MppiParameters()
        for name in _OF_OMNI:
            path = (*place, name)
            if path in values and complaint(MppiParameters, name, values[path]):
                given[name] = getattr(usual, name)
    return given


def primary_controller(values: Mapping[ParameterLocation, Value], shim: ParameterLocation) -> ParameterLocation:
    """Where a Rotation Shim has the class of its controller: since Kilted below a group that has its parameters, too."""
    path = (*shim, "primary_controller")
    return path if (*path, "plugin") not in values else (*path, "plugin")


def _rotation_shim(reader: Reader, place: ParameterLocation) -> tuple[Parts, tuple[ParameterLocation, ...]]:
    """The Rotation Shim, and where its parameters may be: the controller in it has its own beside them."""
    shim = reader.group(RotationShim, place, given={"enabled": True})
    return {"rotation_shim": shim}, tuple((*place, name) for name in RotationShim.model_fields)


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
        reader.kinds[loaded[kind]] = f"{algorithm} critic"
        enabled = algorithm != "MPPI" or reader.flag((*loaded[kind], "enabled"), True)
        given = {"enabled": enabled} | ({"place": places[kind]} if kind in places else {})
        parts[kind] = reader.group(type(critic), loaded[kind], given=given)
    return parts
