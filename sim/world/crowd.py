"""The crowd of a run: its pedestrians, who walk together."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.elementary import atan2
from vastflow.sim.model.pose import GridFrame, Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.world.mover import MovingBody
from vastflow.sim.world.pedestrian import Pedestrian
from vastflow.sim.world.social_force import BIAS, People, Walls, walk


class Crowd:
    """The pedestrians of a run.

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
