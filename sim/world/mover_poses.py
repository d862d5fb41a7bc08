"""The poses of a run's movers, tick by tick."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.pose import GridFrame, Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Columns
from vastflow.sim.world.crowd import Crowd
from vastflow.sim.world.mover import Mover, MovingBody, ReactiveMover, Sight
from vastflow.sim.world.readers.reader import FARTHEST_M
from vastflow.sim.world.social_force import Walls

AHEAD_TICKS: Final = 200
"""Ticks for which rules of time are asked at once; a body that reacts is asked tick by tick."""


class MoverPoses:
    """The poses of movers, as far as they are known.

    Args:
        walls: The walls that pedestrians keep off.

    Attributes:
        table: (ticks + 1, M, 3) x, y, yaw at each tick in the frame of the map's grid, as kernels read it.
    """

    def __init__(self, movers: Sequence[MovingBody], frame: GridFrame, ticks: int, walls: Walls) -> None:
        self._movers, self._frame = movers, frame
        self._crowd = Crowd(movers, frame, walls)
        self._alone = [(k, body) for k, body in enumerate(movers) if k not in self._crowd.members]
        self._reacts = self._crowd.reacts or any(isinstance(body.rule, ReactiveMover) for body in movers)
        self.table = np.zeros((ticks + 1, len(movers), 3))
        self._known = -1

    def look_ahead(self, tick: int, robot: Pose) -> int:
        """Return the tick up to which poses are known from `tick` on, asking for more if there are none.

        Raises:
            ScenarioError: a rule gives no pose.
        """
        last = len(self.table) - 1
        if not self._movers:
            return last
        while self._known < min(tick + 1, last):
            first, ticks = self._known + 1, min(1 if self._reacts else AHEAD_TICKS, last - self._known)
            if self._crowd.members:
                self.table[first : first + ticks, self._crowd.members] = self._crowd.walk(ticks, robot, first == 0)
            for self._known in range(first, first + ticks):
                for k, body in self._alone:
                    self.table[self._known, k] = self._asked(k, body, robot)
        return self._known

    def at(self, tick: int, k: int) -> Pose:
        """Return the pose of mover `k` in the frame of the map's grid."""
        return Pose(*self.table[tick, k].tolist())

    def _asked(self, k: int, body: MovingBody, robot: Pose) -> tuple[float, float, float]:
        now = self._known
        try:
            if isinstance(body.rule, Mover):
                found = body.rule.pose_at(now * TICK_S)
            elif not isinstance(body.rule, ReactiveMover):
                raise TypeError("expected a Mover or a ReactiveMover")
            elif now == 0:
                found = body.rule.begin()
            else:
                own = self._frame.pose_to_map(self.at(now - 1, k))
                places = ((pose.x_m, pose.y_m, pose.yaw_rad) for pose in (own, robot))
                found = body.rule.step(Sight((now - 1) * TICK_S, *places), TICK_S)
            x_m, y_m, yaw_rad = map(float, found)
            if not (abs(x_m) <= FARTHEST_M and abs(y_m) <= FARTHEST_M and math.isfinite(yaw_rad)):
                raise ValueError(f"expected numbers, and a place within {FARTHEST_M:g} m, got {found}")
        except Exception as error:
            what = f"expected x, y, and yaw at {now * TICK_S:g} s, got {type(error).__name__}: {error}"
            raise ScenarioError(f"mover {body.name!r}: {what}") from error
        pose = self._frame.pose_to_grid(Pose(x_m, y_m, yaw_rad))
        return pose.x_m, pose.y_m, pose.yaw_rad

    def columns_at(self, t_ms: NDArray[np.int32]) -> Columns:
        """Return the recording's columns of the poses at the times (N,) of its rows, in the map's frame."""
        found = {}
        for k, body in enumerate(self._movers):
            poses = self.table[np.rint(t_ms / (1e3 * TICK_S)).astype(np.int64), k]
            yaw_rad = np.remainder(poses[:, 2] + self._frame.yaw_rad + math.pi, math.tau) - math.pi
            values = np.column_stack([self._frame.points_to_map(poses[:, :2]), yaw_rad])
            for name, column in zip(("x_mm", "y_mm", "yaw_mrad"), values.T, strict=True):
                found[f"mover_{name}/{body.name}"] = np.rint(column * 1e3).astype(np.int32)
        return found
