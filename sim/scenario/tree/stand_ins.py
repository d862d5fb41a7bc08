"""Actions of the ROS machine that have nothing left to do here, because the simulator stands for ROS and Gazebo."""

import math
import re
from collections.abc import Mapping
from typing import Any, Final

from py_trees.common import Status

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.scenario.tree.action import Action, ActionFactory, ActionSituation
from vastflow.sim.scenario.tree.helpers import Immediate

SIMULATOR_PROCESSES: Final = (
    "gz",
    "gz sim",
    "gzserver",
    "gzclient",
    "ruby",
    "nav2",
    "nav2_container",
    "component_container_isolated",
    "controller_server",
    "planner_server",
    "bt_navigator",
    "behavior_server",
    "waypoint_follower",
    "lifecycle_manager",
    "map_server",
    "amcl",
    "robot_state_publisher",
)
"""Programs that run on a ROS machine while Nav2 drives a robot in Gazebo."""


class AlreadyDone(Immediate):
    """Succeeds at once and says in the log what stands for it.

    Attributes:
        stands: What vastflow has instead.
    """

    stands = ""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        self.message = self.stands
        self.situation.log(self.stands)
        return True


class RunsOn(Action):
    """Runs until the scenario ends and says in the log what stands for it."""

    goes_along = True
    stands = ""

    def __init__(self, situation: ActionSituation) -> None:
        self.situation = situation

    def enter(self, arguments: Mapping[str, Any]) -> None:
        self.message = self.stands
        self.situation.log(self.stands)

    def update(self) -> Status:
        return Status.RUNNING

    def wakes_s(self) -> float:
        return math.inf


class RosLaunch(RunsOn):
    """Launching Nav2 and the simulator is what vastflow did before the first tick; a launch runs on until the end."""

    _status = Status.RUNNING

    def enter(self, arguments: Mapping[str, Any]) -> None:
        what = f"{arguments.get('package_name', '')} {arguments.get('launch_file', '')}".strip()
        self.message = f"ros_launch {what}: vastflow's simulator and navigation stack run in its place"
        self.situation.log(self.message)
        # One that is not waited for succeeds at once, as it does where there is something to launch.
        self._status = Status.RUNNING if arguments.get("wait_for_shutdown", True) else Status.SUCCESS

    def update(self) -> Status:
        return self._status


class BagRecord(AlreadyDone):
    """Every run is recorded from its first tick to its end, asked or not, so what is asked for is being recorded."""

    stands = "bag_record: the run's recording holds what vastflow's simulator knows"


class CaptureScreen(RunsOn):
    """There is no screen, so nothing is captured; a capture runs until the scenario ends and never fails one."""

    stands = "capture_screen: there is no screen; `vastflow replay` draws the run afterwards"


class GenerateGazeboWorld(AlreadyDone):
    """The world was made from the configuration's map or floor plan before the run; Gazebo's file of it is not needed."""

    stands = "generate_gazebo_world: the simulator's world is the configuration's map or floor plan"


class WaitForSim(AlreadyDone):
    """The simulator that ticks the scenario is there by that very fact."""

    stands = "wait_for_sim: the simulator runs"


class CheckSimulatorProcess(Action):
    """Programs that the simulator stands for are running as long as it does; any other is looked for by `other`."""

    def __init__(self, situation: ActionSituation, other: ActionFactory | None = None) -> None:
        self._other = None if other is None else other(situation)
        self._asks_other = False
        self._status = Status.FAILURE

    def enter(self, arguments: Mapping[str, Any]) -> None:
        name = str(arguments["process_name"])
        found = _is_simulators(name, bool(arguments.get("regex", False)))
        self._asks_other = not found and self._other is not None
        self._status = Status.SUCCESS if found else Status.FAILURE
        self.message = f"the simulator stands for {name}" if found else f"no process {name} is running"
        if self._asks_other and self._other is not None:
            self._other.enter(arguments)

    def update(self) -> Status:
        if self._asks_other and self._other is not None:
            self._status = self._other.update()
            self.message = self._other.message
        return self._status

    def cancel(self) -> None:
        if self._asks_other and self._other is not None:
            self._other.cancel()

    def shutdown(self) -> None:
        if self._other is not None:
            self._other.shutdown()


def stand_ins(others: Mapping[str, ActionFactory]) -> dict[str, ActionFactory]:
    """Actions that are honest no-ops here, by their names in a file.

    Args:
        others: What else the run can do: its `check_process_running`, if any, looks for programs of its own.
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
    """Whether a name or pattern means a program that the simulator stands for."""
    if not is_regex:
        return name in SIMULATOR_PROCESSES or name.startswith("nav2_")
    try:
        pattern = re.compile(name)
    except re.error as error:
        raise ScenarioError(f"{name!r} is no regular expression: {error}") from None
    return any(pattern.search(process) for process in SIMULATOR_PROCESSES)
