"""The simulated world as the actions of a scenario see it: a robot, what stands about, and what goes on."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.model.blocks import Columns
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import GridFrame, Pose
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.state import ABORTED, RUNNING, SUCCEEDED, Stack

REASONS: Final[Mapping[int, str]] = {
    103: "the plan led out of the local costmap (INVALID_PATH)",
    104: "the controller found no valid command (PATIENCE_EXCEEDED)",
    105: "no progress (FAILED_TO_MAKE_PROGRESS)",
    203: "the robot is outside the map (START_OUTSIDE_MAP)",
    204: "the goal is outside the map (GOAL_OUTSIDE_MAP)",
    205: "the robot stands where no path can begin (START_OCCUPIED)",
    206: "the goal lies in an obstacle (GOAL_OCCUPIED)",
    207: "the planner searched too long (TIMEOUT)",
    208: "no path to the goal (NO_VALID_PATH)",
    303: "the robot is outside the map (START_OUTSIDE_MAP)",
    304: "a goal is outside the map (GOAL_OUTSIDE_MAP)",
    305: "the robot stands where no path can begin (START_OCCUPIED)",
    306: "a goal lies in an obstacle (GOAL_OCCUPIED)",
    307: "the planner searched too long (TIMEOUT)",
    308: "no path through the goals (NO_VALID_PATH)",
}
"""Nav2's error codes, in words."""


COLUMNS_OF: Final[Mapping[str, str]] = {
    "/amcl_pose": "covariance_",
    "/cmd_vel": "sent_",
    "/cmd_vel_nav": "command_",
    "/cmd_vel_smoothed": "command_",
}
"""Topic to how the names of the columns with its content begin. A scenario's `bag_record` may leave these out; the others
are what judges a run."""


class Simulation:
    """A closed loop under the hands of a scenario.

    Attributes:
        spawned: Obstacles that the scenario put into the world, in order.
        sent_s: Simulated time of the robot's first mission; None before.
        published: Topic to the messages that the scenario published on it, in order.
        told: What the scenario had Nav2 do, as its nodes log it: node and text, in order.
    """

    def __init__(self, loop: ClosedLoop) -> None:
        self.spawned: list[Obstacle] = []
        self.sent_s: float | None = None
        self.published: dict[str, list[Any]] = {}
        self.told: list[tuple[str, str]] = []
        self._loop = loop
        self._orders = 0

    @property
    def placed(self) -> bool:
        """Whether AMCL was ever given an initial pose."""
        return self._loop.placed

    @property
    def localized(self) -> bool:
        """Whether AMCL has given a pose."""
        return self._loop.localized

    @property
    def stack(self) -> Stack:
        """What the navigation stack has at this moment, to be read: positions in `frame`."""
        return self._loop.stack

    @property
    def frame(self) -> GridFrame:
        """The frame of the map's grid."""
        return self._loop.frame

    @property
    def status(self) -> int:
        """What became of the robot's mission, see `vastflow.sim.nav2.navigator.state`."""
        return self._loop.status

    @property
    def error_code(self) -> int:
        """Nav2's code of a mission that was given up, else 0."""
        return self._loop.error_code

    @property
    def estimate(self) -> Pose:
        """Where the robot takes itself to be."""
        return self._loop.estimate

    @property
    def true_pose(self) -> Pose:
        """Where the robot is."""
        return self._loop.true_pose

    @property
    def odometry(self) -> Pose:
        """Where its wheels say it is, in its odometry's frame."""
        m = self._loop.stack.m[0]
        return Pose(float(m["odom_x"]), float(m["odom_y"]), float(m["odom_yaw"]))

    def localize(self, pose: Pose) -> None:
        """Give AMCL an initial pose."""
        self.told.append(("amcl", f"Setting pose: {pose.x_m:.3f} {pose.y_m:.3f} {pose.yaw_rad:.3f}"))
        self._loop.localize(pose)

    def command(self, speed_mps: float, yaw_rate_radps: float, lateral_mps: float = 0.0) -> None:
        """Drive as told, unless the controller commands; ends with the velocity smoother's timeout."""
        self._loop.command(speed_mps, yaw_rate_radps, lateral_mps)

    def order(self, mission: Mission) -> "Order":
        """Send the robot on a mission; it drops the one it has."""
        self._orders += 1
        if self.sent_s is None:
            self.sent_s = self._loop.now_s
        here, goal = self.estimate, mission.goals[-1]
        if mission.kind == "follow_waypoints":
            self.told.append(
                ("waypoint_follower", f"Received follow waypoint request with {len(mission.goals)} waypoints.")
            )
        else:
            through = "" if mission.kind == "navigate_to_pose" else f"through {len(mission.goals)} poses "
            begun = f"({here.x_m:.2f}, {here.y_m:.2f}) {through}to ({goal.x_m:.2f}, {goal.y_m:.2f})"
            self.told.append(("bt_navigator", f"Begin navigating from current location {begun}"))
        self._loop.navigate(mission)
        return Order(self._loop, self._orders, lambda: self._orders)

    def stands(self, name: str) -> bool:
        """Whether something of this name stands in the world."""
        return self._loop.standing(name) is not None

    def spawn(self, obstacle: Obstacle, pushable: bool) -> None:
        """Put an obstacle into the world."""
        self.spawned.append(obstacle)
        self._loop.spawn(obstacle, pushable)

    def delete(self, name: str) -> bool:
        """Take what has this name out of the world; whether there was such a thing."""
        index = self._loop.standing(name)
        if index is not None:
            self._loop.delete(index)
        return index is not None


class Order:
    """A mission given to the robot, and what becomes of it."""

    def __init__(self, loop: ClosedLoop, number: int, newest: Callable[[], int]) -> None:
        self._loop = loop
        self._number = number
        self._newest = newest
        self._recoveries_before = loop.recoveries
        self._missed_before = loop.missed

    @property
    def current(self) -> bool:
        """Whether no other mission was given since."""
        return self._newest() == self._number

    @property
    def running(self) -> bool:
        """Whether the robot is still at it."""
        return self.current and self._loop.status == RUNNING

    @property
    def succeeded(self) -> bool:
        """Whether it ended well."""
        return self.current and self._loop.status == SUCCEEDED

    @property
    def missed(self) -> int:
        """Stops that were left out because they could not be reached."""
        return self._loop.missed - self._missed_before if self.current else 0

    @property
    def error_code(self) -> int:
        """Nav2's code of a mission that was given up, else 0."""
        return self._loop.error_code if self.current and self._loop.status == ABORTED else 0

    @property
    def message(self) -> str:
        """Why it did not end well."""
        if not self.current:
            return "another goal took its place"
        return told(self._loop, self._recoveries_before) if self.error_code else ""

    def cancel(self) -> None:
        """Take it back, unless another took its place."""
        if self.current:
            self._loop.cancel()


def told(loop: ClosedLoop, recoveries_before: int = 0) -> str:
    """Why a mission was given up, in words; the recoveries of missions before it are not its own."""
    return f"{REASONS[loop.error_code]}, after {loop.recoveries - recoveries_before} recoveries"


def recorded(columns: Columns, topics: Sequence[str] | None) -> Columns:
    """Those of a recording's columns that a scenario's topics ask for; all of them for None."""
    if topics is None:
        return columns
    left_out = set(COLUMNS_OF.values()) - {COLUMNS_OF[topic] for topic in topics if topic in COLUMNS_OF}
    return {name: column for name, column in columns.items() if not name.startswith(tuple(left_out))}


def distance_m(a: Pose, b: Pose) -> float:
    """Between the positions of two poses."""
    return math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)
