"""Actions of `osc.nav2` and `osc.ros` on the simulated robot."""

import math
from collections.abc import Mapping
from typing import Any, Final

from py_trees.common import Status

from vastflow.sim.loop.simulation import COLUMNS_OF, Order, Simulation
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.pose import Pose, pose_of
from vastflow.sim.model.scenario import Mission, MissionKind
from vastflow.sim.scenario.tree.action import Action, WorldAction
from vastflow.sim.scenario.tree.helpers import Helper

ALWAYS_RECORDED: Final = ("/tf", "/tf_static", "/odom", "/map")
"""Topics whose content is in every recording, or beside it in the campaign directory."""


class InitNav2(Action):
    """`init_nav2`: gives AMCL its initial pose and waits for the first pose it publishes (Nav2 is up from the start).

    With `use_initial_pose: false` or `wait_for_initial_pose: true` somebody else gives it.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation

    def enter(self, arguments: Mapping[str, Any]) -> None:
        if arguments.get("use_initial_pose", True) and not arguments.get("wait_for_initial_pose", False):
            self._simulation.localize(pose_of(arguments["initial_pose"], "initial_pose"))

    def update(self) -> Status:
        self.message = "" if self._simulation.localized else "waiting for AMCL's first pose"
        return Status.SUCCESS if self._simulation.localized else Status.RUNNING


class Navigate(Action):
    """`nav_to_pose`, `nav_through_poses`, `follow_waypoints`: a goal of Nav2's action server, cancelled with its branch.

    A waypoint that was left out fails `follow_waypoints` at the end of the round, unless it may be missed.
    """

    def __init__(self, simulation: Simulation, kind: MissionKind) -> None:
        self._simulation = simulation
        self._kind: MissionKind = kind
        self._order: Order | None = None
        self._refusal = ""
        self._on_acceptance = self._may_miss = False

    def enter(self, arguments: Mapping[str, Any]) -> None:
        goals = [arguments["goal_pose"]] if self._kind == "navigate_to_pose" else arguments["goal_poses"]
        loops = int(arguments.get("loop_count") or 0) if self._kind == "follow_waypoints" else 0
        self._on_acceptance = bool(arguments.get("success_on_acceptance", False))
        self._may_miss = bool(arguments.get("allow_missed_waypoints", False))
        self.error_code = 0
        stops = tuple(pose_of(goal, f"goal {k}") for k, goal in enumerate(goals, 1))
        if not stops:
            raise ScenarioError("expected one goal or more, got none")
        self._refusal = ""
        if not self._simulation.placed:
            self._refusal = "Nav2 takes no goal before the robot was told where it is; init_nav2 first"
        self._order = None if self._refusal else self._simulation.order(Mission(self._kind, stops, loops))

    def update(self) -> Status:
        if self._order is None:
            self.message = self._refusal
            return Status.FAILURE
        if self._order.running:
            self.message = "on the way"
            return Status.SUCCESS if self._on_acceptance else Status.RUNNING
        self.message, self.error_code = self._order.message, self._order.error_code
        if self._order.succeeded and self._order.missed:
            self.message = f"{self._order.missed} of the waypoints could not be reached"
            return Status.SUCCESS if self._may_miss else Status.FAILURE
        return Status.SUCCESS if self._order.succeeded else Status.FAILURE

    def cancel(self) -> None:
        if self._order is not None:
            self._order.cancel()

    def wakes_s(self) -> float:
        return math.inf


class OdometryDistance(Action):
    """`odometry_distance_traveled`: until the wheels have counted so many meters since it began."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._wanted_m = self._driven_m = 0.0
        self._last = Pose(0.0, 0.0)

    def enter(self, arguments: Mapping[str, Any]) -> None:
        self._wanted_m, self._driven_m = float(arguments["distance"]), 0.0
        self._last = self._simulation.odometry

    def update(self) -> Status:
        here = self._simulation.odometry
        self._driven_m += math.hypot(here.x_m - self._last.x_m, here.y_m - self._last.y_m)
        self._last = here
        self.message = f"{self._driven_m:.2f} of {self._wanted_m:.2f} m"
        return Status.SUCCESS if self._driven_m >= self._wanted_m else Status.RUNNING


class BagRecord(Helper):
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


def _navigate(kind: MissionKind) -> WorldAction:
    return lambda simulation, _: Navigate(simulation, kind)


_OF_THE_ROBOT: Final[Mapping[str, WorldAction]] = {
    "init_nav2": lambda simulation, _: InitNav2(simulation),
    "nav_to_pose": _navigate("navigate_to_pose"),
    "nav_through_poses": _navigate("navigate_through_poses"),
    "follow_waypoints": _navigate("follow_waypoints"),
    "odometry_distance_traveled": lambda simulation, _: OdometryDistance(simulation),
}

NAVIGATION: Final[Mapping[str, WorldAction]] = {
    **{f"differential_drive_robot.{name}": action for name, action in _OF_THE_ROBOT.items()},
    "bag_record": lambda _, situation: BagRecord(situation),
}
"""By their names in a file."""
