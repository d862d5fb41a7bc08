"""Actions of `osc.nav2` and `osc.ros` on the simulated robot."""

import functools
import math
from collections.abc import Mapping
from typing import Any, Final

from py_trees.common import Status

from vastflow.sim.loop.simulation import COLUMNS_OF, Order, Simulation
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.pose import pose_of
from vastflow.sim.model.scenario import Mission, MissionKind
from vastflow.sim.scenario.tree.action import ActionSituation, Immediate, WorldAction, WorldFactory

ALWAYS_RECORDED: Final = ("/tf", "/tf_static", "/odom", "/map")
"""Topics whose content is in every recording, or beside it in the campaign directory."""


class InitNav2(WorldAction):
    """`init_nav2`: gives AMCL its initial pose and waits for the first pose it publishes (Nav2 is up from the start).

    With `use_initial_pose: false` or `wait_for_initial_pose: true` somebody else gives it.
    """

    def enter(self, arguments: Mapping[str, Any]) -> None:
        if arguments.get("use_initial_pose", True) and not arguments.get("wait_for_initial_pose", False):
            self.simulation.localize(pose_of(arguments["initial_pose"], "initial_pose"))

    def update(self) -> Status:
        self.message = "" if self.simulation.localized else "waiting for AMCL's first pose"
        return Status.SUCCESS if self.simulation.localized else Status.RUNNING


class Navigate(WorldAction):
    """`nav_to_pose`, `nav_through_poses`, `follow_waypoints`: a goal of Nav2's action server, cancelled with its branch.

    A waypoint that was left out fails `follow_waypoints` at the end of the round, unless it may be missed.
    """

    def __init__(self, kind: MissionKind, simulation: Simulation, situation: ActionSituation) -> None:
        super().__init__(simulation, situation)
        self._kind: MissionKind = kind
        self._order: Order | None = None

    def enter(self, arguments: Mapping[str, Any]) -> None:
        goals = [arguments["goal_pose"]] if self._kind == "navigate_to_pose" else arguments["goal_poses"]
        loops = int(arguments.get("loop_count") or 0) if self._kind == "follow_waypoints" else 0
        self._on_acceptance = bool(arguments.get("success_on_acceptance", False))
        self._may_miss = bool(arguments.get("allow_missed_waypoints", False))
        self.error_code = 0
        stops = tuple(pose_of(goal, f"goal {k}") for k, goal in enumerate(goals, 1))
        if not stops:
            raise ScenarioError("expected one goal or more, got none")
        self._order = None
        if self.simulation.placed:
            self._order = self.simulation.order(Mission(self._kind, stops, loops))

    def update(self) -> Status:
        if self._order is None:
            self.message = "Nav2 takes no goal before the robot was told where it is; init_nav2 first"
            return Status.FAILURE
        if self._order.running:
            self.message = "on the way"
            return Status.SUCCESS if self._on_acceptance else Status.RUNNING
        self.message, self.error_code = self._order.message, self._order.error_code
        succeeded = self._order.succeeded
        if succeeded and self._order.missed:
            self.message = f"{self._order.missed} of the waypoints could not be reached"
            succeeded = self._may_miss
        return Status.SUCCESS if succeeded else Status.FAILURE

    def cancel(self) -> None:
        if self._order is not None:
            self._order.cancel()

    def wakes_s(self) -> float:
        return math.inf


class OdometryDistance(WorldAction):
    """`odometry_distance_traveled`: until the wheels have counted so many meters since it began."""

    def enter(self, arguments: Mapping[str, Any]) -> None:
        self._wanted_m, self._driven_m = float(arguments["distance"]), 0.0
        self._last = self.simulation.odometry

    def update(self) -> Status:
        here = self.simulation.odometry
        self._driven_m += math.hypot(here.x_m - self._last.x_m, here.y_m - self._last.y_m)
        self._last = here
        self.message = f"{self._driven_m:.2f} of {self._wanted_m:.2f} m"
        return Status.SUCCESS if self._driven_m >= self._wanted_m else Status.RUNNING


class BagRecord(WorldAction, Immediate):
    """`bag_record`: succeeds at once, for the recording has begun with the run, and ends with it.

    Logs which topics recordings do not have. What the recording keeps is known before the run
    (`vastflow.sim.reading.script.Script.topics`): runs of a scenario have the same columns, whether they come to this action or not.
    The true pose, the estimate and AMCL's updates are always kept: what judges a run needs them.
    """

    def act(self, arguments: Mapping[str, Any]) -> bool:
        for topic in arguments["topics"]:
            if topic not in COLUMNS_OF and topic not in ALWAYS_RECORDED:
                self.situation.log(f"bag_record: recordings hold no {topic}; a replay shows costmaps, plans and scans")
        return True


NAVIGATION: Final[Mapping[str, WorldFactory]] = {
    "differential_drive_robot.init_nav2": InitNav2,
    "differential_drive_robot.nav_to_pose": functools.partial(Navigate, "navigate_to_pose"),
    "differential_drive_robot.nav_through_poses": functools.partial(Navigate, "navigate_through_poses"),
    "differential_drive_robot.follow_waypoints": functools.partial(Navigate, "follow_waypoints"),
    "differential_drive_robot.odometry_distance_traveled": OdometryDistance,
    "bag_record": BagRecord,
}
"""By their names in a file."""
