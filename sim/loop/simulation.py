"""The simulated world as the actions of a scenario see it."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.loop.event_words import REASONS
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Columns
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.state import ABORTED, RUNNING, SUCCEEDED

COLUMNS_OF: Final[Mapping[str, str]] = {
    "/amcl_pose": "covariance_",
    "/cmd_vel": "sent_",
    "/cmd_vel_nav": "command_",
    "/cmd_vel_smoothed": "command_",
}
"""Topic to the prefix of its columns, which a scenario's `bag_record` may leave out; oracles need the others."""


class Simulation(ClosedLoop):
    """A closed loop driven by a scenario.

    Attributes:
        orders: Missions so far.
        published: Topic to the messages that the scenario published on it, in order.
        told: Log lines of Nav2's nodes on what the scenario had them do: node and text, in order.
    """

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.published: dict[str, list[Any]] = {}
        self.told: list[tuple[str, str]] = []
        self.orders = 0

    @property
    def odometry(self) -> Pose:
        """Pose that the wheels report, in the odometry's frame."""
        m = self.stack.m[0]
        return Pose(float(m["odom_x"]), float(m["odom_y"]), float(m["odom_yaw"]))

    def localize(self, pose: Pose) -> None:
        if not self.stack.p[0]["without_map"]:
            self.told.append(("amcl", f"Setting pose: {pose.x_m:.3f} {pose.y_m:.3f} {pose.yaw_rad:.3f}"))
        super().localize(pose)

    def order(self, mission: Mission) -> "Order":
        """Send the robot on a mission; it drops the one it has."""
        self.orders += 1
        here, goal, goals = self.estimate, mission.goals[-1], len(mission.goals)
        if mission.kind == "follow_waypoints":
            self.told.append(("waypoint_follower", f"Received follow waypoint request with {goals} waypoints."))
        else:
            through = "" if mission.kind == "navigate_to_pose" else f"through {goals} poses "
            begun = f"({here.x_m:.2f}, {here.y_m:.2f}) {through}to ({goal.x_m:.2f}, {goal.y_m:.2f})"
            self.told.append(("bt_navigator", f"Begin navigating from current location {begun}"))
        self.navigate(mission)
        return Order(self)

    def failure(self, recoveries_before: int) -> str:
        """Return why the mission was aborted; empty if it was not."""
        return told(self, recoveries_before) if self.error_code else ""

    def finish(self) -> tuple[Sequence[str], Mapping[str, float]]:
        """End the run, and return further lines for its log, and its health."""
        return (), {}

    def stands(self, name: str) -> bool:
        return self.standing(name) is not None


class Order:
    """A mission given to the robot, and its outcome."""

    def __init__(self, simulation: Simulation) -> None:
        self._loop = simulation
        self._number = simulation.orders
        self._recoveries_before = simulation.recoveries
        self._missed_before = simulation.missed

    @property
    def current(self) -> bool:
        """True if no other mission was given since."""
        return self._loop.orders == self._number

    @property
    def running(self) -> bool:
        return self.current and self._loop.status == RUNNING

    @property
    def succeeded(self) -> bool:
        """True if its goals were reached."""
        return self.current and self._loop.status == SUCCEEDED

    @property
    def missed(self) -> int:
        """Number of stops that could not be reached."""
        return self._loop.missed - self._missed_before if self.current else 0

    @property
    def error_code(self) -> int:
        """Nav2's code of an aborted mission, else 0."""
        return self._loop.error_code if self.current and self._loop.status == ABORTED else 0

    @property
    def message(self) -> str:
        """Reason for the failure; empty without one."""
        if not self.current:
            return "another goal took its place"
        return self._loop.failure(self._recoveries_before)

    def cancel(self) -> None:
        """Cancel the mission unless another replaced it."""
        if self.current:
            self._loop.cancel()


def told(loop: ClosedLoop, recoveries_before: int = 0) -> str:
    """Reason for an aborted mission in words, with its own number of recoveries."""
    return f"{REASONS[loop.error_code]}, after {loop.recoveries - recoveries_before} recoveries"


def recorded(columns: Columns, topics: Sequence[str]) -> Columns:
    """Select the columns that a scenario's topics ask for."""
    left_out = set(COLUMNS_OF.values()) - {COLUMNS_OF[topic] for topic in topics if topic in COLUMNS_OF}
    return {name: column for name, column in columns.items() if not name.startswith(tuple(left_out))}
