"""A run in progress: the navigation stack and the world in turn, 20 times a simulated second."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vastflow.sim.kernels.streams import streams_of
from vastflow.sim.model.elementary import cos_sin
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import GridFrame, Pose, placed
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Event
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.prepared import PreparedMap
from vastflow.sim.nav2.navigator.state import ROW_TICKS, SUBSTEPS, give, new_stack, planning_frame, set_pose
from vastflow.sim.nav2.navigator.tick import APPEARS, PHYSICS, advance, conclude, halt, start
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.world.motion import FREE, MOVING, Body
from vastflow.sim.world.mover import MovingBody
from vastflow.sim.world.mover_poses import MoverPoses
from vastflow.sim.world.obstacle_rows import NOT_THERE, obstacle_rows, trigger_rows
from vastflow.sim.world.physics import Physics
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.social_force import Walls


class ClosedLoop:
    """A robot in its world; it rests until it is localized and has a mission.

    Without a map it is localized from its first mission on.

    Kernels run tick after tick while the robot moves freely; they return for the physics engine where bodies may touch and where an
    obstacle appears. Arguments and events are in the map's frame, `stack`, `body`, and `obstacles` in that of its grid (`frame`).

    Args:
        obstacles: Obstacles that stand from the start, and those that appear when the robot comes near.
        entropy: (seed, situation, run index), see `vastflow.sim.kernels.streams.run_entropy`.
        timeout_s: Simulated time at which the run ends.
        movers: Bodies that move, whatever they meet.

    Attributes:
        stack: State of the stack after the last tick.
        body: The robot and the obstacles as they stand.
        last_tick: Number of ticks until the timeout.
        movers: Poses of the bodies that move.
        obstacles: All that there ever were, in the order of `body.obstacles`: first the movers, as they stand at the start.
        spawned: Obstacles that were put into the world during the run.
        sent_s: Simulated time of the robot's first mission; None before.
    """

    def __init__(
        self,
        prepared: PreparedMap,
        parameters: NavParameters,
        lidar: Lidar,
        robot: Robot,
        start_pose: Pose,
        obstacles: Sequence[Obstacle],
        entropy: Sequence[int],
        timeout_s: float,
        movers: Sequence[MovingBody] = (),
    ) -> None:
        self.frame = frame = prepared.occupancy.frame
        self.last_tick = round(timeout_s / TICK_S)
        given = [obstacle.in_grid(frame) for obstacle in obstacles]
        standing = obstacle_rows([obstacle for obstacle in given if obstacle.trigger is None])
        walls = Walls(prepared.skips, prepared.world.resolution_m, *prepared.world.origin_xy_m, standing)
        self.movers = moving = MoverPoses(movers, frame, self.last_tick, walls)
        moving.look_ahead(0, start_pose)
        at_start = (Obstacle(each.name, each.shape, moving.at(0, k)) for k, each in enumerate(movers))
        self.obstacles = every = [*at_start, *given]
        start_pose, rows = frame.pose_to_grid(start_pose), obstacle_rows(every)
        pose = np.array([start_pose.x_m, start_pose.y_m, start_pose.yaw_rad])
        self.body = Body(pose, robot.radius_m, rows, trigger_rows(every), moving.table)
        self.stack = new_stack(prepared, parameters, lidar, robot, start_pose, rows, streams_of(entropy), timeout_s)
        self.spawned: list[Obstacle] = []
        self.sent_s: float | None = None
        # Without `self`: a reference cycle would keep a run's grids, some 20 MB, until garbage is collected.
        self._make_physics: Callable[[], Physics] = lambda: Physics(robot, prepared.walls, every, moving.table)
        self._physics: Physics | None = None
        start(self.stack.p, self.stack.m)

    @property
    def tick(self) -> int:
        """Number of completed ticks."""
        return int(self.stack.m[0]["tick"])

    @property
    def now_s(self) -> float:
        return self.tick * TICK_S

    @property
    def status(self) -> int:
        """State of the mission: RUNNING, SUCCEEDED, ABORTED or RESTING."""
        return int(self.stack.m[0]["status"])

    @property
    def error_code(self) -> int:
        """Nav2's code of an aborted mission, else 0."""
        return int(self.stack.m[0]["error_code"])

    @property
    def is_paced(self) -> bool:
        """True if time goes by the host's clock."""
        return False

    @property
    def placed(self) -> bool:
        """True if AMCL was ever given an initial pose."""
        return bool(self.stack.m[0]["initialized"])

    @property
    def recoveries(self) -> int:
        """Number of recoveries in all missions so far."""
        return int(self.stack.m[0]["recoveries"])

    @property
    def missed(self) -> int:
        """Number of stops that could not be reached in all missions so far."""
        return int(self.stack.m[0]["missed"])

    @property
    def localized(self) -> bool:
        """True if AMCL has published a pose since the last `localize`."""
        return bool(self.stack.m[0]["initialized"]) and not self.stack.m[0]["first_scan"]

    @property
    def true_pose(self) -> Pose:
        return self.frame.pose_to_map(Pose(*self.body.pose.tolist()))

    @property
    def estimate(self) -> Pose:
        m = self.stack.m[0]
        known = Pose(float(m["x"]), float(m["y"]), float(m["yaw"]))
        return self.frame.pose_to_map(placed(known, self.planning_frame))

    @property
    def planning_frame(self) -> Pose:
        """Pose of the frame in which the stack plans, in the frame of the map's grid."""
        return planning_frame(self.stack)

    @property
    def events(self) -> Sequence[Event]:
        """Events in the world so far, in order and in the map's frame."""
        return [_in_map(event, self.frame) for event in self._physics.events] if self._physics else ()

    def localize(self, pose: Pose) -> None:
        """Give AMCL an initial pose; the stack is active from the next tick on, see `set_pose`."""
        set_pose(self.stack, self.frame.pose_to_grid(pose))

    def navigate(self, mission: Mission) -> None:
        self.cancel()
        if self.stack.p[0]["without_map"] and not self.placed:
            self.localize(self.true_pose)
        if self.sent_s is None:
            self.sent_s = self.now_s
        goals = tuple(self.frame.pose_to_grid(goal) for goal in mission.goals)
        self.stack = give(self.stack, replace(mission, goals=goals))

    def command(self, speed_mps: float, yaw_rate_radps: float, lateral_mps: float = 0.0) -> None:
        """Give the velocity smoother a command, as the controller does during a mission."""
        m = self.stack.m[0]
        m["command_v"], m["command_w"], m["command_vy"] = speed_mps, yaw_rate_radps, lateral_mps
        m["command_tick"] = m["tick"]

    def cancel(self) -> None:
        halt(self.stack.m, self.stack.controller.bound)

    def standing(self, name: str) -> int | None:
        """Return the number of the standing obstacle called `name`, or None; a mover does not stand."""
        moving = self.body.movers.shape[1]
        named = (index for index, obstacle in enumerate(self.obstacles) if index >= moving and obstacle.name == name)
        return next((index for index in named if math.isfinite(self.body.obstacles[index, 0])), None)

    def spawn(self, obstacle: Obstacle, pushable: bool) -> None:
        """Add an obstacle to the world at its pose; a pushable one has mass and friction."""
        self._physics = world = self._physics or self._make_physics()
        self.spawned.append(obstacle)
        obstacle = obstacle.in_grid(self.frame)
        self.obstacles.append(obstacle)
        world.add(len(self.obstacles) - 1, self.now_s, pushable)
        rows = np.concatenate([self.body.obstacles, obstacle_rows([obstacle])])
        triggers = np.concatenate([self.body.triggers, trigger_rows([obstacle])])
        self.body = self.body._replace(obstacles=rows, triggers=triggers)
        self.stack = replace(self.stack, obstacles=rows)

    def delete(self, name: str) -> bool:
        """Remove the obstacle of this name from the world; return False if there is none."""
        index = self.standing(name)
        if index is not None:
            self._physics = world = self._physics or self._make_physics()
            world.remove(index, self.now_s)
            self.body.obstacles[index, :2] = NOT_THERE
        return index is not None

    def advance(self, until_tick: int | None = None) -> None:
        """Advance to a tick, by default the last, or until the mission's state changes."""
        until = self.last_tick if until_tick is None else min(until_tick, self.last_tick)
        stack, status = self.stack, self.status
        while self.status == status:
            hold = self._physics.hold if self._physics else FREE
            state = stack.p, stack.m, stack.grids, stack.local, stack.cloud, stack.route
            known = min(self.movers.look_ahead(self.tick, self.true_pose), until)
            why = advance(*state, stack.controller.bound, stack.noise.bound, stack.rows, self.body, hold, known)
            if why == PHYSICS:
                self._drive()
            elif why >= APPEARS:
                self._appear(why - APPEARS)
            elif known == until:
                return

    def conclude(self) -> None:
        conclude(self.stack.p, self.stack.m, self.body, self.stack.rows)

    def _drive(self) -> None:
        self._physics = world = self._physics or self._make_physics()
        t_s = self.tick * TICK_S
        world.drive(self.body.pose, self.stack.m[0]["velocities"].tolist(), TICK_S / SUBSTEPS, t_s - TICK_S)
        for index in world.appeared:
            self._place(index, *world.pose_of(index))
        if self.tick % ROW_TICKS == 0 or world.hold != MOVING:
            world.note_moves(t_s)

    def _appear(self, index: int) -> None:
        self._physics = world = self._physics or self._make_physics()
        world.appear(index, self.tick * TICK_S)
        self.body.triggers[index, 4] = math.inf
        self._place(index, *world.pose_of(index))

    def _place(self, index: int, x_m: float, y_m: float, yaw_rad: float) -> None:
        self.body.obstacles[index, :4] = x_m, y_m, *cos_sin(yaw_rad)


def _in_map(event: Event, frame: GridFrame) -> Event:
    if frame.yaw_rad == 0.0:
        return event
    x_m, y_m = frame.to_map(event.x_m, event.y_m)
    if event.kind == "contact":
        return replace(event, x_m=x_m, y_m=y_m)
    # An obstacle is rounded as the world rounds it, and its value is its yaw.
    return replace(event, x_m=round(x_m, 4), y_m=round(y_m, 4), value=round(event.value + frame.yaw_rad, 4))
