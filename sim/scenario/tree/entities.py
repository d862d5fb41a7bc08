"""Actions of `osc.gazebo` and `osc.sim` that spawn, delete, and await entities."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from py_trees.common import Status

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.obstacle import has_mass, obstacle_of
from vastflow.sim.model.pose import Pose
from vastflow.sim.scenario.tree.action import Immediate, WorldAction, WorldFactory

ROBOT_NAMES: Final = ("turtlebot4", "robot")
"""Names by which scenarios ask for the robot itself."""

ROBOT_MODEL: Final = "topic:"
"""How the model of a robot begins, which comes from a topic."""


class Spawn(WorldAction, Immediate):
    """Puts entities into the world at once; those with a mass can be pushed."""

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
            self.simulation.spawn(obstacle, has_mass(entry))
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
    """`osc_actor.relative_spawn`: so far ahead of where the robot is, turned as the robot is."""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        robot, ahead_m = self.simulation.true_pose, float(arguments["distance"])
        x_m = robot.x_m + ahead_m * math.cos(robot.yaw_rad)
        y_m = robot.y_m + ahead_m * math.sin(robot.yaw_rad)
        return self._spawn([self._entity(arguments, Pose(x_m, y_m, robot.yaw_rad).value())])


class Delete(WorldAction, Immediate):
    """Takes an entity out of the world; a failure where there is none of its name."""

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


ENTITIES: Final[Mapping[str, WorldFactory]] = {
    "spawn_multiple": Spawn,
    "spawn_entity": SpawnEntity,
    "actor_exists": Exists,
    "osc_actor.spawn": SpawnActor,
    "osc_actor.relative_spawn": SpawnRelative,
    "osc_actor.delete": Delete,
    "delete_entity": Delete,
}
"""By their names in a file."""
