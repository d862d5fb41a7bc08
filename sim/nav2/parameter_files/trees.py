"""Behavior trees that a parameter file names: Nav2's own, or a user's, which is not there to be read."""

from typing import Final

from vastflow.sim.model.digest import Value
from vastflow.sim.nav2.parameter_files.document import ParameterDocument

NAVIGATOR: Final = "bt_navigator"
"""The node that runs them. It is not modeled; its names say the release, too."""

_TREES: Final = ("default_nav_to_pose_bt_xml", "default_nav_through_poses_bt_xml", "default_bt_xml_filename")
_OF_NAV2: Final = frozenset(
    {
        "follow_point",
        "odometry_calibration",
        "nav_to_pose_with_consistent_replanning_and_if_path_becomes_invalid",
        "navigate_on_route_graph_w_recovery",
        "navigate_through_poses_w_replanning_and_recovery",
        "navigate_to_pose_w_bounds_check",
        "navigate_to_pose_w_replanning_and_recovery",
        "navigate_to_pose_w_replanning_goal_patience_and_recovery",
        "navigate_w_recovery_and_replanning_only_if_path_becomes_invalid",
        "navigate_w_replanning_and_recovery",
        "navigate_w_replanning_distance",
        "navigate_w_replanning_only_if_goal_is_updated",
        "navigate_w_replanning_only_if_path_becomes_invalid",
        "navigate_w_replanning_speed",
        "navigate_w_replanning_time",
        "navigate_w_routing_global_planning_and_control_w_recovery",
    }
)
"""Nav2's trees, of Foxy to Lyrical. Those of Jazzy and before name no checker; all name the controller FollowPath and the planner GridBased."""


def is_users_tree(name: str, value: Value) -> bool:
    """Whether the node names a tree that is none of Nav2's, whatever its folder."""
    if name not in _TREES or not isinstance(value, str) or not value:
        return False
    return value.rpartition("/")[2].removesuffix(".xml") not in _OF_NAV2


def users_tree(document: ParameterDocument) -> str:
    """Return the user's tree that a document names; empty if missions run Nav2's."""
    node = document.node(NAVIGATOR) or ()
    named = ((name, document.values.get((*node, name))) for name in _TREES)
    return next((str(value) for name, value in named if is_users_tree(name, value)), "")
