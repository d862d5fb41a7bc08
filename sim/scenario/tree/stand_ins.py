"""Actions with nothing left to do, because the simulator replaces ROS and Gazebo."""

import math
import re
from collections.abc import Mapping
from typing import Any, Final

from py_trees.common import Status

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.scenario.tree.action import Action, ActionFactory, ActionSituation
from vastflow.sim.scenario.tree.helpers import Helper

SIMULATOR_PROCESSES: Final = (
    *("gz", "gz sim", "gzserver", "gzclient", "ruby", "nav2", "nav2_container", "component_container_isolated"),
    *("controller_server", "planner_server", "bt_navigator", "behavior_server", "waypoint_follower"),
    *("lifecycle_manager", "map_server", "amcl", "robot_state_publisher"),
)
"""Programs that run on a ROS machine while Nav2 drives a robot in Gazebo."""


class AlreadyDone(Helper):
    """Succeeds at once and says in the log what stands for it."""

    stands = ""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        self.message = self.stands
        self.situation.log(self.stands)
        return True


class RunsOn(AlreadyDone):
    """Runs until the scenario ends and says in the log what stands for it."""

    goes_along = True

    def update(self) -> Status:
        return Status.RUNNING

    def wakes_s(self) -> float:
        return math.inf


class RosLaunch(RunsOn):
    """Runs until the end, as a launch does; Nav2 and the simulator were there before the first tick."""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        what = f"{arguments.get('package_name', '')} {arguments.get('launch_file', '')}".strip()
        self.stands = f"ros_launch {what}: vastflow's simulator and navigation stack run in its place"
        self._runs = bool(arguments.get("wait_for_shutdown", True))
        return super().act(arguments)

    def update(self) -> Status:
        return Status.RUNNING if self._runs else Status.SUCCESS


class BagRecord(AlreadyDone):
    stands = "bag_record: the run's recording holds what vastflow's simulator knows"


class CaptureScreen(RunsOn):
    stands = "capture_screen: there is no screen; `vastflow replay` draws the run afterwards"


class GenerateGazeboWorld(AlreadyDone):
    stands = "generate_gazebo_world: the simulator's world is the configuration's map or floor plan"


class WaitForSim(AlreadyDone):
    stands = "wait_for_sim: the simulator runs"


class CheckSimulatorProcess(Action):
    """Programs that the simulator stands for are running as long as it does; any other is looked for by `other`."""

    def __init__(self, situation: ActionSituation, other: ActionFactory | None = None) -> None:
        self._other = None if other is None else other(situation)
        self._found = False

    def enter(self, arguments: Mapping[str, Any]) -> None:
        name = str(arguments["process_name"])
        self._found = _is_simulators(name, bool(arguments.get("regex", False)))
        self.message = f"the simulator stands for {name}" if self._found else f"no process {name} is running"
        if self._other is not None and not self._found:
            self._other.enter(arguments)

    def update(self) -> Status:
        if self._found or self._other is None:
            return Status.SUCCESS if self._found else Status.FAILURE
        status = self._other.update()
        self.message = self._other.message
        return status


def stand_ins(others: Mapping[str, ActionFactory]) -> dict[str, ActionFactory]:
    """Return the actions with nothing left to do by their names in a file.

    Args:
        others: Other actions of the run; an immediate `check_process_running` among them looks for programs of the run's own.
    """
    check = others.get("check_process_running")
    return {
        "ros_launch": RosLaunch,
        "bag_record": BagRecord,
        "capture_screen": CaptureScreen,
        "capture_window": CaptureScreen,
        "floorplan_generator.generate_gazebo_world": GenerateGazeboWorld,
        "wait_for_sim": WaitForSim,
        "check_process_running": lambda situation: CheckSimulatorProcess(situation, check),
    }


def _is_simulators(name: str, is_regex: bool) -> bool:
    """True if a name or pattern means a program that the simulator replaces."""
    if not is_regex:
        return name in SIMULATOR_PROCESSES or name.startswith("nav2_")
    try:
        return any(re.search(name, process) for process in SIMULATOR_PROCESSES)
    except re.error as error:
        raise ScenarioError(f"{name!r} is no regular expression: {error}") from None
