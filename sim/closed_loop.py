"""One run in progress: the navigation stack and the world in turn, 20 times a simulated second."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.lidar import Lidar
from vastflow.sim.mission import Mission
from vastflow.sim.motion import FREE, MOVING, NOT_THERE, new_body
from vastflow.sim.nav.parameters.stack import NavParameters
from vastflow.sim.nav.state import ROW_TICKS, RUNNING, SUBSTEPS, TICK_S, new_stack
from vastflow.sim.nav.tick import APPEARS, PHYSICS, advance, start
from vastflow.sim.obstacle import Obstacle
from vastflow.sim.prepared import PreparedMap
from vastflow.sim.recording import Event
from vastflow.sim.robot import Robot
from vastflow.sim.streams import streams_of
from vastflow.sim.world import World


class ClosedLoop:
    """A mission of one robot, from its start on.

    Kernels run tick after tick by themselves while the robot moves freely; only where bodies may touch, and where an obstacle
    appears, do they come back for the engine. A run without either never builds one.

    Args:
        entropy: (seed, situation, run index), see `vastflow.sim.streams.run_entropy`.
        timeout_s: Simulated time at which the run ends whatever happens.

    Attributes:
        stack: What the stack has at the end of the last tick.
        body: The robot and the obstacles as they stand.
    """

    def __init__(
        self,
        prepared: PreparedMap,
        parameters: NavParameters,
        lidar: Lidar,
        robot: Robot,
        mission: Mission,
        obstacles: Sequence[Obstacle],
        entropy: Sequence[int],
        timeout_s: float,
    ) -> None:
        rows = obstacle_rows(obstacles)
        self.body = new_body(mission.start, robot.radius_m, rows, _triggers(obstacles))
        self.stack = new_stack(prepared, parameters, lidar, robot, mission, rows, streams_of(entropy), timeout_s)
        self.last_tick = round(timeout_s / TICK_S)
        self._make_world: Callable[[], World] = lambda: World(robot, prepared.walls, obstacles)
        self._world: World | None = None
        start(self.stack.p, self.stack.m)

    @property
    def tick(self) -> int:
        """Ticks that are done."""
        return int(self.stack.m[0]["tick"])

    @property
    def running(self) -> bool:
        """Whether there is time left, and the mission has not ended."""
        return self.status == RUNNING and self.tick < self.last_tick

    @property
    def status(self) -> int:
        """RUNNING, SUCCEEDED or ABORTED."""
        return int(self.stack.m[0]["status"])

    @property
    def events(self) -> Sequence[Event]:
        """What happened in the world so far, in order."""
        return self._world.events if self._world else ()

    def advance(self, until_tick: int | None = None) -> None:
        """Go on until so many ticks of the run are done, by default all there is time for, or the mission has ended."""
        until = self.last_tick if until_tick is None else min(until_tick, self.last_tick)
        stack = self.stack
        while True:
            hold = self._world.hold if self._world else FREE
            why = advance(
                stack.p,
                stack.m,
                stack.grids,
                stack.local,
                stack.cloud,
                stack.route,
                stack.controller,
                stack.rows,
                self.body,
                hold,
                until,
            )
            if why == PHYSICS:
                self._drive()
            elif why >= APPEARS:
                self._appear(why - APPEARS)
            else:
                return

    def _drive(self) -> None:
        """The engine's part of the tick whose commands the stack has just given."""
        self._world = world = self._world or self._make_world()
        t_s = self.tick * TICK_S
        world.drive(self.body.pose, self.stack.m[0]["velocities"].tolist(), TICK_S / SUBSTEPS, t_s - TICK_S)
        for index in world.appeared:
            self._place(index, *world.pose_of(index))
        if self.tick % ROW_TICKS == 0 or world.hold != MOVING:
            world.note_moves(t_s)

    def _appear(self, index: int) -> None:
        self._world = world = self._world or self._make_world()
        world.appear(index, self.tick * TICK_S)
        self.body.triggers[index, 2] = -1.0
        self._place(index, *world.pose_of(index))

    def _place(self, index: int, x_m: float, y_m: float, yaw_rad: float) -> None:
        self.body.obstacles[index, :4] = x_m, y_m, math.cos(yaw_rad), math.sin(yaw_rad)


def obstacle_rows(obstacles: Sequence[Obstacle]) -> NDArray[np.float64]:
    """Obstacles as the rows (K, 6) that `vastflow.sim.lidar.scan` reads; those that are still to appear are nowhere."""
    rows = [
        (
            o.pose.x_m if o.trigger is None else NOT_THERE,
            o.pose.y_m if o.trigger is None else NOT_THERE,
            math.cos(o.pose.yaw_rad),
            math.sin(o.pose.yaw_rad),
            o.length_m / 2,
            0.0 if o.shape == "cylinder" else o.width_m / 2,
        )
        for o in obstacles
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 6)


def _triggers(obstacles: Sequence[Obstacle]) -> NDArray[np.float64]:
    """(K, 3) as `vastflow.sim.motion.Body` has them."""
    rows = [(0.0, 0.0, -1.0) if (t := o.trigger) is None else (t.x_m, t.y_m, t.distance_m) for o in obstacles]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
