"""Plug-ins: which classes of Nav2's are modeled, and the lists of names by which a document has them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final


@dataclass(frozen=True, slots=True)
class Plugins:
    """The plug-ins of one kind.

    Attributes:
        what: The kind, in words.
        lists: Names of the list parameter; older releases had a single name in place of a list.
        modeled: Class to what it is called here.
        foreign: Other classes of Nav2's, which are known and not modeled.
        defaults: Names to classes where a document has no list.
        used: The one that counts of several.
        is_asked_for: Whether the default behavior trees ask for `used` by its name, so that Nav2 finds no other.
    """

    what: str
    lists: tuple[str, ...]
    modeled: Mapping[str, str]
    foreign: tuple[str, ...] = ()
    defaults: Mapping[str, str] = field(default_factory=dict)
    used: str = ""
    is_asked_for: bool = False


def class_name(text: str) -> str:
    """A class as Nav2 writes it today: `pkg::Class` for Humble's `pkg/Class`."""
    return text.replace("/", "::")


def _classes(package: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{package}::{name}" for name in names)


CONTROLLERS: Final = Plugins(
    what="controller",
    lists=("controller_plugins",),
    modeled={},  # see `vastflow.sim.nav2.controllers.registry`
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
    is_asked_for=True,
)
PLANNERS: Final = Plugins(
    what="planner",
    lists=("planner_plugins",),
    modeled={
        "nav2_navfn_planner::NavfnPlanner": "NavFn",
        "nav2_smac_planner::SmacPlanner2D": "SmacPlanner2D",
        "nav2_smac_planner::SmacPlannerHybrid": "SmacPlannerHybrid",
    },
    foreign=(
        *_classes("nav2_smac_planner", "SmacPlannerLattice", "SmacPlanner"),
        "nav2_theta_star_planner::ThetaStarPlanner",
    ),
    defaults={"GridBased": "nav2_navfn_planner::NavfnPlanner"},
    used="GridBased",
    is_asked_for=True,
)
PROGRESS_CHECKERS: Final = Plugins(
    what="progress checker",
    lists=("progress_checker_plugins", "progress_checker_plugin"),
    modeled={f"nav2_controller::{name}": name for name in ("SimpleProgressChecker", "PoseProgressChecker")},
    defaults={"progress_checker": "nav2_controller::SimpleProgressChecker"},
    used="progress_checker",
)
GOAL_CHECKERS: Final = Plugins(
    what="goal checker",
    lists=("goal_checker_plugins", "goal_checker_plugin"),
    modeled={
        f"nav2_controller::{name}": name for name in ("SimpleGoalChecker", "StoppedGoalChecker", "PositionGoalChecker")
    },
    foreign=_classes("nav2_controller", "AxisGoalChecker"),
    defaults={"goal_checker": "nav2_controller::SimpleGoalChecker"},
    used="general_goal_checker",
)
PATH_HANDLERS: Final = Plugins(
    what="path handler",
    lists=("path_handler_plugins",),
    modeled={"nav2_controller::FeasiblePathHandler": "path handler"},
    defaults={"path_handler": "nav2_controller::FeasiblePathHandler"},
)
"""Since Lyrical, in place of parameters that each controller had."""
LAYERS: Final = Plugins(
    what="costmap layer",
    lists=("plugins",),
    modeled={
        **{
            f"nav2_costmap_2d::{name}": name
            for name in ("StaticLayer", "ObstacleLayer", "VoxelLayer", "DenoiseLayer", "InflationLayer")
        },
        "spatio_temporal_voxel_layer::SpatioTemporalVoxelLayer": "SpatioTemporalVoxelLayer",
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
    modeled={f"nav2_costmap_2d::{name}": name for name in ("KeepoutFilter", "SpeedFilter")},
    foreign=_classes("nav2_costmap_2d", "BinaryFilter", "InflationLayer"),
)

ROTATION_SHIM: Final = "nav2_rotation_shim_controller::RotationShimController"
"""A plug-in of the kind controller that has another, `primary_controller`, inside."""

WAIT_AT_WAYPOINT: Final = "nav2_waypoint_follower::WaitAtWaypoint"

FOREIGN_CRITICS: Final[Mapping[str, tuple[str, ...]]] = {
    "MPPI": ("PathAlignLegacyCritic",),
    "DWB": ("MapGrid",),
}
"""Critics of Nav2's that are known and perhaps not modeled."""


def critic_class(algorithm: str, text: str) -> str:
    """A critic as its parameters' group is called here, from its name in the list `critics`."""
    name = class_name(text).rpartition("::")[2]
    return name.removesuffix("Critic") if algorithm == "DWB" else name
