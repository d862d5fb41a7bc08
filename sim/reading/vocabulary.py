"""Names of the actions that a scenario may use, known without the simulator that the actions move."""

from typing import Final

from vastflow.sim.scenario.programs.actions import PROCESSES
from vastflow.sim.scenario.tree.helpers import HELPERS
from vastflow.sim.scenario.tree.stand_ins import stand_ins

WORLDLY: Final = frozenset(
    {
        "assert_tf_moving",
        "check_data",
        "log_check",
        "spawn_entity",
        "spawn_multiple",
        "actor_exists",
        "topic_monitor",
        "topic_publish",
        "wait_for_data",
        "wait_for_nodes",
        "wait_for_topic_publisher",
        "wait_for_topic_subscription",
        "wait_for_topics",
        "osc_actor.spawn",
        "osc_actor.relative_spawn",
        "osc_actor.delete",
        "delete_entity",
        "differential_drive_robot.init_nav2",
        "differential_drive_robot.nav_to_pose",
        "differential_drive_robot.nav_through_poses",
        "differential_drive_robot.follow_waypoints",
        "differential_drive_robot.odometry_distance_traveled",
        "differential_drive_robot.tf_close_to",
    }
)
"""Actions that need a robot in a world."""

ACTIONS: Final = frozenset({*HELPERS, *WORLDLY, *PROCESSES, *stand_ins({})})
"""All of them."""
