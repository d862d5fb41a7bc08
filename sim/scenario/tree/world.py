"""Actions of `osc.gazebo`, `osc.sim`, `osc.nav2`, and `osc.ros` that move the robot, and put things into its world."""

import functools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from py_trees.common import Status

from vastflow.sim.loop.simulation import COLUMNS_OF, Order, Simulation
from vastflow.sim.model.elementary import cos_sin, hypot
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.obstacle import obstacle_of
from vastflow.sim.model.pose import Pose, pose_of
from vastflow.sim.model.scenario import Mission, MissionKind
from vastflow.sim.scenario.tree.action import ActionSituation, Immediate, WorldAction, WorldFactory

ALWAYS_RECORDED: Final = ("/tf", "/tf_static", "/odom", "/map")
"""Topics whose content is in every recording, or beside it in the campaign directory."""

ROBOT_NAMES: Final = ("turtlebot4", "robot")
"""Names by which scenarios ask for the robot itself."""

ROBOT_MODEL: Final = "topic:"
"""Prefix of a robot's model, which comes from a topic."""


class Spawn(WorldAction, Immediate):
    """Puts entities into the world at once; entities with a mass can be pushed."""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        return self._spawn(arguments["entities"])

    def _spawn(self, entries: Sequence[Mapping[str, Any]]) -> bool:
        for k, entry in enumerate(entries):
            try:
                obstacle = obstacle_of(entry, f"entity {k + 1}")
            except ValueError as error:
                raise ScenarioError(str(error)) from None
            if self.simulation.stands(obstacle.name):
                self.message = f"{obstacle.name!r} stands there already; a name that is not in use"
                return False
            has_mass = "mass:=" in str(entry.get("xacro_arguments") or "").replace(" ", "")
            self.simulation.spawn(obstacle, has_mass)
        return True


class SpawnEntity(Spawn):
    """`spawn_entity`: one entity of a model; under another name where its own is taken and it may be renamed."""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        model = str(arguments["uri"])
        name = given = str(arguments["entity_name"]) or Path(model).stem
        number = 0
        while arguments["allow_renaming"] and self.simulation.stands(name):
            number += 1
            name = f"{given}_{number}"
        return self._spawn([{"entity_name": name, "spawn_pose": arguments["initial_pose"], "model": model}])


class SpawnActor(Spawn):
    """`osc_actor.spawn`: the actor itself, under its own name, at a pose. The robot stands in the world from the start."""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        entity = self._entity(arguments, arguments["spawn_pose"])
        if entity["entity_name"] in ROBOT_NAMES or str(entity.get("model", "")).startswith(ROBOT_MODEL):
            self.message = "the robot stands in the world from the start"
            return True
        return self._spawn([entity])

    def _entity(self, arguments: Mapping[str, Any], pose: Any) -> dict[str, Any]:
        name = str(arguments.get("entity_name") or self.situation.actor["name"])
        given = {key: arguments[key] for key in ("model", "xacro_arguments") if arguments.get(key)}
        return {"entity_name": name, "spawn_pose": pose, **given}


class SpawnRelative(SpawnActor):
    """`osc_actor.relative_spawn`: at a distance in front of the robot, with its heading."""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        robot, ahead_m = self.simulation.true_pose, float(arguments["distance"])
        c, s = cos_sin(robot.yaw_rad)
        x_m, y_m = robot.x_m + ahead_m * c, robot.y_m + ahead_m * s
        return self._spawn([self._entity(arguments, Pose(x_m, y_m, robot.yaw_rad).value())])


class Delete(WorldAction, Immediate):
    """Removes an entity from the world; fails if no entity has its name."""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        name = str(arguments.get("entity") or arguments.get("entity_name") or self.situation.actor.get("name", ""))
        there = self.simulation.delete(name)
        self.message = "" if there else f"nothing called {name!r} stands in the world"
        return there


class Exists(WorldAction):
    """`actor_exists`: until something of this name stands in the world; the robot does from the start."""

    def enter(self, arguments: Mapping[str, Any]) -> None:
        self._name = str(arguments.get("entity_name") or self.situation.actor.get("name", ""))

    def update(self) -> Status:
        there = self.simulation.stands(self._name) or self._name in ROBOT_NAMES
        self.message = "" if there else f"no {self._name!r} yet"
        return Status.SUCCESS if there else Status.RUNNING


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
        self._driven_m += hypot(here.x_m - self._last.x_m, here.y_m - self._last.y_m)
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


WORLD: Final[Mapping[str, WorldFactory]] = {
    "spawn_multiple": Spawn,
    "spawn_entity": SpawnEntity,
    "actor_exists": Exists,
    "osc_actor.spawn": SpawnActor,
    "osc_actor.relative_spawn": SpawnRelative,
    "osc_actor.delete": Delete,
    "delete_entity": Delete,
    "differential_drive_robot.init_nav2": InitNav2,
    "differential_drive_robot.nav_to_pose": functools.partial(Navigate, "navigate_to_pose"),
    "differential_drive_robot.nav_through_poses": functools.partial(Navigate, "navigate_through_poses"),
    "differential_drive_robot.follow_waypoints": functools.partial(Navigate, "follow_waypoints"),
    "differential_drive_robot.odometry_distance_traveled": OdometryDistance,
    "bag_record": BagRecord,
}
"""Actions by their names in a file."""
