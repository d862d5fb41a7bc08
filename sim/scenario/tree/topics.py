"""Actions of `osc.ros` on the topics, nodes and transforms of the simulated robot."""

import functools
import math
import operator
from collections.abc import Iterator, Mapping
from typing import Any, Final

from py_trees.common import Status

from vastflow.sim.loop.event_words import REASONS
from vastflow.sim.loop.simulation import Simulation
from vastflow.sim.model.elementary import hypot
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.state import ABORTED, EVENT_KINDS, RECOVERIES, RUNNING, SUCCEEDED
from vastflow.sim.scenario.tree.action import ActionSituation, WorldAction, WorldFactory
from vastflow.sim.scenario.tree.messages import (
    count,
    literal,
    member_of,
    message,
    pose_in,
    velocity_in,
    with_members,
)
from vastflow.sim.scenario.tree.support import TOPICS, TRUE_FRAME, absolute, lacking


def pose_between(simulation: Simulation, parent: str, robot: str) -> Pose | None:
    """Return the pose of the robot's frame in another frame, or None while it is unknown.

    In the map's frame that is where Nav2 takes the robot to be, and for a frame of the truth where it is.
    """
    if robot.endswith(TRUE_FRAME):
        return simulation.true_pose
    if parent == "odom":
        return simulation.odometry
    return simulation.estimate if simulation.localized else None


Line = tuple[str, str]
"""Node and text."""

_RECOVERED: Final[Mapping[str, Line]] = {
    "clear local costmap": ("local_costmap.local_costmap", "Received request to clear entirely the local_costmap"),
    "clear global costmap": ("global_costmap.global_costmap", "Received request to clear entirely the global_costmap"),
    "clear both costmaps": ("global_costmap.global_costmap", "Received request to clear entirely the global_costmap"),
    "spin": ("behavior_server", "Running spin"),
    "wait": ("behavior_server", "Running wait"),
    "back up": ("behavior_server", "Running backup"),
}

_HAPPENED: Final[Mapping[str, Line]] = {
    "goal_reached": ("controller_server", "Reached the goal!"),
    "goal_missed": ("waypoint_follower", "Failed to process waypoint, moving to next."),
    "plan_failed": ("planner_server", "GridBased: failed to create plan"),
    "control_failed": ("controller_server", "Controller failed to follow the path"),
    "stopped_by_monitor": ("collision_monitor", "Robot to stop due to FootprintApproach polygon"),
}


class StackLog:
    """The stack's log from here on."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._told = len(simulation.told)
        self._events = self._counted()
        self._status = simulation.status

    def new(self) -> Iterator[Line]:
        """Yield all lines since the last call, or since the start."""
        simulation = self._simulation
        told, self._told = simulation.told[self._told :], len(simulation.told)
        rows = simulation.stack.m[0]["event_rows"][self._events : self._counted()]
        self._events = self._counted()
        before, self._status = self._status, simulation.status
        yield from told
        for _, kind, _, _, what, _ in rows.tolist():
            name = EVENT_KINDS[int(kind)]
            yield _RECOVERED[RECOVERIES[int(what)]] if name == "recovery" else _HAPPENED[name]
        if simulation.status == before or (before != RUNNING and not told):
            return
        if simulation.status == SUCCEEDED:
            yield "bt_navigator", "Goal succeeded"
        elif simulation.status == ABORTED:
            yield "bt_navigator", f"Goal failed: {REASONS[simulation.error_code]}"

    def _counted(self) -> int:
        return int(self._simulation.stack.m[0]["events"])


class RosAction(WorldAction):
    """An action on a part of ROS; it does not begin if the part is not simulated."""

    def __init__(self, name: str, simulation: Simulation, situation: ActionSituation) -> None:
        super().__init__(simulation, situation)
        self._name = name

    def enter(self, arguments: Mapping[str, Any]) -> None:
        if fault := lacking(self._name, arguments):
            raise ScenarioError(fault)
        self.begin(arguments)

    def begin(self, arguments: Mapping[str, Any]) -> None:
        """Begin with complete arguments."""

    def update(self) -> Status:
        return Status.SUCCESS


class Listening(RosAction):
    """An action on the messages of one topic, counted from now on; latched ones are still to come."""

    def begin(self, arguments: Mapping[str, Any]) -> None:
        self._topic = absolute(str(arguments["topic_name"]))
        self._seen = 0 if TOPICS[self._topic].rhythm == "latched" else count(self.simulation, self._topic)

    def heard(self) -> Any:
        """Return the message since the last call, or None."""
        number = count(self.simulation, self._topic)
        if number in (0, self._seen):
            return None
        self._seen = number
        return message(self.simulation, self._topic)


class WaitForData(Listening):
    """`wait_for_data`: until a message comes on a topic."""

    def update(self) -> Status:
        came = self.heard() is not None
        self.message = "" if came else f"waiting for data on {self._topic}"
        return Status.SUCCESS if came else Status.RUNNING


class CheckData(Listening):
    """`check_data`: wait until a comparison of a message, or of its member, with a value is true."""

    def begin(self, arguments: Mapping[str, Any]) -> None:
        super().begin(arguments)
        self._arguments = arguments
        given, known = arguments["expected_value"], message(self.simulation, self._topic)
        self._expected = literal(given) if arguments["eval_expected_value"] else given
        self._known = None if arguments["wait_for_first_message"] else known
        self._lacks = bool(arguments["fail_if_no_data"]) and known is None

    def update(self) -> Status:
        if self._lacks:
            self.message = f"there is no message on {self._topic} yet"
            return Status.FAILURE
        known, self._known = self._known, None
        found = known if known is not None else self.heard()
        if found is None:
            return Status.RUNNING
        member, sign = str(self._arguments["member_name"]), self._arguments["comparison_operator"].member
        value = member_of(found, member)
        try:
            holds = bool(getattr(operator, sign)(value, with_members(value, self._expected)))
        except TypeError:
            raise ScenarioError(f"{value!r} and {self._expected!r} can't be compared by {sign}") from None
        whose = f"{member} of {self._topic}" if member else self._topic
        self.message = f"{whose} is {value!r:.80}, {sign} {self._expected!r}: {str(holds).lower()}"
        if holds:
            return Status.SUCCESS
        return Status.FAILURE if self._arguments["fail_if_bad_comparison"] else Status.RUNNING


class TopicMonitor(Listening):
    """`topic_monitor`: succeeds at once, and keeps the last message, or a member of it, in a variable."""

    def begin(self, arguments: Mapping[str, Any]) -> None:
        super().begin(arguments)
        self._variable = str(arguments["target_variable"])
        self._member = str(arguments["member_name"])
        self.situation.monitors.append(self._look)

    def _look(self) -> None:
        if (found := self.heard()) is not None:
            self.situation.variables[self._variable] = member_of(found, self._member)


class TopicPublish(RosAction):
    """`topic_publish`: sends the robot a goal, an initial pose, or a velocity."""

    def begin(self, arguments: Mapping[str, Any]) -> None:
        topic, value = absolute(str(arguments["topic_name"])), arguments["value"]
        content = literal(value) if isinstance(value, str) else value
        if topic == "/goal_pose":
            self.simulation.order(Mission("navigate_to_pose", (pose_in(content),)))
        elif topic == "/initialpose":
            self.simulation.localize(pose_in(content))
        else:
            self.simulation.command(*velocity_in(content))
        self.simulation.published.setdefault(topic, []).append(content)
        self.message = f"published on {topic}"


class Available(RosAction):
    """`wait_for_topics`, `wait_for_nodes`, and the like: simulated ones exist from the start."""


class LogCheck(RosAction):
    """`log_check`: until a node of the navigation stack logs one of some texts."""

    def begin(self, arguments: Mapping[str, Any]) -> None:
        self._values = [str(value) for value in arguments["values"]]
        self._node = str(arguments["module_name"]).removeprefix("/")
        self._log = StackLog(self.simulation)
        self.message = f"waiting for {' or '.join(map(repr, self._values))}"

    def update(self) -> Status:
        for node, text in self._log.new():
            if self._node in ("", node) and any(value in text for value in self._values):
                self.message = f"{node}: {text}"
                return Status.SUCCESS
        return Status.RUNNING


class TfMoving(RosAction):
    """`assert_tf_moving`: fails once the robot's frame stood still for a time; it never succeeds."""

    goes_along = True

    def begin(self, arguments: Mapping[str, Any]) -> None:
        self._frames = str(arguments["parent_frame_id"]), str(arguments["frame_id"])
        self._timeout_s = float(arguments["timeout"])
        self._least = float(arguments["threshold_translation"]), float(arguments["threshold_rotation"])
        self._waits = bool(arguments["wait_for_first_transform"])
        self._last: tuple[float, Pose] | None = None
        self._moved_s = self.situation.clock.now_s

    def update(self) -> Status:
        now_s = self.situation.clock.now_s
        here = pose_between(self.simulation, *self._frames)
        if here is None:
            self.message = f"there is no transform from {self._frames[0]} to {self._frames[1]} yet"
            return Status.RUNNING if self._waits else Status.FAILURE
        if self._last is None:
            self._moved_s = now_s
        elif now_s > self._last[0]:
            before, duration_s = self._last[1], now_s - self._last[0]
            speed_mps = hypot(here.x_m - before.x_m, here.y_m - before.y_m) / duration_s
            rate_radps = abs(math.remainder(here.yaw_rad - before.yaw_rad, math.tau)) / duration_s
            if speed_mps >= self._least[0] or rate_radps >= self._least[1]:
                self._moved_s = now_s
        self._last = now_s, here
        still_s = now_s - self._moved_s
        self.message = f"{self._frames[1]} has not moved for {still_s:.1f} s"
        return Status.FAILURE if still_s > self._timeout_s + 1e-9 else Status.RUNNING


class TfCloseTo(RosAction):
    """`tf_close_to`: until the robot's frame is so near to a point of the map, or of the odometry's frame."""

    def begin(self, arguments: Mapping[str, Any]) -> None:
        point = arguments["reference_point"]
        self._point = Pose(float(point["x"]), float(point["y"]))
        self._threshold_m = float(arguments["threshold"])
        self._frames = str(arguments["parent_frame_id"]), str(arguments["robot_frame_id"])

    def update(self) -> Status:
        here = pose_between(self.simulation, *self._frames)
        if here is None:
            self.message = f"there is no transform from {self._frames[0]} to {self._frames[1]} yet"
            return Status.RUNNING
        away_m = hypot(here.x_m - self._point.x_m, here.y_m - self._point.y_m)
        self.message = f"{away_m:.2f} m away"
        return Status.SUCCESS if away_m <= self._threshold_m else Status.RUNNING


_KINDS: Final[Mapping[str, type[RosAction]]] = {
    "wait_for_data": WaitForData,
    "check_data": CheckData,
    "topic_monitor": TopicMonitor,
    "topic_publish": TopicPublish,
    "wait_for_topics": Available,
    "wait_for_nodes": Available,
    "wait_for_topic_publisher": Available,
    "wait_for_topic_subscription": Available,
    "log_check": LogCheck,
    "assert_tf_moving": TfMoving,
    "differential_drive_robot.tf_close_to": TfCloseTo,
}

ROS: Final[Mapping[str, WorldFactory]] = {name: functools.partial(kind, name) for name, kind in _KINDS.items()}
"""Actions by their names in a file."""
