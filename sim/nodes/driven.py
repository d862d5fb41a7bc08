"""A simulated robot that nodes of ROS 2 drive: world and nodes in turn, 20 times a simulated second."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from vastflow.sim.loop.simulation import Simulation
from vastflow.sim.model.elementary import cos_sin, hypot
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.nodes import HOST_LATE, MESSAGES, Nodes
from vastflow.sim.model.pose import Pose, placed
from vastflow.sim.model.rates import TICK_S, ticks_of
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.state import ABORTED, EVENT_GOAL_REACHED, MAX_EVENTS, RESTING, RUNNING, SUCCEEDED
from vastflow.sim.nodes.starting import Started
from vastflow.sim.scenario.programs.resources import waits
from vastflow.sim.world.robot_model import Lidar

STILL_MPS: Final = 0.05
"""Speed below which a robot at its goal has arrived."""
LATE_S: Final = TICK_S / 2.0
"""A paced tick that ends so long after its time is late."""
SPARE_S: Final = 30.0
"""Host time for the bridge beyond what nodes may take."""
MOST_LINES: Final = 1000


@dataclass
class Health:
    """Health of a run: what the host and the nodes did to its time.

    Attributes:
        late_s: The greatest delay of a paced tick.
        waited: Share of paced time for which a thread of nodes, bridge, or worker was ready to run and waited for a CPU, the greatest.
        missed: Lines in which nodes say that they missed their rate.
        silent: Scans of a running mission without a command since the scan before; told where time is paced.
    """

    ticks: int = 0
    late_ticks: int = 0
    late_s: float = 0.0
    waited: float = 0.0
    missed: int = 0
    silent: int = 0
    commands: int = 0
    dropped: int = 0

    def line(self, nodes: Nodes) -> str:
        """Return the health of a run in one line."""
        if nodes.time == "lock_step":
            said = f"lock step by {nodes.answer}"
        else:
            said = f"paced at {nodes.real_time_factor:g}: {self.late_ticks} of {self.ticks} ticks late, {1e3 * self.late_s:.0f} ms at most"
            said += f", a thread waited {self.waited:.0%} of the time for a CPU, {self.silent} scans without a command"
        said += f", {self.commands} commands, {self.missed} control loops missed by the nodes' own words"
        return f"health: {said}{f', {self.dropped} messages not recorded' if self.dropped else ''}"


class DrivenSimulation(Simulation):
    """A simulation whose commands, estimate, and missions are those of nodes; its own stack rests.

    A command counts from the tick after the one in which it came.

    Args:
        started: The nodes, ready.
        lidar: The scanner, of which nodes get each scan.
    """

    def __init__(self, *args: Any, started: Started, lidar: Lidar) -> None:
        super().__init__(*args)
        self._started, self._nodes = started, started.nodes
        nodes = started.nodes
        self._scan_ticks = ticks_of(lidar.rate_hz)
        self._used = 0
        self._given: dict[str, Any] = {}
        self._initial: list[float] = []
        self._initial_tick = 0
        self._mission: Mission | None = None
        self._updates = 0
        self._began_s: float | None = None
        self._waits: tuple[float, dict[str, float]] | None = None
        self._why = ""
        self.health = Health()
        self._messages: list[tuple[int, str, str, bytes]] = []
        self._lines: list[str] = []
        self._is_placed = self._is_localized = nodes.localization == "ideal"

    @property
    def is_paced(self) -> bool:
        return self._nodes.time == "paced"

    @property
    def placed(self) -> bool:
        return self._is_placed

    @property
    def localized(self) -> bool:
        return self._is_localized

    def localize(self, pose: Pose) -> None:
        self.told.append(("bridge", f"Setting pose: {pose.x_m:.3f} {pose.y_m:.3f} {pose.yaw_rad:.3f}"))
        self._initial = self._given["localize"] = _numbers(pose)
        self._initial_tick = self.tick + 1
        self._is_placed = True

    def navigate(self, mission: Mission) -> None:
        if self._nodes.mission == "topic" and mission.kind != "navigate_to_pose":
            topic = self._nodes.topics["goal"]
            raise ScenarioError(
                f"{mission.kind}: expected mission: action, as {topic} has one goal, got mission: topic"
            )
        if self.sent_s is None:
            self.sent_s = self.now_s
        m = self.stack.m[0]
        m["status"], m["error_code"] = RUNNING, 0
        self._mission = mission
        self._given["mission"] = {
            "kind": mission.kind,
            "goals": [_numbers(goal) for goal in mission.goals],
            "loops": mission.loops,
        }
        self._exchange(None)
        self._began_s = None  # the time in which an action server accepts a goal is no lateness of the host

    def failure(self, recoveries_before: int) -> str:
        return self._why if self.status == ABORTED else ""

    def finish(self) -> tuple[Sequence[str], Mapping[str, float]]:
        """Keep the recorded messages as outputs of the run, and return its health, and warnings and errors of the nodes.

        Raises:
            ScenarioError: the host was late more often than the run may be, or its threads waited too long. It is not to be judged.
        """
        health, nodes = self.health, self._nodes
        if self._waits is not None:
            (since_s, before), now = self._waits, waits(self._started.programs.pids())
            longest_s = max((waited_s - before.get(place, 0.0) for place, waited_s in now.items()), default=0.0)
            health.waited = longest_s / (time.monotonic() - since_s)
        late = ""
        if health.late_ticks > nodes.most_late * health.ticks:
            late = f"in {health.late_ticks} of {health.ticks} ticks, by {1e3 * health.late_s:.0f} ms at most. {nodes.most_late:.0%} may be"
        elif health.waited > nodes.most_waiting:
            late = f"as a thread waited {health.waited:.0%} of the time for a CPU. {nodes.most_waiting:.0%} may be"
        if late:
            raise ScenarioError(f"{HOST_LATE} {late}. Use fewer workers, or a lower real_time_factor.")
        if self._messages:
            folder = self._started.programs.folders.out / MESSAGES
            folder.mkdir(exist_ok=True)
            rows = (f"{t_ns},{topic},{kind},{len(content)}\n" for t_ns, topic, kind, content in self._messages)
            (folder / "messages.csv").write_text("".join(["t_ns,topic,type,bytes\n", *rows]), encoding="utf-8")
            (folder / "messages.cdr").write_bytes(b"".join(content for *_, content in self._messages))
        return [health.line(nodes), *self._lines], asdict(health)

    def cancel(self) -> None:
        if self.status == RUNNING:
            self._given["cancel"] = True
        self._mission, self.stack.m[0]["status"] = None, RESTING

    def advance(self, until_tick: int | None = None) -> None:
        until, status = self.last_tick if until_tick is None else min(until_tick, self.last_tick), self.status
        while self.tick < until and self.status == status:
            self._keep_pace()
            super().advance(self.tick + 1)
            if self._initial:  # sent once a second until nodes say where they are, as Nav2's commander does
                if (self.tick - self._initial_tick) % ticks_of(1.0) == 0:
                    self._given["localize"] = self._initial
                if not self.is_paced:
                    time.sleep(TICK_S)
            self._exchange(self._new_scan())

    def _new_scan(self) -> tuple[float, bytes] | None:
        """Return time of the stamp (s) and ranges of the tick's scan, as it arrived."""
        m, tick = self.stack.m[0], self.tick - 1
        if self.stack.p[0]["late"]:
            if int(m["scans_used"]) == self._used:
                return None
            self._used = int(m["scans_used"])
            stamp_s = float(m["late_scans"][(self._used - 1) % len(m["late_scans"])][1]) * TICK_S / 5
        elif tick % self._scan_ticks:
            return None
        else:
            stamp_s = tick * TICK_S
        return stamp_s, m["ranges"][: int(m["beams"])].astype("<f4").tobytes()

    def _keep_pace(self) -> None:
        """Wait for the host's clock where time is paced."""
        if not self.is_paced:
            return
        if self._waits is None:
            self._waits = time.monotonic(), waits(self._started.programs.pids())
        now_s = time.monotonic()
        if self._began_s is None:
            self._began_s = now_s - self.now_s / self._nodes.real_time_factor
        behind_s = now_s - (self._began_s + self.now_s / self._nodes.real_time_factor)
        self.health.ticks += 1
        if behind_s > LATE_S:
            self.health.late_ticks += 1
            self.health.late_s = max(self.health.late_s, behind_s)
        else:
            time.sleep(max(0.0, -behind_s))

    def _exchange(self, scan: tuple[float, bytes] | None) -> None:
        """Give the nodes the state after the last tick, and take what they did."""
        m, nodes = self.stack.m[0], self._nodes
        stamp_s, ranges = scan or (0.0, b"")
        awaited = nodes.time == "lock_step" and self.status == RUNNING and scan is not None
        message = {
            "do": "tick",
            "t_ns": round(self.now_s * 1e9),
            "scan_ns": round(stamp_s * 1e9),
            "odom": [float(m[name]) for name in ("odom_x", "odom_y", "odom_yaw", "odom_v", "odom_vy", "odom_w")],
            "await": awaited,
            "wait_s": nodes.answer_within_s,
            **self._given,
        }
        if nodes.localization == "ideal":
            message["map_odom"] = self._true_map_odom()
        self._given = {}
        answer, content = self._started.channel.ask(message, ranges, 2.0 * nodes.answer_within_s + SPARE_S)
        if self.status == RUNNING and (why := self._started.ended()):
            self._fail(why)
        elif not answer["answered"]:
            raise ScenarioError(
                f"{nodes.answer} did not answer the scan of {stamp_s:.2f} s within {nodes.answer_within_s:g} s of the host's time"
            )
        self._take(answer, content, scan is not None)

    def _take(self, answer: Mapping[str, Any], content: bytes, has_scanned: bool) -> None:
        health = self.health
        if (command := answer["command"]) is not None:
            if all(math.isfinite(part) for part in command):
                speed_mps, lateral_mps, yaw_rate_radps = command
                self.command(speed_mps, yaw_rate_radps, lateral_mps)
            else:
                self._fail(f"{self._nodes.topics['cmd_vel']}: expected numbers, got {command} at {self.now_s:.2f} s")
        elif has_scanned and self.status == RUNNING:
            health.silent += 1
        health.commands, health.dropped = answer["commands"], answer["dropped"]
        for level, name, text in answer["log"]:
            health.missed += "missed its desired rate" in text
            if len(self._lines) < MOST_LINES:
                self._lines.append(f"{self.now_s:.2f} s: {'WARN' if level < 40 else 'ERROR'} {name}: {text}")
            self.told.append((name, text))
        offset = 0
        for t_ns, topic, kind, size in answer["recorded"]:
            self._messages.append((t_ns, topic, kind, content[offset : offset + size]))
            offset += size
        self._estimate(answer)
        self._follow(answer["mission"])

    def _estimate(self, answer: Mapping[str, Any]) -> None:
        m = self.stack.m[0]
        if self._nodes.localization == "ideal":
            pose = self.true_pose
        elif (offset := answer["map_odom"]) is not None:
            pose = placed(self.odometry, Pose(*offset))
        elif answer["estimate"] is not None:
            pose = Pose(*answer["estimate"])
        else:
            return
        at = self.frame.pose_to_grid(pose)
        m["x"], m["y"], m["yaw"] = at.x_m, at.y_m, at.yaw_rad
        if answer["updates"] > self._updates:
            self._updates, m["localized"] = answer["updates"], 1
            m["pose_xx"], m["pose_xy"], m["pose_yy"], m["pose_aa"] = answer["covariance"]
        self._is_localized, self._initial = True, []

    def _follow(self, told: Mapping[str, Any]) -> None:
        """Take the state of the mission, of the action or by the true pose."""
        m = self.stack.m[0]
        if self._mission is None or self.status != RUNNING:
            return
        m["recoveries"] = max(int(m["recoveries"]), told["recoveries"])
        goal = self._mission.goals[-1]
        if self._nodes.mission == "topic":
            here = self.true_pose
            is_near = hypot(here.x_m - goal.x_m, here.y_m - goal.y_m) <= self._nodes.goal_tolerance_m
            if not is_near or abs(float(m["true_v"])) > STILL_MPS:
                return
            m["status"] = SUCCEEDED
        elif told["state"] == "succeeded":
            m["status"], m["missed"] = SUCCEEDED, int(m["missed"]) + told["missed"]
        elif told["state"] in ("aborted", "canceled", "rejected"):
            m["error_code"] = told["code"]
            self._fail(f"the mission was {told['state']}{f': {said}' if (said := told['message']) else ''}")
        else:
            return
        if self.status == SUCCEEDED and (row := int(m["events"])) < MAX_EVENTS:
            last = len(self._mission.goals) - 1
            m["event_rows"][row] = (self.now_s, EVENT_GOAL_REACHED, m["true_x"], m["true_y"], last, 0.0)
            m["events"] = row + 1

    def _fail(self, why: str) -> None:
        """End the mission as the nodes' failure."""
        self._why, self.stack.m[0]["status"] = why, ABORTED
        self.command(0.0, 0.0)
        self.told.append(("bridge", f"Goal failed: {why}"))

    def _true_map_odom(self) -> list[float]:
        """Return the transform from the map to odometry with which the estimate is the true pose."""
        true, odometry = self.true_pose, self.odometry
        yaw = true.yaw_rad - odometry.yaw_rad
        c, s = cos_sin(yaw)
        x, y = odometry.x_m, odometry.y_m
        return [true.x_m - (c * x - s * y), true.y_m - (s * x + c * y), yaw]


def _numbers(pose: Pose) -> list[float]:
    return [pose.x_m, pose.y_m, pose.yaw_rad]
