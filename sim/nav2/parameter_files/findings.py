"""Findings: for each parameter of a file, whether it is modeled, and the behavior otherwise.

What the simulator does in place of a parameter has the values of Nav2 Jazzy's default file, or of Nav2's code where the file leaves
them out. A parameter that is in no table here is not modeled.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, TypeAlias

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, Place
from vastflow.sim.model.files import TextPlace
from vastflow.sim.model.names import SLIP, nearest
from vastflow.sim.model.parameter import ParameterGroup, ParameterLocation
from vastflow.sim.nav2.parameter_files.costmaps import LAUNCH_WORDS
from vastflow.sim.nav2.parameter_files.declared import Declared, declared_defaults
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, ParameterDocument, dotted, node_of
from vastflow.sim.nav2.parameter_files.interpretation import Interpretation, monitored_topics
from vastflow.sim.nav2.parameter_files.nodes import CONTROLLERS, ROTATION_SHIM, class_name
from vastflow.sim.nav2.parameter_files.plug_ins import CONTROLLER_PLUG_INS
from vastflow.sim.nav2.parameter_files.reader import Reader, shown

Status: TypeAlias = Literal["modeled", "built in", "no effect", "differs", "not modeled"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Status of one parameter of a file.

    Attributes:
        path: Where the file has it, `place` as line and column.
        value: What the file says.
        status: `modeled`: it is used. `built in`: it says what is done anyway. `no effect`: it makes no difference to
            missions. `differs`: something else is done. `not modeled`: nothing is done.
        used: The value the simulator has, a range in words; None without one.
        why: Why it is not used, or what is done instead; may be empty.
        about: The parameter, or a group with nothing in it that is modeled, which can be spoken of once.
    """

    path: ParameterLocation
    place: TextPlace
    value: Value
    status: Status
    used: Value
    why: str
    about: ParameterLocation


def findings(found: Interpretation) -> tuple[Finding, ...]:
    """A finding for each parameter of a document, in the order of the file."""
    document, reader = found.document, found.reader
    return tuple(
        _finding(reader, document, path)
        for path in sorted(document.values, key=document.place)
        if document.values[path] is not None  # `GridBased:` with nothing below it
    )


def slips(found: Interpretation) -> Iterator[tuple[Finding, str]]:
    """Unknown parameters, each with the missing sibling of the most similar spelling."""
    document, reader = found.document, found.reader
    known = nav2_names()
    for each in findings(found):
        node, name = each.path[:-1], each.path[-1]
        if each.status != "not modeled" or each.why or name in known:
            continue
        beside = {*TABLES.get(reader.kinds.get(node, "".join(node[-2:-1])), {})}
        beside |= {path[-1] for path in reader.asked if path[:-1] == node}
        lacking = {
            other for other in beside if (*node, other) not in document.values and abs(len(other) - len(name)) < 2
        }
        if near := nearest(name, lacking, SLIP):
            yield each, near


def left_out(found: Interpretation) -> Mapping[ParameterLocation, Value]:
    """The modeled parameters that a document's nodes do not give, with what Nav2's code takes for them."""
    reader, values = found.reader, found.document.values
    return {path: reader.asked[path] for path in reader.fields if PARAMETERS in path and path not in values}


class Omitted(NamedTuple):
    """A parameter that a document leaves out, with another value in Nav2's code than elsewhere.

    Attributes:
        declared: What Nav2's code has, and where.
        other: Value of Nav2 Jazzy's file, or the one that is built in.
        is_used: Whether the simulator has Nav2's.
    """

    path: ParameterLocation
    declared: Declared
    other: Value
    is_used: bool


def omitted(found: Interpretation) -> tuple[Omitted, ...]:
    """The parameters that a document leaves out and that Nav2's code does not have as Jazzy's file or the simulator."""
    reader, values = found.reader, found.document.values
    rows = [Omitted(path, *each, True) for path, each in reader.omitted.items() if not _nearest(path, reader.unused)]
    for node, kind in reader.kinds.items():
        declared = declared_defaults().get(kind, {})
        for name in declared.keys() & TABLES.get(kind, {}).keys():
            rule, path, default = TABLES[kind][name], (*node, *name.split(".")), declared[name].default
            if default is not None and path not in (values.keys() | reader.asked.keys()) and not rule.agrees(default):
                rows.append(Omitted(path, declared[name], rule.value, False))
    return tuple(sorted(rows))


def command_chain(found: Interpretation) -> str:
    """Draw the chain of a command from the controller to the base, by its topics."""
    smoother = "" if "velocity_smoother" in found.left_away else " → velocity_smoother"
    topics = monitored_topics(found.document)
    if topics is None:
        return f"controller{smoother} → base"
    into, out = topics
    if into == "cmd_vel_nav":
        through = " → (cmd_vel_nav) "
    else:
        gap = "" if into == "cmd_vel_smoothed" else f" ✗ ({into})"
        through = f"{smoother} → (cmd_vel_smoothed){gap} "
    return f"controller{through}→ collision_monitor → ({out}) → base"


def refusals(found: Interpretation) -> Iterator[Fault]:
    """Yield what a file has and no node of Nav2 starts with, though it can be read."""
    reader, document = found.reader, found.document

    def fault(path: ParameterLocation, problem: str, expected: str) -> Fault:
        return Fault(Place(document.file, *document.place(path), dotted(path)), problem, expected)

    for path, value in document.values.items():
        group = _nearest(path[:-1], reader.kinds)
        kind = reader.kinds.get(group or (), "")
        declared = declared_defaults().get(group[-1] if group and kind.endswith(" critic") else kind, {})
        name = ".".join(path[len(group or ()) :])
        is_known = name in declared and value is not None and value not in (*LAUNCH_WORDS,)
        if is_known and (right := _right_type(value, declared[name].default)):
            yield fault(path, f"got {shown(value)}", f"{right}, as the node ends otherwise")
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
                right = (
                    f"controller_plugins: [{plugin[-1]}], as Nav2 does not start without critics for its default, DWB"
                )
                yield fault(plugin, "no controller_plugins names it", right)


def _right_type(value: Value, default: Value) -> str:
    """Return what a value of another type than a parameter's must be; empty for one of its type."""
    if isinstance(default, list):
        items = value if isinstance(value, Sequence) and not isinstance(value, str) else [None]
        right = _right_type(items[0], default[0]) if items and default else ""
        mixed = next((wrong for item in items if default and (wrong := _right_type(item, default[0]))), right)
        return f"a list, each item {mixed}" if mixed else ""
    if type(default) is type(value) or default is None:
        return ""
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        return f"a double, such as {float(value)}"
    names = {bool: "true or false", int: "an integer", float: "a double", str: "text"}
    return names.get(type(default), "")


_SINCE: Final = "0.2"
_READ_AS_JAZZY: Final = frozenset({"angular_disengage_threshold", "max_obstacle_height", "scale"})
"""Parameters that before `_SINCE` had other defaults than Nav2's code, beside those of nodes that a file lacks."""


def defaults_row(found: Interpretation) -> dict[str, dict[str, Value]]:
    """Return for `metadata.json` the defaults that count for a file, and since which version those that had been others."""
    row: dict[str, dict[str, Value]] = {}
    for path, declared, _, is_used in omitted(found):
        is_new = path[-1] in _READ_AS_JAZZY or node_of(path) not in found.document.nodes
        if is_used:
            row[dotted(path)] = {"value": declared.default, "since": _SINCE if is_new else ""}
    return row


def _finding(reader: Reader, document: ParameterDocument, path: ParameterLocation) -> Finding:
    value, place = document.values[path], document.place(path)

    def found(status: Status, why: str = "", used: Value = None, about: ParameterLocation = path) -> Finding:
        return Finding(path, place, value, status, used, why, about)

    if path in reader.held:
        return found("differs", f"runs at {reader.held[path]:g} Hz, in whole ticks of 50 ms", reader.held[path])
    if path in reader.asked and path not in reader.unmodeled:
        used = reader.asked[path]
        return found("modeled", used=list(used) if isinstance(used, tuple) else used)
    if group := _nearest(path, reader.unused):
        return found("no effect", reader.unused[group], about=group)
    if group := _nearest(path, reader.unmodeled):
        return found("not modeled", reader.unmodeled[group], about=group)
    node = node_of(path)
    node_name = "".join(node[-2:-1])
    if node_name in UNUSED_NODES:
        return found("no effect", UNUSED_NODES[node_name], about=node)
    group = _nearest(path[:-1], reader.kinds)  # a group that has a value of its own is none
    kind = reader.kinds[group] if group else node_name
    name, table = path[len(group or node) :], TABLES.get(kind, {})
    rule = table.get(".".join(name)) or table.get(f"{name[0]}.*") or IN_EVERY_NODE.get(name[-1])
    if rule is not None:
        if not rule.agrees(value):
            return found("differs", used=rule.value)
        return found("no effect", rule.why) if rule == ANY or rule.why else found("built in", used=value)
    plugin = (*(group or node), name[0])
    if len(name) > 1 and _is_unlisted(document, plugin):
        return found("no effect", "no list of plug-ins has it", about=plugin)
    if kind.endswith("_costmap") and node not in reader.kinds:
        return found("not modeled", f"Nav2's node is {kind}/{kind}, one level deeper", about=node)
    if group is None and kind not in TABLES:
        return found("not modeled", "nothing of this node is", about=node)
    return found("not modeled")


def _is_unlisted(document: ParameterDocument, plugin: ParameterLocation) -> bool:
    """Whether this is a plug-in, or an area of the collision monitor, that its list does not name."""
    beside = [value for path, value in document.values.items() if path[:-1] == plugin[:-1]]
    lists = [value for value in beside if isinstance(value, Sequence)]
    is_one = any((*plugin, name) in document.values for name in ("plugin", "action_type"))
    return is_one and not any(plugin[-1] in names for names in lists)


def _nearest(path: ParameterLocation, groups: Mapping[ParameterLocation, str]) -> ParameterLocation | None:
    """The longest path among `groups` that `path` is or is below of."""
    return next((path[:n] for n in range(len(path), 0, -1) if path[:n] in groups), None)


@dataclass(frozen=True, slots=True)
class BuiltIn:
    """Behavior of the simulator that no file changes.

    Attributes:
        values: Values that mean just that; the first is what a file would say. Without any, every value does.
        low, high: Range of numbers that mean the same, in place of `values`.
        includes: Names that a list must have, in place of `values`.
        prefixed: Whether text before one of the `values` makes no difference, as the robot's name before a frame.
        why: What is done in place of any of these values, none of which has an effect; may be empty.
    """

    values: tuple[Value, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    includes: tuple[str, ...] = ()
    prefixed: bool = False
    why: str = ""

    def agrees(self, value: Value) -> bool:
        """Whether `value` requests the behavior that the simulator has anyway."""
        if self.prefixed:
            return isinstance(value, str) and value.endswith(tuple(map(str, self.values)))
        if self.values:
            return any(_equal(value, own) for own in self.values)
        if self.includes:
            return isinstance(value, Sequence) and set(self.includes) <= set(map(str, value))
        if self == ANY:
            return True
        return isinstance(value, int | float) and not isinstance(value, bool) and self.low <= value <= self.high

    @property
    def value(self) -> Value:
        """The value that a file would have, or the range in words."""
        if self.values:
            return list(own) if isinstance(own := self.values[0], tuple) else own
        if self.includes:
            return list(self.includes)
        return f"{self.low:g} or more" if math.isfinite(self.low) else f"{self.high:g} or less"


ANY: Final = BuiltIn()


def nav2_names() -> frozenset[str]:
    """Last names of all parameters that are modeled or listed here, of any node or plug-in."""
    groups = [ParameterGroup]
    for group in groups:
        groups += group.__subclasses__()
    tabled = (name.removesuffix(".*").rpartition(".")[2] for table in TABLES.values() for name in table)
    return frozenset([*tabled, *IN_EVERY_NODE, *(name for group in groups for name in group.model_fields)])


def _equal(value: Value, own: Value) -> bool:
    if isinstance(value, str) and isinstance(own, str):
        # Of a file's name the folder does not matter.
        return class_name(value) == class_name(own) or (bool(own) and value.endswith(f"/{own}"))
    if isinstance(value, bool) or isinstance(own, bool):
        return value is own
    if isinstance(value, Sequence) and isinstance(own, Sequence):
        return list(value) == list(own)
    return value == own


def only(*values: Value) -> BuiltIn:
    return BuiltIn(values)


def _any(*names: str) -> dict[str, BuiltIn]:
    return dict.fromkeys(names, ANY)


LASER_HEIGHT_M: Final = 0.193

IN_EVERY_NODE: Final[Mapping[str, BuiltIn]] = _any(
    "use_sim_time",
    "bond_heartbeat_period",
    "use_realtime_priority",
    "enable_stamped_cmd_vel",
    "action_server_result_timeout",
    "introspection_mode",
    "service_introspection_mode",
)

UNUSED_NODES: Final[Mapping[str, str]] = {
    "map_server": "the campaign gives the map",
    **dict.fromkeys(
        ("filter_mask_server", "keepout_filter_mask_server", "speed_filter_mask_server"),
        "the campaign gives the mask: keepout_mask, speed_mask",
    ),
    "map_saver": "no mission calls it",
    "smoother_server": "the default behavior trees do not call it",
    "docking_server": "no mission calls it",
    "route_server": "no mission calls it",
    "loopback_simulator": "another simulator",
}
"""Nodes that have no effect on the missions, and why."""

_FRAMES: Final = (
    *("global_frame", "local_frame", "robot_base_frame"),
    *("base_frame_id", "odom_frame_id", "global_frame_id"),
)
_BEHAVIORS: Final = {
    "spin": "Spin",
    "backup": "BackUp",
    "back_up": "BackUp",
    "wait": "Wait",
    "drive_on_heading": "DriveOnHeading",
    "assisted_teleop": "AssistedTeleop",
}

_COSTMAP: Final[Mapping[str, BuiltIn]] = {
    **_any("robot_base_frame", "always_send_full_costmap", "transform_tolerance", "initial_transform_timeout"),
    **_any("origin_x", "origin_y", "map_topic"),
    "lethal_cost_threshold": only(100),
    "unknown_cost_value": only(255),
    "trinary_costmap": only(True),
    "use_maximum": only(False),
}
_OBSTACLE_LAYER: Final[Mapping[str, BuiltIn]] = {
    **_any("tf_filter_tolerance", "track_unknown_space"),  # this is the costmap's
    "combination_method": only(1),
    "min_obstacle_height": BuiltIn(high=LASER_HEIGHT_M),
    "max_obstacle_height": BuiltIn(low=LASER_HEIGHT_M),
}
# Searches end after a number of iterations, and not by the clock.
_SMAC: Final = _any("max_planning_time", "terminal_checking_interval", "downsampling_factor", "viz_expansions")

TABLES: Final[Mapping[str, Mapping[str, BuiltIn]]] = {
    "amcl": {
        **_any(*_FRAMES, "scan_topic", "map_topic", "save_pose_rate", "transform_tolerance", "random_seed"),
        **_any("z_max", "z_short", "lambda_short", "first_map_only"),
        **_any("do_beamskip", "beam_skip_distance", "beam_skip_threshold", "beam_skip_error_threshold"),
        # The mission publishes where the robot starts.
        **_any("set_initial_pose", "always_reset_initial_pose", "initial_pose.*"),
        "laser_model_type": only("likelihood_field"),
        "recovery_alpha_fast": only(0.0),
        "recovery_alpha_slow": only(0.0),
        "tf_broadcast": only(True),
        "freespace_downsampling": only(False),
    },
    "bt_navigator": {
        **_any(*_FRAMES, "odom_topic", "transform_tolerance", "filter_duration", "default_server_timeout"),
        **_any("wait_for_service_timeout", "plugin_lib_names", "error_code_names"),
        **_any("error_code_name_prefixes", "always_reload_bt_xml", "enable_groot_monitoring"),
        **_any("groot_zmq_publisher_port", "groot_zmq_server_port", "goal_blackboard_id", "path_blackboard_id"),
        "bt_loop_duration": BuiltIn(high=50.0, why="trees are ticked every 50 ms"),
        "navigators": BuiltIn(includes=("navigate_to_pose", "navigate_through_poses")),
        "navigate_to_pose.plugin": only("nav2_bt_navigator::NavigateToPoseNavigator"),
        "navigate_through_poses.plugin": only("nav2_bt_navigator::NavigateThroughPosesNavigator"),
        "default_nav_to_pose_bt_xml": only("navigate_to_pose_w_replanning_and_recovery.xml", ""),
        "default_nav_through_poses_bt_xml": only("navigate_through_poses_w_replanning_and_recovery.xml", ""),
    },
    "controller_server": {
        **_any("odom_topic", "odom_duration", "speed_limit_topic"),
        "publish_zero_velocity": only(True),
    },
    **{
        f"{name}GoalChecker": {"xy_goal_tolerance_buffer": only(0.0), "path_length_tolerance": BuiltIn(low=1000.0)}
        for name in ("Simple", "Stopped", "Position")
    },
    "FeasiblePathHandler": {**_any("minimum_rotation_angle"), "reject_unit_path": only(False)},
    "local_costmap": {**_COSTMAP, "global_frame": BuiltIn(("odom",), prefixed=True), "rolling_window": only(True)},
    "global_costmap": {
        **_COSTMAP,
        **_any("publish_frequency", "width", "height", "resolution"),
        "global_frame": BuiltIn(("map",), prefixed=True),
        "rolling_window": only(False),
    },
    "StaticLayer": {
        **_any("map_subscribe_transient_local", "map_topic", "subscribe_to_updates", "transform_tolerance"),
        # These are the costmap's: Nav2 does not look for them here.
        **_any("track_unknown_space", "use_maximum", "lethal_cost_threshold", "unknown_cost_value", "trinary_costmap"),
        "footprint_clearing_enabled": only(False),
    },
    "ObstacleLayer": _OBSTACLE_LAYER,
    "VoxelLayer": {
        **_OBSTACLE_LAYER,
        **_any("publish_voxel_map"),
        # Of the slices only the scan's is ever used: it must be among them, whatever its height is.
        "origin_z": only(0.0),
        "z_resolution": BuiltIn(low=0.05),
        "z_voxels": BuiltIn(low=4),
        "mark_threshold": only(0),
        "unknown_threshold": only(15),
    },
    "scan": {
        **_any("topic", "sensor_frame", "transport_type", "expected_update_rate", "tf_filter_tolerance"),
        "min_obstacle_height": BuiltIn(high=LASER_HEIGHT_M),
        "max_obstacle_height": BuiltIn(low=LASER_HEIGHT_M),
        "inf_is_valid": only(False),
        "observation_persistence": only(0.0),
        "raytrace_min_range": only(0.0),
    },
    "KeepoutFilter": {
        **_any("transform_tolerance", "filter_info_topic"),
    },
    "SpeedFilter": {
        **_any("transform_tolerance", "filter_info_topic", "speed_limit_topic", "path_topic", "odom_topic"),
        **_any("max_decel", "min_lookahead", "max_lookahead"),
    },
    # A mask is among the campaign's parameters, and a keepout filter takes its values as they are.
    "filter info": _any("filter_info_topic", "mask_topic", "type", "base", "multiplier"),
    "InflationLayer": {"inflate_unknown": only(False), "inflate_around_unknown": only(False)},
    "planner_server": _any("expected_planner_frequency"),
    "NavfnPlanner": {"use_final_approach_orientation": only(False)},
    "SmacPlanner2D": {
        **_SMAC,
        "use_final_approach_orientation": only(False),
        "motion_model_for_search": only("MOORE", "2D"),  # of Humble and before: eight neighbors, as since then
    },
    "SmacPlannerHybrid": {
        **_SMAC,
        **_any("cache_obstacle_heuristic", "debug_visualizations", "coarse_search_resolution"),
        "goal_heading_mode": only("DEFAULT"),
    },
    "MPPI": {
        **_any("visualize", "TrajectoryVisualizer.*", "publish_critics_stats", "publish_optimal_trajectory"),
        **_any("transform_tolerance"),
        "iteration_count": only(1),
        "retry_attempt_limit": only(1),
        "reset_period": only(1.0),
        "regenerate_noises": only(True),
        **dict.fromkeys(("model_delay_vx", "model_delay_vy", "model_delay_wz"), only(0.0)),
        "clamp_raw_controls": only(False),
        "sgf_order": only(2),
        "open_loop": only(False),
    },
    "MPPI critic": {
        # A disc collides where its center is inscribed, so the costs short of a collision never come to count.
        **_any("near_collision_cost", "critical_cost", "inflation_layer_name"),
        "cost_power": only(1),
        "symmetric_yaw_tolerance": only(False),
    },
    "DWB": {
        **_any("transform_tolerance", "debug_trajectory_details", "short_circuit_trajectory_evaluation", "stateful"),
        **_any("default_critic_namespaces", "time_granularity"),
        **_any("publish_evaluation", "publish_global_plan", "publish_transformed_plan", "publish_local_plan"),
        **_any("publish_trajectories", "publish_cost_grid_pc", "marker_lifetime"),
        "trajectory_generator_name": only("dwb_plugins::StandardTrajectoryGenerator", "StandardTrajectoryGenerator"),
        "prune_plan": only(True),
        "shorten_transformed_plan": only(True),
        "include_last_point": only(True),
        "discretize_by_time": only(False),
        "limit_vel_cmd_in_traj": only(False),
        "split_path": only(False),
    },
    "DWB critic": {
        "lookahead_time": only(-1.0),
        "aggregation_type": only("last"),
        "oscillation_reset_time": only(-1.0),
    },
    "RPP": {
        **_any("transform_tolerance", "inversion_xy_tolerance", "inversion_yaw_tolerance", "cancel_deceleration"),
        # Of a dynamic window alone, since Lyrical.
        **_any("min_linear_vel", "max_angular_vel", "min_angular_vel"),
        **_any("max_linear_accel", "max_linear_decel", "max_angular_decel"),
        **dict.fromkeys(("use_dynamic_window", "allow_obstacle_checking_beyond_goal"), only(False)),
        "min_distance_to_obstacle": BuiltIn(high=0.0),
        "interpolate_curvature_after_goal": only(False),
        "use_cancel_deceleration": only(False),
        "use_interpolation": only(True),
    },
    "behavior_server": {
        **_any(*_FRAMES, "costmap_topic", "footprint_topic", "local_costmap_topic", "local_footprint_topic"),
        **_any("global_costmap_topic", "global_footprint_topic", "transform_tolerance", "projection_time"),
        **_any("transform_timeout"),
        "cycle_frequency": only(10.0),
        "behavior_plugins": BuiltIn(includes=("spin", "backup", "wait")),
        # Of Galactic and before, as the classes of nav2_recoveries.
        "recovery_plugins": BuiltIn(includes=("spin", "wait")),
        **{
            f"{name}.plugin": only(f"nav2_behaviors::{class_}", f"nav2_recoveries::{class_}")
            for name, class_ in _BEHAVIORS.items()
        },
    },
    "waypoint_follower": _any("loop_rate", "global_frame_id"),
    "velocity_smoother": {
        **_any("odom_topic"),
        "smoothing_frequency": only(20.0),
        "scale_velocities": only(False),
        "deadband_velocity": only((0.0,) * 3, (0.0,) * 6),
    },
    "collision_monitor": {
        **_any(*_FRAMES, "cmd_vel_in_topic", "cmd_vel_out_topic", "state_topic", "transform_tolerance"),
        **_any("stop_pub_timeout"),
        "base_shift_correction": only(True),
    },
    "approach polygon": _any("footprint_topic", "visualize", "polygon_pub_topic"),
    "zone": _any("footprint_topic", "visualize", "polygon_pub_topic", "polygon_sub_topic"),
    "monitored scan": {
        **_any("topic", "sensor_frame", "transport_type"),
        "min_height": BuiltIn(high=LASER_HEIGHT_M),
        "max_height": BuiltIn(low=LASER_HEIGHT_M),
    },
}
"""Kind of a group to its parameters; `name.*` stands for all below a name."""
