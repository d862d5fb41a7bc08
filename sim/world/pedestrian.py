"""Pedestrians: bodies that walk by the social force model, all of a run together."""

import itertools
import math
from collections.abc import Sequence
from typing import Annotated, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vastflow.sim.model.elementary import atan2, dist, normals
from vastflow.sim.model.parameter import parameter
from vastflow.sim.model.pose import GridFrame, Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.world.mover import MoverRule, MovingBody
from vastflow.sim.world.social_force import BIAS, People, Walls, walk
from vastflow.sim.world.waypoints import Point, Route

SLOWEST_MPS: Final = 0.1


class Pedestrian(MoverRule):
    """A person that walks from waypoint to waypoint, and keeps off walls, others, and, as asked, the robot.

    The speed's mean and standard deviation are those of Moussaïd and others (2009), see `vastflow.sim.world.social_force`.

    Attributes:
        waypoints: (x, y) in the map's frame (m); at a single one it stands.
        speed_m_s: Mean of the desired speed.
        speed_std_m_s: Standard deviation of the desired speed, which is drawn for each run.
        loop: As of `vastflow.sim.world.waypoints.Waypoints`; it turns where it goes back.
        phase_s: Greatest time of walking by which it is ahead of the first waypoint at the start, drawn for each run.
        avoids_robot: Whether the robot is a pedestrian to it, or nothing.
    """

    waypoints: Annotated[Route, Field(min_length=1)]
    speed_m_s: float = parameter(1.29, SLOWEST_MPS, 10.0)
    speed_std_m_s: float = parameter(0.19, 0.0, 10.0)
    loop: Literal["once", "back_and_forth", "around"] = "back_and_forth"
    phase_s: float = parameter(0.0, 0.0, 1e6)
    avoids_robot: bool = True

    def drawn(self, rng: np.random.Generator) -> Self:
        speed_m_s = self.speed_m_s + self.speed_std_m_s * float(normals(rng, (1,), np.float64)[0])
        phase_s = self.phase_s * rng.random()
        return self.model_copy(update={"speed_m_s": max(speed_m_s, SLOWEST_MPS), "phase_s": phase_s})

    @property
    def is_cyclic(self) -> bool:
        return self.loop != "once" and len(self.waypoints) > 1

    @property
    def points(self) -> tuple[Point, ...]:
        """Waypoints in the order in which they are walked to, each round once."""
        return self.waypoints + (self.waypoints[-2:0:-1] if self.loop == "back_and_forth" else ())

    def begin(self) -> tuple[Point, int]:
        """Return the place at the start, and the index of the point that it walks to first."""
        points, ahead_m = self.points, self.phase_s * self.speed_m_s
        legs = [*itertools.pairwise([*points, *points[: 1 if self.is_cyclic else 0]])]
        if self.is_cyclic:
            ahead_m = math.fmod(ahead_m, math.fsum(dist(*leg) for leg in legs))
        for k, (here, there) in enumerate(legs):
            if ahead_m < (length_m := dist(here, there)):
                share = ahead_m / length_m
                place = here[0] + share * (there[0] - here[0]), here[1] + share * (there[1] - here[1])
                return place, (k + 1) % len(points)
            ahead_m -= length_m
        return points[-1], len(points) - 1


class Crowd:
    """The pedestrians of a run, who walk together.

    Attributes:
        members: Their numbers among the movers.
        reacts: Whether any of them avoids the robot.
    """

    def __init__(self, movers: Sequence[MovingBody], frame: GridFrame, walls: Walls) -> None:
        found = {k: body.rule for k, body in enumerate(movers) if isinstance(body.rule, Pedestrian)}
        rules = [*found.values()]
        self.members = [*found]
        self.reacts = any(rule.avoids_robot for rule in rules)
        self._frame, self._walls = frame, walls
        self._robot: Pose | None = None
        first = [*itertools.accumulate((len(rule.points) for rule in rules), initial=0)]
        begins = [rule.begin() for rule in rules]
        points = frame.points_to_grid(np.array([point for rule in rules for point in rule.points]).reshape(-1, 2))
        xy_m = frame.points_to_grid(np.array([place for place, _ in begins]).reshape(-1, 2))
        target = np.array([at + k for at, (_, k) in zip(first, begins, strict=False)], dtype=np.int64)
        ahead_m = (points[target] - xy_m).tolist()
        self._people = People(
            xy_m,
            np.zeros_like(xy_m),
            np.array([atan2(y, x) for x, y in ahead_m]),
            target,
            points,
            np.column_stack((first[:-1], np.array(first[1:]) - 1)).astype(np.int64),
            np.array([rule.is_cyclic for rule in rules], dtype=np.bool_),
            np.array([rule.speed_m_s for rule in rules]),
            np.array([movers[k].shape.circumradius_m for k in found]),
            np.array([rule.avoids_robot for rule in rules], dtype=np.bool_),
        )

    def walk(self, ticks: int, robot: Pose, begins: bool) -> NDArray[np.float64]:
        """Return x, y, yaw (ticks, M, 3) after each of the next ticks.

        Args:
            robot: Its true pose in the map's frame after the tick that they last walked in.
            begins: Whether the first of them is the start.
        """
        poses = np.empty((ticks, len(self.members), 3))
        if begins:
            poses[0] = np.column_stack((self._people.xy_m, self._people.yaw_rad))
        pose = self._frame.pose_to_grid(robot)
        before, self._robot = self._robot or pose, pose
        v_mps = (pose.x_m - before.x_m) / TICK_S, (pose.y_m - before.y_m) / TICK_S
        walk(self._people, self._walls, np.array([pose.x_m, pose.y_m, *v_mps]), BIAS, poses[1 if begins else 0 :])
        return poses
