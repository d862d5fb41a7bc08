"""The table of modeled nodes and plug-in classes: their parameters, and the lists that name them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

from vastflow.sim.model.digest import Value
from vastflow.sim.model.parameter import ParameterGroup, ParameterLocation, source_of
from vastflow.sim.nav2.parameters.amcl import AmclParameters
from vastflow.sim.nav2.parameters.costmap import (
    Costmap,
    DenoiseLayer,
    InflationLayer,
    KeepoutFilter,
    ObstacleLayer,
    SpeedFilter,
    StaticLayer,
)
from vastflow.sim.nav2.parameters.servers import (
    NO_ANGLE_RAD,
    NO_LIMIT,
    BehaviorServer,
    ControllerServer,
    GoalChecker,
    NavFn,
    PlannerServer,
    ProgressChecker,
    SmacPlanner2D,
    SmacPlannerHybrid,
    VelocitySmoother,
    WaypointFollower,
)


@dataclass(frozen=True, slots=True)
class PluginClass:
    """A class that is modeled.

    Attributes:
        model: Its parameters.
        fixed: Fields that are no parameters of this class, with their values.
        only: Parameters of which a single value is modeled.
    """

    model: type[ParameterGroup] = ParameterGroup
    fixed: Mapping[str, Any] = field(default_factory=dict)
    only: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Plugins:
    """The plug-ins of one kind.

    Attributes:
        what: The kind, in words.
        lists: Names of the list parameter; older releases had a single name in place of a list.
        modeled: Class to what is modeled of it.
        foreign: Other classes of Nav2's, which are known and not modeled.
        defaults: Names to classes where a document has no list.
        used: The one that counts of several.
        asked_for: Words for how an action ends where the default behavior trees, which ask for `used` by its name, find no such; empty
            where they name none.
    """

    what: str
    lists: tuple[str, ...]
    modeled: Mapping[str, PluginClass]
    foreign: tuple[str, ...] = ()
    defaults: Mapping[str, str] = field(default_factory=dict)
    used: str = ""
    asked_for: str = ""


def class_name(text: str) -> str:
    """A class as Nav2 writes it today: `pkg::Class` for Humble's `pkg/Class`."""
    return text.replace("/", "::")


def short_class(text: str) -> str:
    """The class without its package."""
    return class_name(text).rpartition("::")[2]


def _classes(package: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{package}::{name}" for name in names)


_SMAC: Final = {"downsample_costmap": False}
_UNSTOPPED: Final = dict.fromkeys(("trans_stopped_velocity", "rot_stopped_velocity"), NO_LIMIT)

CONTROLLERS: Final = Plugins(
    what="controller",
    lists=("controller_plugins",),
    modeled={},  # see `vastflow.sim.nav2.parameter_files.plug_ins`
    foreign=(
        "nav2_graceful_controller::GracefulController",
        "nav2_graceful_motion_controller::GracefulMotionController",
        "graceful_controller::GracefulControllerROS",
        "neo_local_planner::NeoLocalPlanner",
        "teb_local_planner::TebLocalPlannerROS",
        "vector_pursuit_controller::VectorPursuitController",
    ),
    defaults={"FollowPath": "dwb_core::DWBLocalPlanner"},
    used="FollowPath",
    asked_for="FollowPath ends with INVALID_CONTROLLER",
)
PLANNERS: Final = Plugins(
    what="planner",
    lists=("planner_plugins",),
    modeled={
        "nav2_navfn_planner::NavfnPlanner": PluginClass(NavFn),
        "nav2_smac_planner::SmacPlanner2D": PluginClass(SmacPlanner2D, only=_SMAC),
        "nav2_smac_planner::SmacPlannerHybrid": PluginClass(SmacPlannerHybrid, only=_SMAC),
    },
    foreign=(
        *_classes("nav2_smac_planner", "SmacPlannerLattice", "SmacPlanner"),
        "nav2_theta_star_planner::ThetaStarPlanner",
    ),
    defaults={"GridBased": "nav2_navfn_planner::NavfnPlanner"},
    used="GridBased",
    asked_for="ComputePathToPose ends with INVALID_PLANNER",
)
PROGRESS_CHECKERS: Final = Plugins(
    what="progress checker",
    lists=("progress_checker_plugins", "progress_checker_plugin"),
    modeled={
        "nav2_controller::SimpleProgressChecker": PluginClass(
            ProgressChecker, {"required_movement_angle": NO_ANGLE_RAD}
        ),
        "nav2_controller::PoseProgressChecker": PluginClass(ProgressChecker),
    },
    defaults={"progress_checker": "nav2_controller::SimpleProgressChecker"},
    used="progress_checker",
)
GOAL_CHECKERS: Final = Plugins(
    what="goal checker",
    lists=("goal_checker_plugins", "goal_checker_plugin"),
    modeled={
        "nav2_controller::SimpleGoalChecker": PluginClass(GoalChecker, _UNSTOPPED),
        "nav2_controller::StoppedGoalChecker": PluginClass(GoalChecker),
        "nav2_controller::PositionGoalChecker": PluginClass(
            GoalChecker, {**_UNSTOPPED, "yaw_goal_tolerance": NO_ANGLE_RAD}
        ),
    },
    foreign=_classes("nav2_controller", "AxisGoalChecker"),
    defaults={"goal_checker": "nav2_controller::SimpleGoalChecker"},
    used="general_goal_checker",
)
PATH_HANDLERS: Final = Plugins(
    what="path handler",
    lists=("path_handler_plugins",),
    modeled={"nav2_controller::FeasiblePathHandler": PluginClass(only={"enforce_path_rotation": False})},
    defaults={"path_handler": "nav2_controller::FeasiblePathHandler"},
)
"""Since Lyrical, in place of parameters that each controller had."""
LAYERS: Final = Plugins(
    what="costmap layer",
    lists=("plugins",),
    modeled={
        "nav2_costmap_2d::StaticLayer": PluginClass(StaticLayer),
        "nav2_costmap_2d::ObstacleLayer": PluginClass(ObstacleLayer, {"short_clearing_cells": 0}),
        "nav2_costmap_2d::VoxelLayer": PluginClass(ObstacleLayer, {"short_clearing_cells": 2}),
        "nav2_costmap_2d::DenoiseLayer": PluginClass(DenoiseLayer),
        "nav2_costmap_2d::InflationLayer": PluginClass(InflationLayer),
        "spatio_temporal_voxel_layer::SpatioTemporalVoxelLayer": PluginClass(
            ObstacleLayer, {"short_clearing_cells": 2}
        ),
    },
    foreign=(
        *_classes("nav2_costmap_2d", "RangeSensorLayer", "PluginContainerLayer"),
        "nav2_bringup::NonPersistentVoxelLayer",
    ),
    defaults={
        "static_layer": "nav2_costmap_2d::StaticLayer",
        "obstacle_layer": "nav2_costmap_2d::ObstacleLayer",
        "inflation_layer": "nav2_costmap_2d::InflationLayer",
    },
)

FILTERS: Final = Plugins(
    what="costmap filter",
    lists=("filters",),
    modeled={
        "nav2_costmap_2d::KeepoutFilter": PluginClass(KeepoutFilter),
        "nav2_costmap_2d::SpeedFilter": PluginClass(SpeedFilter, only={"enable_path_lookahead": False}),
    },
    foreign=_classes("nav2_costmap_2d", "BinaryFilter", "InflationLayer"),
)

LAYERS_AND_FILTERS: Final = replace(LAYERS, modeled={**LAYERS.modeled, **FILTERS.modeled})
"""Plug-ins that a costmap's list `plugins` may have: filters are layers, too."""

ROTATION_SHIM: Final = "nav2_rotation_shim_controller::RotationShimController"
"""A plug-in of the kind controller that has another, `primary_controller`, inside."""

WAIT_AT_WAYPOINT: Final = "nav2_waypoint_follower::WaitAtWaypoint"

FOREIGN_CRITICS: Final = frozenset({("MPPI", "PathAlignLegacyCritic"), ("DWB", "MapGrid")})
"""Algorithms with those of their critics that are known and not modeled."""


@dataclass(frozen=True, slots=True)
class Node:
    """A node that is modeled.

    Attributes:
        model: Its own parameters.
        plugins: Kinds of plug-ins that it loads.
        lists: Its other lists of names.
        older: Its name in Galactic and before.
    """

    model: type[ParameterGroup] = ParameterGroup
    plugins: tuple[Plugins, ...] = ()
    lists: tuple[str, ...] = ()
    older: str = ""

    @property
    def names(self) -> frozenset[str]:
        """Names that its parameters begin with."""
        fields = [source_of(field).name or name for name, field in self.model.model_fields.items()]
        asked_for = [each.used for each in self.plugins if each.asked_for]
        return frozenset([*fields, *self.lists, *asked_for, *(name for each in self.plugins for name in each.lists)])


NODES: Final[Mapping[ParameterLocation, Node]] = {
    ("amcl",): Node(AmclParameters),
    ("controller_server",): Node(ControllerServer, (CONTROLLERS, PROGRESS_CHECKERS, GOAL_CHECKERS)),
    ("local_costmap", "local_costmap"): Node(Costmap, (LAYERS,)),
    ("global_costmap", "global_costmap"): Node(Costmap, (LAYERS,)),
    ("planner_server",): Node(PlannerServer, (PLANNERS,)),
    ("behavior_server",): Node(BehaviorServer, older="recoveries_server"),
    ("waypoint_follower",): Node(WaypointFollower),
    ("velocity_smoother",): Node(VelocitySmoother),
    ("collision_monitor",): Node(lists=("polygons",)),
}
"""Full name to node."""
